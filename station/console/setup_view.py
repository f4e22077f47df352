"""Set-up of a session: subject, cuffs and plan; sessions to resume; check of the bench.

The check has one verdict, then what is to be done, then what is in order.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from nicegui import ui
from nicegui.elements.mixins.value_element import ValueElement

from documents.interval import counted
from recordings.manifest import TrialCondition
from station.bench.check import CheckResult
from station.console.actions import Actions
from station.console.kept_form import forget_form, keep_form
from station.console.wearer_form import WearerForm, parse_number
from station.journal import Setup
from station.kinematics.marker_sets import published_sets
from station.messages.session_messages import CommandCode
from station.protocol import CONDITION_NAMES
from station.session.controller import BenchChecker, SessionController
from station.session.judgement import Grade
from station.session.open_session import CommandRefused, EarlierSessions, ListedSession, list_sessions
from station.session.plan_status import is_subject_code, looks_like_a_name

ICONS = {"good": "check_circle", "doubtful": "help_outline", "bad": "cancel"}
POLL_S = 0.2


def show(controller: SessionController, actions: Actions) -> None:
    listed = list_sessions(controller.session.config.session.folder)
    with ui.row().classes("w-full gap-8 items-start lg:flex-nowrap"):
        with ui.card().classes("w-full lg:w-1/2"):
            ui.label("New session").classes("heading")
            form = _SetupForm(controller, EarlierSessions(listed, controller.session.config))
        with ui.column().classes("w-full lg:w-1/2 gap-4"):
            with ui.card().classes("w-full").mark("bench"):
                show_bench(controller.checker, actions)
            with ui.card().classes("w-full"):
                _sessions(controller, actions, listed)
    keep_form("setup", form.fields)

    def begin() -> None:
        form.begin()
        forget_form("setup")

    async def begin_on_checked_bench() -> None:
        form.ensure_possible()
        with actions.form:
            waiting = ui.label("the session begins when the bench is checked").classes("text-xl")
        try:
            await controller.checker.wait()
        finally:
            waiting.delete()
        grade, results = controller.checker.grade, controller.checker.results
        if grade == "bad":
            question = f"The bench is {check_verdict(grade, results)}. Begin anyway?"
            actions.ask(question, ("Begin anyway", begin), "Back to the set-up")
        else:
            begin()

    for box in form.boxes:
        box.on("keydown.enter", lambda: actions.run(begin_on_checked_bench))
    actions.add("Begin", "b", begin_on_checked_bench, kind="main")
    actions.add("Rehearse", "r", lambda: form.begin(is_rehearsal=True))
    if listed and listed[0].done < listed[0].trials:  # after a restart, the trial that ended meanwhile is a press away
        last = listed[0]
        name = f"Resume {last.setup.subject}, session {last.setup.number}"
        actions.add(name, "u", lambda: controller.session.resume(last.folder), mark="resume-last")


class _SetupForm:
    """Fields of a new session, filled with the plan of the last one. fields are by name, boxes are those of text."""

    def __init__(self, controller: SessionController, earlier: EarlierSessions) -> None:
        self._controller, self._earlier = controller, earlier
        config, suggested = controller.session.config, earlier.setup
        self._subject = ui.input("Subject code", placeholder="P01").mark("subject").classes("w-full")
        ui.timer(0.0, lambda: self._subject.run_method("focus"), once=True)  # once it is on the page
        warning = ui.label("this looks like a name: use a code, because it becomes part of file names")
        warning.classes("text-xl text-negative")
        warning.bind_visibility_from(self._subject, "value", backward=looks_like_a_name)
        cuffs = ui.select(list(config.cuffs), label="Cuffs, in this order", value=list(suggested.cuffs), multiple=True)
        self._cuffs = cuffs.props("use-chips").classes("w-full").mark("cuffs")
        with ui.grid(columns=2).classes("w-full gap-x-8 gap-y-0"):
            self._operator = ui.input("Operator", value=suggested.operator).mark("operator")
            self._number = ui.input("Session", value="1").mark("number")
            self._repeats = ui.number("Repeats of each test", value=suggested.repeats, min=1, precision=0)
            self._repeats.mark("repeats")
            masses = " ".join(f"{mass:g}" for mass in suggested.step_masses_kg)
            self._masses = ui.input("Load steps [kg]", value=masses).mark("load-steps")
        self._conditions = _conditions(controller, suggested.conditions)
        self._wearer = None if config.body is None else WearerForm(tuple(config.cuffs), published_sets())
        self._bounce = ui.switch("Bounce calibration first", value=suggested.has_bounce)
        self._bounce.set_enabled(config.bounce is not None)
        self._preview = ui.label().classes("text-lg quiet break-all").mark("preview")
        self.boxes = [self._subject, self._operator, self._number, self._repeats, self._masses]
        self.fields = self._fields()
        if self._wearer is not None:
            self._wearer.show(earlier.wearer(""))
        self._subject.on_value_change(self._suggest)
        for field in (self._subject, self._number, self._cuffs):
            field.on_value_change(self._show_file)

    def ensure_possible(self) -> None:
        """Raises CommandRefused for a set-up with a fault."""
        self._controller.session.ensure_possible(self._setup())
        if self._wearer is not None:
            _ = self._wearer.wearer

    def begin(self, *, is_rehearsal: bool = False) -> None:
        """Raises CommandRefused, JournalError."""
        session, wearer = self._controller.session, None if self._wearer is None else self._wearer.wearer
        session.begin(self._setup(), wearer=wearer, is_rehearsal=is_rehearsal)
        if session.folder is not None:
            self._controller.checker.write_readings(session.folder)

    def _fields(self) -> dict[str, ValueElement[Any]]:
        fields: dict[str, ValueElement[Any]] = {
            "subject": self._subject,
            "operator": self._operator,
            "number": self._number,
            "cuffs": self._cuffs,
            "repeats": self._repeats,
            "masses": self._masses,
            "bounce": self._bounce,
        }
        fields |= {} if self._conditions is None else {"conditions": self._conditions}
        return fields | ({} if self._wearer is None else self._wearer.fields)

    def _setup(self) -> Setup:
        masses = _parse_masses(self._masses.value or "")
        if not masses and self._controller.session.config.protocol.step_masses_kg:
            raise CommandRefused.of(CommandCode.NO_MASSES)
        return Setup(
            (self._subject.value or "").strip(),
            (self._operator.value or "").strip(),
            tuple(self._cuffs.value),
            int(self._repeats.value or 0),
            bool(self._bounce.value),
            (self._number.value or "").strip(),
            masses,
            tuple(self._conditions.value) if self._conditions is not None else (),
        )

    def _suggest(self) -> None:
        """The next number and the mass of the subject, until the operator enters others."""
        subject = (self._subject.value or "").strip()
        self._number.value = self._earlier.next_number(subject)
        if self._wearer is not None:
            self._wearer.show_mass(self._earlier.wearer(subject).mass_kg)

    def _show_file(self) -> None:
        number, subject = (self._number.value or "").strip(), (self._subject.value or "").strip()
        named = Setup(subject, "", tuple(self._cuffs.value), 1, number=number)
        is_possible = is_subject_code(named.subject) and is_subject_code(named.number)
        self._preview.set_text(f"files such as {_example_file(self._controller, named)}" if is_possible else "")


def _example_file(controller: SessionController, setup: Setup) -> Path:
    """File name of the first static trial of the first cuff; existing files are never overwritten."""
    cuff = setup.cuffs[0] if setup.cuffs else ""
    names = {"subject": setup.subject, "session": setup.number, "test": "static", "cuff": cuff, "run": 1}
    return (
        controller.session.session_folder(setup) / f"{controller.session.config.session.file_name.format(**names)}.mcap"
    )


def _conditions(controller: SessionController, suggested: tuple[TrialCondition, ...]) -> ui.select | None:
    """Conditions of the wearer's motions; None without markers of the wearer."""
    if controller.session.config.body is None:
        return None
    label = "Pose and motions of the wearer"
    choice = ui.select(dict(CONDITION_NAMES), label=label, value=list(suggested), multiple=True)
    return choice.props("use-chips").classes("w-full").mark("conditions")


