from __future__ import annotations

import pytest

from station.bench.check import CheckResult
from station.console.setup_view import _parse_masses
from station.messages.codes import CheckCode, CommandCode
from station.messages.message import Message
from station.session.open_session import CommandRefused
from tests.station.refusals import raises_refusal


@pytest.mark.parametrize(
    "typed", ["1.53 2 0.5", "1,53 2 0,5", "1.53, 2, 0.5", "1,53; 2; 0,5", "1,53;2;0,5", "1,53, 2, 0,5,"]
)
def test_load_steps_are_taken_with_a_decimal_point_or_comma(typed: str) -> None:
    assert _parse_masses(typed) == (1.53, 2.0, 0.5)


@pytest.mark.parametrize("typed", ["1,53,2", "1.5 kg", "1.5.3"])
def test_an_ambiguous_number_is_refused(typed: str) -> None:
    with raises_refusal(CommandRefused, CommandCode.MASSES_NOT_NUMBERS):
        _parse_masses(typed)


@pytest.mark.parametrize(
    ("result", "grade"),
    [
        (CheckResult("disk", Message(CheckCode.DISK), is_good=True), "good"),
        (CheckResult("/markers", Message(CheckCode.NO_CAPTURE), is_good=True, is_doubtful=True), "doubtful"),
        (CheckResult("NI Dev1", Message(CheckCode.NO_ANSWER), is_good=False), "bad"),
    ],
)
def test_only_a_checked_subject_without_a_fault_is_green(result: CheckResult, grade: str) -> None:
    assert result.grade == grade
