"""Compilation in other processes: its progress is shown, and no failure of it affects the command."""

import logging
import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import typer

from solver import compiled
from solver.compile_ahead import KERNELS
from station.assessment.compilation import FIRST_USE, CompilationAhead, compilation_shown, compile_in_background
from station.child import Child
from station.progress import silent
from tests.station.children import start
from tests.timeout import scaled_timeout

Shown = list[tuple[str, int, int]]
COMMAND = typer.main.get_command(typer.Typer(callback=lambda: None))


@contextmanager
def _ahead(shown: Shown, *numbers: int) -> Iterator[CompilationAhead]:
    """A child that reports these numbers of ready kernels, and ends with the last one as its exit code."""
    with CompilationAhead(start=lambda _: start("report_kernels", *(str(number) for number in numbers))) as ahead:
        ahead.ensure_started()
        ahead.show(lambda *count: shown.append(count))
        yield ahead


def test_every_kernel_that_is_ready_is_shown_unless_all_are_on_disk() -> None:
    shown: Shown = []
    with _ahead(shown, 0, 3, 8, 0) as ahead:
        assert ahead.wait()
    assert shown == [("compiling the solver", ready, 8) for ready in (0, 3, 8)]
    shown: Shown = []
    with _ahead(shown, 8, 0) as ahead:
        assert ahead.wait()
    assert shown == []


def test_a_compilation_that_fails_is_not_complete_and_no_error() -> None:
    def cannot_start(_: str) -> Child:
        raise FileNotFoundError("no-such-program")

    with _ahead([], 3, 1) as ahead:
        assert not ahead.wait()
    with _ahead([], 3, 0) as ahead:
        assert not ahead.wait()
    with CompilationAhead(start=cannot_start) as ahead:
        ahead.ensure_started()
        ahead.show(silent)
        assert not ahead.wait()


@pytest.mark.slow
def test_the_process_that_compiles_ends_with_its_parent(tmp_path: Path) -> None:
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}  # nothing is compiled, so that it would take long
    child = Child("station.assessment.compiling_process", env=environment)
    assert child.receive() == {"ready": 0, "kernels": len(KERNELS)}
    child.close()
    assert child.process.wait(scaled_timeout(60.0)) == 1


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
    with CompilationAhead(start=lambda _: start("freeze")) as ahead:
        ahead.ensure_started()
        (child,) = started
        assert child.poll() is None
    assert child.returncode is not None


@pytest.mark.parametrize(("processors", "shares"), [(2, ["solving"]), (8, ["solving", "paths", "dynamics"])])
def test_on_the_first_use_a_process_per_share_starts_once(tmp_path, monkeypatch, started, processors, shares) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr("os.cpu_count", lambda: processors)
    with typer.Context(COMMAND) as context:
        beside = compile_in_background(context)
        assert [child.args[-1] for child in started] == shares
        beside.ensure_started()
        assert len(started) == len(shares)
    assert all(child.returncode is not None for child in started)


def test_compilation_in_this_process_is_a_stage_with_one_message(tmp_path, monkeypatch, capsys, started) -> None:
    (tmp_path / "multibody_1").mkdir()
    (tmp_path / "multibody_1" / "joints.move_bodies-30.py311.nbi").touch()  # an older version of the kernel
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    shown: Shown = []
    with (
        typer.Context(COMMAND) as context,
        compilation_shown(lambda *count: shown.append(count), compile_in_background(context)),
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
