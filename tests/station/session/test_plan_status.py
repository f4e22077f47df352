from __future__ import annotations

import math
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from station.config import StationConfig, parse_config
from station.journal import Decision, Journal, Recorded, Setup
from station.messages.codes import CommandCode
from station.protocol import TrialSpec
from station.session.plan_status import (
    PlanStatus,
    check_setup,
    is_donned_without_trial,
    looks_like_a_name,
    minutes_left,
    plan_status,
    preparation,
    redo_loses_migration,
)

SETUP = Setup("P01", "ab", ("hand", "elbow"), 2, has_bounce=False)
ONE_CUFF = replace(SETUP, cuffs=("hand",))
WEARER = replace(SETUP, cuffs=("hand",), repeats=1, conditions=("unsuited", "slack", "tight", "mvc"))
ACCEPT, REDO = Decision("accept", ""), Decision("redo", "slipped")


def recorded(cuff: str | None, test: str, repeat: int = 1, donning: str = "1", run: int = 1) -> Recorded:
    return Recorded(f"{cuff}-{test}-{repeat}-{donning}-{run}.mcap", cuff, test, repeat, donning, True, 0, "")


def accepted(setup: Setup, count: int) -> list[tuple[Recorded, Decision | None]]:
    """An accepted recording of each of the first trials of a plan."""
    plan = plan_status(setup, Journal(setup), Path())
    return [
        (replace(recorded(spec.cuff, spec.test, spec.repeat), file=f"{i}.mcap", condition=spec.condition), ACCEPT)
        for i, spec in enumerate(plan.trials[:count])
    ]


@pytest.fixture
def session(tmp_path: Path):
    """Where a session stands after these recordings, each with its verdict or None."""

    def stand(*made: tuple[Recorded, Decision | None], setup: Setup = SETUP, **changes: object) -> PlanStatus:
        for trial, _ in made:
            (tmp_path / trial.file).touch()
        verdicts = {trial.file: verdict for trial, verdict in made if verdict is not None}
        journal = replace(Journal(setup, tuple(trial for trial, _ in made), verdicts), **changes)
        return plan_status(setup, journal, tmp_path)

    return stand


@pytest.mark.parametrize(
    ("setup", "done", "title", "prepared"),
    [
        (
            replace(SETUP, has_bounce=True),
            0,
            "bounce calibration",
            "Hang the 2.5 kg calibration weight on its spring under the load cell",
        ),
        (SETUP, 0, "hand, static, repeat 1", "Don the hand cuff, rope slack"),
        (ONE_CUFF, 0, "hand, static, repeat 1", "Don the hand cuff, rope slack"),
        (SETUP, 1, "hand, dynamic, repeat 1", "Rope slack, wearer at ease"),
        (SETUP, 2, "hand, static, repeat 2", "Let the wearer rest for 60 s"),
        (SETUP, 3, "hand, dynamic, repeat 2", "Rope slack, wearer at ease"),
        (SETUP, 4, "elbow, static, repeat 1", "Don the elbow cuff, rope slack"),
        (SETUP, 8, None, "The plan is complete"),
        (WEARER, 0, "pose", "Wearer without the suit, all markers on: stand upright, arm hanging"),
        (WEARER, 1, "motion, without the suit", "Wearer without the suit, all markers on; wearer at ease, arm hanging"),
        (
            WEARER,
            2,
            "motion, maximal contraction",
            "Fix the arm for a maximal voluntary contraction; wearer at ease, arm hanging",
        ),
        (WEARER, 5, "motion, suit, cord slack", "Don the suit, cord slack; wearer at ease, arm hanging"),
        (WEARER, 6, "motion, suit, cord tight", "Tighten the cord of the suit; wearer at ease, arm hanging"),
    ],
)
def test_the_next_trial_and_its_preparation_follow_the_order_of_the_plan(
    session, setup: Setup, done: int, title: str | None, prepared: str
) -> None:
    plan = session(*accepted(setup, done), setup=setup)
    assert plan.done == frozenset(plan.trials[:done]) and plan.undecided is None
    assert plan.spec == (plan.trials[done] if title else None)
    assert (plan.spec and plan.spec.title) == title
    assert preparation(plan, parse_config({"bounce": {"mass_kg": 2.5, "marker": "weight"}}, "test")) == prepared
    assert plan.is_new_cuff is prepared.endswith("rope slack") and plan.has_pause is prepared.startswith("Let ")


def test_a_recording_waits_for_its_decision(session) -> None:
    trial = recorded("hand", "static")
    plan = session((trial, None))
    assert plan.undecided == trial
    assert plan.done == frozenset()


def test_a_redone_trial_is_next_until_it_is_accepted(session) -> None:
    first = (recorded("hand", "static"), REDO)
    assert session(first).spec == session(first).trials[0]
    assert session(first, (recorded("hand", "static", run=2), ACCEPT)).spec == session().trials[1]


def test_a_skipped_trial_is_not_next_and_counts_as_skipped_until_it_is_recorded(session) -> None:
    first, second, *_ = session().trials
    skipped = frozenset({first, TrialSpec("forearm", "static", 1, donning="1")})
    plan = session(skipped=skipped)
    assert (plan.skipped, plan.spec) == ({first}, second)
    plan = session((recorded("hand", "static"), ACCEPT), skipped=skipped)
    assert (plan.skipped, plan.done) == (frozenset(), {first})


def test_a_chosen_trial_is_next_before_those_chosen_earlier(session) -> None:
    first, second, third, fourth, *_ = session().trials
    plan = session(chosen=(fourth, third, TrialSpec("forearm", "static", 1)))
    assert plan.left[:3] == (fourth, third, first)
    plan = session((recorded("hand", "dynamic", 2), ACCEPT), chosen=(fourth, third))
    assert plan.left[:3] == (third, first, second), "a recorded one no longer"


