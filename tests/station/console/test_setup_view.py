from __future__ import annotations

import pytest

from station.bench.check import Line
from station.console.setup_view import _masses, grade_of
from station.session.open_session import CommandRefused


@pytest.mark.parametrize(
    "typed", ["1.53 2 0.5", "1,53 2 0,5", "1.53, 2, 0.5", "1,53; 2; 0,5", "1,53;2;0,5", "1,53, 2, 0,5,"]
)
def test_load_steps_are_taken_with_a_decimal_point_or_comma(typed: str) -> None:
    assert _masses(typed) == (1.53, 2.0, 0.5)


@pytest.mark.parametrize("typed", ["1,53,2", "1.5 kg", "1.5.3"])
def test_what_could_be_read_in_two_senses_is_refused(typed: str) -> None:
    with pytest.raises(CommandRefused, match="expected kilograms between blanks"):
        _masses(typed)


@pytest.mark.parametrize(
    ("line", "grade"),
    [
        (Line("disk", "74 GB free", is_good=True), "good"),
        (Line("/markers", "no frames: no capture is running", is_good=True, is_doubtful=True), "doubtful"),
        (Line("NI Dev1", "did not answer", is_good=False), "bad"),
    ],
)
def test_only_what_was_checked_and_is_right_is_green(line: Line, grade: str) -> None:
    assert grade_of(line) == grade