def _parse_masses(text: str) -> tuple[float, ...]:
    """Kilograms separated by spaces, with a decimal point or comma. Raises CommandRefused."""
    try:
        return tuple(parse_number(mass) for mass in re.sub(r";|,(?=\s|$)", " ", text).split())
    except ValueError as error:
        raise CommandRefused.of(CommandCode.MASSES_NOT_NUMBERS, text=repr(text)) from error


def _sessions(controller: SessionController, actions: Actions, listed: list[ListedSession]) -> None:
    ui.label("Resume a session").classes("heading")
    if not listed:
        ui.label("no session yet").classes("text-xl quiet")
        return
    with ui.scroll_area().classes("w-full h-64 sessions"), ui.column().classes("w-full gap-1"):
        for session in listed:
            _session(controller, actions, session)


def _session(controller: SessionController, actions: Actions, session: ListedSession) -> None:
    setup, folder = session.setup, session.folder
    trials = "; ".join((", ".join(setup.cuffs), *(CONDITION_NAMES[worn] for worn in setup.conditions)))
    name = f"{setup.subject}, session {setup.number}: {trials.removeprefix('; ')}"
    when = f"{session.begun.day} {session.begun:%B %Y, %H:%M}" if session.begun else "date unknown"
    progress = f"{session.done} of {counted(session.trials, 'trial')}"
    button = ui.button(on_click=lambda: actions.run(lambda: controller.session.resume(folder))).props("flat")
    with button.classes("w-full session").mark("resume"):
        button.tooltip(str(folder))
        with ui.grid(columns="1fr auto").classes("w-full gap-x-4 gap-y-0 text-left items-center"):
            ui.label(name).classes("font-bold break-words min-w-0")
            ui.label(progress).classes("text-right")
            ui.label(f"{when}{f' · {setup.operator}' if setup.operator else ''}").classes("quiet text-lg")
            ui.linear_progress(session.done / max(1, session.trials), show_value=False).classes("w-28").props(
                f'size=10px rounded aria-label="{progress}"'
            )


