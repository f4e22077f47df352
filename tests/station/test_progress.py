"""Stages on stderr: bars on a terminal, one line each elsewhere."""

from io import StringIO
from unittest.mock import Mock

import pytest
from rich.console import Console

from station.progress import COMPILING, progress_bars


class Terminal(StringIO):
    def isatty(self) -> bool:
        return True


def _console(screen: Terminal) -> Console:
    return Console(file=screen, force_terminal=True, force_interactive=True, legacy_windows=False, width=120)


@pytest.fixture
def clock() -> Mock:
    """Its time is what it returns."""
    return Mock(return_value=0.0)


@pytest.fixture
def log() -> StringIO:
    return StringIO()


def test_a_log_has_one_line_per_stage_when_it_ends(log: StringIO, clock: Mock) -> None:
    with progress_bars(Console(file=log), clock) as progress:
        for done in range(26):
            progress("recording trials", done, 25)
            assert log.getvalue() == "" or done == 25
            clock.return_value += 2.84
        progress("fitting cuffs", 0, 4)
        clock.return_value += 1.96
        progress("fitting cuffs", 4, 4)
    assert log.getvalue() == "recording trials: 25 of 25 in 71 s\nfitting cuffs: 4 of 4 in 2.0 s\n"


def test_a_stage_that_ends_early_has_its_line_at_the_end(log: StringIO, clock: Mock) -> None:
    with progress_bars(Console(file=log), clock) as progress:
        progress("trying suits", 0, 160)
        clock.return_value = 200.0
        progress("trying suits", 34, 160)
        progress("drawing", 0, 2)
        clock.return_value = 203.0
        progress("drawing", 2, 2)
    assert log.getvalue() == "drawing: 2 of 2 in 3.0 s\ntrying suits: 34 of 160 in 3 min 20 s\n"


def test_a_stage_within_another_does_not_end_it(log: StringIO, clock: Mock) -> None:
    with progress_bars(Console(file=log), clock) as progress:
        progress("solving muscles", 0, 60)
        for done in range(9):
            progress("compiling the solver", done, 8)
            clock.return_value += 2.0
        progress("solving muscles", 60, 60)
    assert log.getvalue() == "compiling the solver: 8 of 8 in 16 s\nsolving muscles: 60 of 60 in 18 s\n"


def test_an_interrupted_stage_has_its_line_and_one_that_has_ended_no_second_one(log: StringIO, clock: Mock) -> None:
    with progress_bars(Console(file=log)):
        pass
    assert log.getvalue() == "", "nothing is reported"
    with pytest.raises(KeyboardInterrupt), progress_bars(Console(file=log), clock) as progress:
        for _ in range(2):
            progress("solving muscles", 60, 60)
        progress("recording trials", 0, 25)
        clock.return_value = 20.0
        progress("recording trials", 7, 25)
        raise KeyboardInterrupt
    assert log.getvalue() == "solving muscles: 60 of 60 in 0.0 s\nrecording trials: 7 of 25 in 20 s\n"


def test_a_log_has_no_control_characters_even_where_colours_are_forced(
    log: StringIO, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    with progress_bars(Console(file=log, width=20)) as progress:
        progress("solving muscles, other motion", 1, 1)
    assert log.getvalue() == "solving muscles, other motion: 1 of 1 in 0.0 s\n"


@pytest.mark.parametrize(
    ("stage", "done", "of", "left"),
    [
        ("recording trials", 5, 25, "about 2 min 00 s left"),
        ("fitting cuffs", 4, 4, None),
        (COMPILING, 1, 4, None),  # of uneven steps
    ],
)
def test_a_terminal_shows_a_bar_with_the_time_left_of_even_steps(
    clock: Mock, stage: str, done: int, of: int, left: str | None
) -> None:
    screen = Terminal()
    with progress_bars(_console(screen), clock) as progress:
        progress(stage, 0, of)
        clock.return_value = 30.0
        progress(stage, done, of)
    shown = screen.getvalue()
    assert stage in shown and f"{done}/{of}" in shown and "0:00:30" in shown
    assert left in shown if left else "left" not in shown


@pytest.mark.parametrize("is_terminal", [True, False])
def test_a_report_that_comes_after_the_end_is_ignored(clock: Mock, *, is_terminal: bool) -> None:
    screen = Terminal() if is_terminal else StringIO()
    console = _console(screen) if isinstance(screen, Terminal) else Console(file=screen)
    with progress_bars(console, clock) as progress:
        progress("recording trials", 25, 25)
    before = screen.getvalue()
    progress("compiling the solver", 8, 8)
    assert "recording trials" in before and screen.getvalue() == before