def test_a_cuff_to_which_the_rope_returns_is_worn_as_before(session) -> None:
    one, other, again = recorded("hand", "static"), recorded("elbow", "static"), TrialSpec("hand", "dynamic", 1)
    assert not session((one, ACCEPT), chosen=(again,)).is_back
    plan = session((one, ACCEPT), (other, ACCEPT), chosen=(again,))
    assert plan.spec == again and plan.is_back and not plan.is_new_cuff
    assert preparation(plan, StationConfig()) == "Rope to the hand cuff, worn as before, and slack"


PACED = parse_config({"protocol": {"step_masses_kg": [1, 1], "hold_s": 7, "swing_s": 20, "pause_s": 60}}, "test")


def test_the_time_left_is_that_of_the_protocol(session) -> None:
    """Two static trials of 5 loads, two dynamic ones of 20 s, one donning, one pause of 60 s, four decisions."""
    journal = Journal(ONE_CUFF)
    assert minutes_left(session(setup=ONE_CUFF), journal, PACED) == round((2 * 5 * 12 + 2 * 20 + 90 + 60 + 80) / 60)
    assert minutes_left(session(*accepted(ONE_CUFF, 4), setup=ONE_CUFF), journal, PACED) == 1


@pytest.mark.parametrize(("slower", "minutes"), [(1.0, 30), (2.0, 55), (0.5, 17), (100.0, 30)])
def test_the_time_left_is_at_the_pace_of_the_session_without_its_interruptions(
    session, slower: float, minutes: int
) -> None:
    """Ten of twenty repeats are left: 10 x (80 + 40 + 60) s = 30 min. Since the first trial ended, 1660 s were due:
    (300 + slower x 1660) / (300 + 1660) of 30 min; a hundred times slower is an interruption.
    """
    setup = replace(ONE_CUFF, repeats=20)
    done = accepted(setup, 20)
    ended = np.cumsum([40.0 if trial.test == "dynamic" else 140.0 for trial, _ in done]) * slower
    entered = {
        trial.file: f"{datetime(2026, 5, 28, tzinfo=UTC) + timedelta(seconds=end)}"
        for (trial, _), end in zip(done, ended, strict=True)
    }
    journal = Journal(setup, tuple(trial for trial, _ in done), entered=entered)
    assert minutes_left(session(*done, setup=setup), journal, PACED) == minutes


def test_a_cuff_donned_anew_starts_its_repeats_anew(session) -> None:
    plan = session((recorded("hand", "static"), ACCEPT), donnings={"hand": 1})
    assert plan.done == frozenset()
    assert plan.spec is not None and (plan.spec.donning, plan.spec.test) == ("2", "static")
    assert plan.is_new_cuff
    assert [trial.donning for trial in plan.trials] == ["2"] * 4 + ["1"] * 4


def test_a_recording_whose_file_is_missing_does_not_count(session, tmp_path: Path) -> None:
    trial = recorded("hand", "static")
    session((trial, ACCEPT))
    (tmp_path / trial.file).unlink()
    journal = Journal(SETUP, (trial,), {trial.file: ACCEPT})
    assert plan_status(SETUP, journal, tmp_path).done == frozenset()


def test_a_motion_is_done_in_its_condition_only(session) -> None:
    setup = replace(WEARER, cuffs=(), conditions=("unsuited", "slack"))
    pose, _, slack = accepted(setup, 3)
    plan = session(pose, slack, setup=setup)
    assert {(trial.test, trial.condition) for trial in plan.done} == {("pose", None), ("motion", "slack")}
    assert plan.spec is not None and plan.spec.condition == "unsuited"


def test_only_a_redo_of_the_first_static_trial_of_a_donning_loses_migration() -> None:
    trials = (
        recorded("hand", "static"),
        recorded("hand", "dynamic"),
        recorded("hand", "static", 2),
        recorded("hand", "static", donning="2"),
        recorded(None, "static"),
    )
    journal = Journal(SETUP, trials)
    assert [redo_loses_migration(trial, journal) for trial in trials] == [True, False, False, True, False]
    assert not redo_loses_migration(recorded("hand", "static", run=2), journal), "lost already"


@pytest.mark.parametrize(
    ("decision", "donnings", "trial", "later", "is_donned"),
    [
        (REDO, 1, recorded("hand", "static"), None, True),
        (REDO, 2, recorded("hand", "static", donning="2"), recorded("hand", "static"), True),
        (REDO, 1, recorded("hand", "static"), recorded("elbow", "static", donning="2"), True),
        (REDO, 1, recorded("hand", "static"), recorded("hand", "static", donning="2"), False),
        (REDO, 0, recorded("hand", "static"), None, False),
        (REDO, 2, recorded("hand", "static"), None, False),
        (ACCEPT, 1, recorded("hand", "static"), None, False),
        (REDO, 1, recorded(None, "bounce"), None, False),
    ],
    ids=[
        "donned anew",
        "donned anew twice",
        "another cuff recorded since",
        "recorded since",
        "not donned anew",
        "donned anew later",
        "accepted",
        "no cuff",
    ],
)
def test_a_cuff_is_donned_without_a_trial_from_its_redo_to_its_next_recording(
    decision: Decision, donnings: int, trial: Recorded, later: Recorded | None, is_donned: bool
) -> None:
    """An undo of the redo then undoes the donning, too; else later trials would be filed under another donning."""
    trials = (trial,) if later is None else (trial, later)
    journal = Journal(SETUP, trials, {trial.file: decision}, donnings={"hand": donnings} if donnings else {})
    assert is_donned_without_trial(trial, journal) is is_donned


# Names of people are recognised, so that a session is filed under a code; faults of a plan are found.


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
