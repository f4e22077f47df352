"""The check of the bench on the set-up page: one verdict, then what is to be done, then what is in order."""

from __future__ import annotations

from collections.abc import Sequence

from nicegui import ui

from station.bench.check import CheckResult
from station.console.actions import Actions
from station.console.wearer_form import number_of
from station.messages.codes import CommandCode
from station.session.bench_checker import BenchChecker
from station.session.judgement import Grade
from station.session.open_session import CommandRefused

ICONS = {"good": "check_circle", "doubtful": "help_outline", "bad": "cancel"}
POLL_S = 0.2


def show_bench(checker: BenchChecker, actions: Actions) -> None:
    """Check the bench at once, and show the results when they change."""
    ui.label("Bench").classes("heading")
    verdict = ui.row().classes("items-center no-wrap gap-2").props("role=status")
    rows = ui.column().classes("gap-1 w-full")
    with ui.row().classes("items-center gap-3 w-full no-wrap"):
        mass = ui.input("Known mass on the cell [kg]").props("inputmode=decimal").classes("grow").mark("known-mass")
        ui.button("Read it", on_click=lambda: actions.run(lambda: checker.read_mass(_mass_of(mass.value)))).props(
            "outline"
        ).classes("small")
    shown: list[object] = [None]

    def tick() -> None:
        state = checker.is_running, checker.results
        if state != shown[0]:
            shown[0] = state
            _show_verdict(verdict, checker)
            _show_rows(rows, checker.results)

    ui.timer(0.0, checker.ensure_started, once=True)
    ui.timer(POLL_S, tick)
    actions.add("Check the bench", "c", checker.check, mark="check", is_apart=True)


def verdict_of(grade: Grade | None, results: Sequence[CheckResult]) -> str:
    """The state of the bench in one sentence."""
    if grade is None:
        return "not checked"
    count = sum(result.grade == grade for result in results)
    if grade == "bad":
        return f"not ready: {count} problem{'s' * (count > 1)}"
    return "ready" if grade == "good" else f"ready; {count} point{'s' * (count > 1)} not checked"


def _show_verdict(verdict: ui.row, checker: BenchChecker) -> None:
    verdict.clear()
    with verdict:
        if checker.is_running:
            ui.spinner(size="1.6rem")
            ui.label("checking the bench").classes("text-2xl")
            return
        grade = checker.grade
        if grade is not None:
            ui.icon(ICONS[grade], size="2.2rem").classes(grade).mark(f"bench-{grade}")
        text = verdict_of(grade, checker.results)
        ui.label(text[0].upper() + text[1:]).classes(f"text-2xl font-bold {grade or 'quiet'}").mark("bench-verdict")


def _show_rows(rows: ui.column, results: Sequence[CheckResult]) -> None:
    """The checks that ask for something, and the others folded."""
    rows.clear()
    with rows:
        good = [result for result in results if result.grade == "good"]
        for result in results:
            if result.grade != "good":
                _row(result)
        if good:
            with ui.expansion(f"{len(good)} checks passed").classes("w-full text-lg").mark("passed"):
                for result in good:
                    _row(result)


def _row(result: CheckResult) -> None:
    with ui.row().classes("items-start no-wrap gap-2 text-lg"):
        ui.icon(ICONS[result.grade], size="1.6rem").classes(result.grade).mark(f"grade-{result.grade}")
        ui.label(f"{result.subject.removeprefix('/')}: {result.found}").classes("break-words min-w-0").mark("preflight")


def _mass_of(text: str | None) -> float:
    """Raises CommandRefused."""
    try:
        value = number_of(text or "")
    except ValueError:
        value = 0.0
    if not 0 < value < 1000:
        raise CommandRefused.of(CommandCode.WRONG_KNOWN_MASS, text=repr(text or ""))
    return value
