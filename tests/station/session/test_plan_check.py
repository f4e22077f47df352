"""Names of people are recognised, so that a session is filed under a code; faults of a plan are found."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

from station.config import parse_config
from station.journal import Setup
from station.messages.codes import CommandCode
from station.session.plan_status import check_setup, looks_like_a_name


@pytest.mark.parametrize("word", ["Maria", "smith", "Anna Lee", "de Vries"])
def test_a_name_is_recognised(word: str) -> None:
    assert looks_like_a_name(word)


@pytest.mark.parametrize("word", ["P01", "S12b", "AB", "x3", ""])
def test_a_code_is_not_a_name(word: str) -> None:
    assert not looks_like_a_name(word)


@pytest.mark.parametrize(
    ("changed", "code"),
    [
        ({"repeats": 0}, CommandCode.WRONG_REPEATS),
        ({"repeats": 1001}, CommandCode.WRONG_REPEATS),
        ({"step_masses_kg": (1.5, 0.0)}, CommandCode.WRONG_MASSES),
        ({"step_masses_kg": (math.inf,)}, CommandCode.WRONG_MASSES),
        ({"step_masses_kg": (math.nan,)}, CommandCode.WRONG_MASSES),
    ],
)
def test_impossible_numbers_are_refused(changed: dict[str, Any], code: CommandCode) -> None:
    fault = check_setup(
        replace(Setup("P01", "", ("hand",), 1), **changed), parse_config({"cuffs": {"hand": CUFF}}, "test")
    )
    assert fault is not None and fault.code == code


CUFF = {"anchor_markers": ["a", "b", "c"], "cuff_markers": ["d"]}


@pytest.mark.parametrize(
    ("cuffs", "code"),
    [
        (("hand", "waist"), None),
        ((), CommandCode.NO_CUFF_CHOSEN),
        (("hand", "knee"), CommandCode.UNKNOWN_CUFF),
        (("hand", "waist", "hand"), CommandCode.REPEATED_CUFF),
    ],
)
def test_a_plan_has_every_cuff_once(cuffs: tuple[str, ...], code: CommandCode | None) -> None:
    config = parse_config({"cuffs": {"hand": CUFF, "waist": CUFF}}, "test")
    fault = check_setup(Setup("P01", "", cuffs, 1), config)
    assert (fault and fault.code) == code