def show_bench(checker: BenchChecker, actions: Actions) -> None:
    """Check the bench at once, and show the results when they change."""
    ui.label("Bench").classes("heading")
    verdict = ui.row().classes("items-center no-wrap gap-2").props("role=status")
    asking = ui.column().classes("gap-1 w-full")
    passed = _Passed()
    with ui.row().classes("items-center gap-3 w-full no-wrap"):
        mass = ui.input("Known mass on the cell [kg]").props("inputmode=decimal").classes("grow").mark("known-mass")
        ui.button("Read it", on_click=lambda: actions.run(lambda: checker.read_mass(_parse_mass(mass.value)))).props(
            "outline"
        ).classes("small")
    shown: list[object] = [None]

    def tick() -> None:
        state = checker.is_running, checker.results
        if state != shown[0]:
            shown[0] = state
            _show_verdict(verdict, checker)
            _show_rows(asking, passed, checker.results)

    ui.timer(0.0, checker.ensure_started, once=True)
    ui.timer(POLL_S, tick)
    actions.add("Check the bench", "c", checker.check, mark="check", is_apart=True)


def check_verdict(grade: Grade | None, results: Sequence[CheckResult]) -> str:
    """The state of the bench in one sentence."""
    if grade is None:
        return "not checked"
    count = sum(result.grade == grade for result in results)
    if grade == "bad":
        return f"not ready: {counted(count, 'problem')}"
    return "ready" if grade == "good" else f"ready; {counted(count, 'point')} not checked"


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
        text = check_verdict(grade, checker.results)
        ui.label(text[0].upper() + text[1:]).classes(f"text-2xl font-bold {grade or 'quiet'}").mark("bench-verdict")


class _Passed:
    """The checks that passed, folded. The list stays as it is in a new check, and when results arrive with the click
    that unfolds it: an update of the expansion itself would fold it again.
    """

    def __init__(self) -> None:
        self.whole = ui.element("div").classes("w-full")
        with self.whole, ui.expansion().classes("w-full text-lg").mark("passed") as expansion:
            expansion.props["toggle-aria-label"] = ""  # the name of the button is its text
            with expansion.add_slot("header"), ui.item_section():
                self.count = ui.item_label()
            self.rows = ui.column().classes("gap-1 w-full")


def _show_rows(asking: ui.column, passed: _Passed, results: Sequence[CheckResult]) -> None:
    """The checks that ask for something, and the others folded."""
    good = [result for result in results if result.grade == "good"]
    passed.count.text = f"{counted(len(good), 'check')} passed"
    passed.whole.set_visibility(bool(good))
    for place in (asking, passed.rows):
        place.clear()
        with place:
            for result in results:
                if (result.grade == "good") == (place is passed.rows):
                    _row(result)


def _row(result: CheckResult) -> None:
    with ui.row().classes("items-start no-wrap gap-2 text-lg"):
        ui.icon(ICONS[result.grade], size="1.6rem").classes(result.grade).mark(f"grade-{result.grade}")
        ui.label(f"{result.subject.removeprefix('/')}: {result.found}").classes("break-words min-w-0").mark("preflight")


def _parse_mass(text: str | None) -> float:
    """Raises CommandRefused."""
    try:
        value = parse_number(text or "")
    except ValueError:
        value = 0.0
    if not 0 < value < 1000:
        raise CommandRefused.of(CommandCode.WRONG_KNOWN_MASS, text=repr(text or ""))
    return value
