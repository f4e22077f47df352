"""Compilation in other processes: its progress is shown, and no failure of it affects the command."""

from __future__ import annotations

import logging
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
import typer

from solver import compiled
from solver.compile_ahead import KERNELS
from station.assessment.compilation import FIRST_USE, CompilationAhead, compilation_beside, compilation_shown
from station.progress import silent

Shown = list[tuple[str, int, int]]
COMMAND = typer.main.get_command(typer.Typer(callback=lambda: None))


@contextmanager
def _ahead(program: str, shown: Shown) -> Iterator[CompilationAhead]:
    with CompilationAhead((sys.executable, "-c", program)) as ahead:
        ahead.ensure_started()
        ahead.show(lambda *count: shown.append(count))
        yield ahead


def _printing(*ready: int) -> str:
    lines = [f'{{"ready": {count}, "kernels": 8}}' for count in ready]
    return "\n".join(f"print('{line}', flush=True)" for line in lines)


def test_every_kernel_that_is_ready_is_shown_and_waited_for() -> None:
    shown: Shown = []
    with _ahead(_printing(0, 3, 8), shown) as ahead:
        assert ahead.wait()
    assert shown == [("compiling the solver", ready, 8) for ready in (0, 3, 8)]


def test_where_all_is_on_disk_there_is_nothing_to_show() -> None:
    shown: Shown = []
    with _ahead(_printing(8), shown) as ahead:
        assert ahead.wait()
    assert shown == []


def test_a_compilation_that_fails_is_not_complete_and_no_error() -> None:
    with _ahead(_printing(3) + "\nraise SystemExit(1)", []) as ahead:
        assert not ahead.wait()
    with _ahead(_printing(3), []) as ahead:
        assert not ahead.wait()
    with CompilationAhead(("a-program-that-there-is-not",)) as ahead:
        ahead.ensure_started()
        ahead.show(silent)
        assert not ahead.wait()


def test_a_line_that_is_not_a_count_is_ignored() -> None:
    with _ahead("print('hello')", []) as ahead:
        assert not ahead.wait()


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[subprocess.Popen[str]]:
    """Processes that are started."""
    started: list[subprocess.Popen[str]] = []

    class Kept(subprocess.Popen):
        def __init__(self, *arguments, **options) -> None:
            super().__init__(*arguments, **options)
            started.append(self)

    monkeypatch.setattr(subprocess, "Popen", Kept)
    return started


def test_the_second_process_ends_with_the_station(started: list[subprocess.Popen[str]]) -> None:
    with _ahead("import sys; sys.stdin.read()", []):
        (child,) = started
        assert child.poll() is None
    assert child.returncode is not None


@pytest.mark.parametrize(("processors", "shares"), [(2, ["solving"]), (8, ["solving", "paths", "dynamics"])])
def test_on_the_first_use_a_process_per_share_starts_at_once_and_only_once(
    tmp_path, monkeypatch, started, processors, shares
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr("os.cpu_count", lambda: processors)
    with typer.Context(COMMAND) as context:
        beside = compilation_beside(context)
        assert [child.args[-1] for child in started] == shares
        beside.ensure_started()
        assert len(started) == len(shares)
    assert all(child.returncode is not None for child in started)


def test_what_is_compiled_in_this_process_is_a_stage_with_one_message_at_its_start(
    tmp_path, monkeypatch, capsys, started
) -> None:
    (tmp_path / "multibody_1").mkdir()
    (tmp_path / "multibody_1" / "bodies.move_bodies-30.py311.nbi").touch()  # an older version of the kernel
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    shown: Shown = []
    with (
        typer.Context(COMMAND) as context,
        compilation_shown(lambda *count: shown.append(count), compilation_beside(context)),
    ):
        assert not started
        assert capsys.readouterr().err == ""
        logging.getLogger("solver.compiled").warning("compiling %s", "a kernel")
        assert capsys.readouterr().err == FIRST_USE + "\n"
        logging.getLogger("solver.compiled").warning("compiling %s", "another kernel")
        (second,) = started
        assert second.args[-1] == "solving"
    (first, _, last) = shown
    assert first[0] == last[0] == "compiling the solver"
    assert first[1] < first[2]
    assert last[1] == last[2] == len(KERNELS)
    assert capsys.readouterr().err == ""
    assert second.returncode is not None


def test_where_nothing_is_compiled_there_is_no_stage() -> None:
    shown: Shown = []
    with compilation_shown(lambda *count: shown.append(count), CompilationAhead()):
        pass
    assert shown == []


def test_where_code_cannot_be_kept_no_second_process_compiles(monkeypatch, capsys, started) -> None:
    monkeypatch.setattr(compiled._NoCache, "is_reported", True)
    shown: Shown = []
    with CompilationAhead() as beside, compilation_shown(lambda *count: shown.append(count), beside):
        logging.getLogger("solver.compiled").warning("compiling %s", "a kernel")
    assert len(shown) == 2
    assert not started
    assert capsys.readouterr().err == ""
