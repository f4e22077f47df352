import math
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from documents.message import Message
from station.config import StationConfig, parse_config
from station.journal import Decision, Journal, Recorded, Setup
from station.messages.session_messages import CommandCode
from station.protocol import TrialSpec
from station.session.plan_status import (
    PlanStatus,
    check_setup,
    describe_plan,
    is_donned_without_trial,
    is_subject_code,
    kept_recordings,
    load_steps,
    looks_like_a_name,
    minutes_left,
    plan_status,
    preparation,
    redo_loses_migration,
)

SETUP = Setup("P01", "ab", ("hand", "elbow"), 2, has_bounce=False)
ONE_CUFF = replace(SETUP, cuffs=("hand",))
WEARER = replace(SETUP, cuffs=("hand",), repeats=1, conditions=("unsuited", "slack", "tight", "mvc"))
AT_EASE, ON_SPRING = "wearer at ease, arm hanging", "on its spring under the load cell"
ACCEPT, REDO = Decision("accept", ""), Decision("redo", "slipped")
PACED = parse_config({"protocol": {"step_masses_kg": [1, 1], "hold_s": 7, "swing_s": 20, "pause_s": 60}}, "test")
CUFF = {"anchor_markers": ["a", "b", "c"], "cuff_markers": ["d"]}
TWO_CUFFS = parse_config({"cuffs": {"hand": CUFF, "waist": CUFF}}, "test")
WITH_BODY = parse_config({"cuffs": {"hand": CUFF}, "body": {"markers": ["a", "b", "c"], "cycles": 30}}, "test")


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
        (replace(SETUP, has_bounce=True), 0, "bounce calibration", f"Hang the 2.5 kg calibration weight {ON_SPRING}"),
        (SETUP, 0, "hand, static, repeat 1", "Don the hand cuff, rope slack"),
        (ONE_CUFF, 0, "hand, static, repeat 1", "Don the hand cuff, rope slack"),
        (SETUP, 1, "hand, dynamic, repeat 1", "Rope slack, wearer at ease"),
        (SETUP, 2, "hand, static, repeat 2", "Let the wearer rest for 60 s"),
        (SETUP, 3, "hand, dynamic, repeat 2", "Rope slack, wearer at ease"),
        (SETUP, 4, "elbow, static, repeat 1", "Don the elbow cuff, rope slack"),
        (SETUP, 8, None, "The plan is complete"),
        (WEARER, 0, "pose", "Wearer without the suit, all markers on: stand upright, arm hanging"),
        (WEARER, 1, "motion, without the suit", f"Wearer without the suit, all markers on; {AT_EASE}"),
        (WEARER, 2, "motion, maximal contraction", f"Fix the arm for a maximal voluntary contraction; {AT_EASE}"),
        (WEARER, 5, "motion, suit, cord slack", f"Don the suit, cord slack; {AT_EASE}"),
        (WEARER, 6, "motion, suit, cord tight", f"Tighten the cord of the suit; {AT_EASE}"),
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


def test_a_recording_waits_for_its_decision_and_a_redone_trial_is_next_until_it_is_accepted(session) -> None:
    trial, again = recorded("hand", "static"), recorded("hand", "static", run=2)
    plan = session((trial, None))
    assert (plan.undecided, plan.done) == (trial, frozenset())
    assert session((trial, REDO)).spec == plan.trials[0]
    assert session((trial, REDO), (again, ACCEPT)).spec == plan.trials[1]


def test_the_recordings_kept_of_a_trial_are_accepted_and_not_redone() -> None:
    other_places = (recorded("elbow", "static"), recorded("hand", "dynamic"), recorded("hand", "static", 2))
    runs = [recorded("hand", "static", run=run) for run in (1, 2, 3, 4)]
    trials = (*runs, recorded("hand", "static", donning="2"), *other_places)
    verdicts = {trial.file: ACCEPT for trial in trials if trial is not runs[3]}
    journal = Journal(SETUP, trials, verdicts | {runs[0].file: REDO})
    assert kept_recordings(TrialSpec("hand", "static", 1, donning="1"), journal) == runs[1:3]


def test_a_skipped_trial_is_not_next_and_counts_as_skipped_until_it_is_recorded(session) -> None:
    first, second, *_ = session().trials
    skipped = frozenset({first, TrialSpec("forearm", "static", 1, donning="1")})
    plan = session(skipped=skipped)
    assert (plan.skipped, plan.spec) == ({first}, second)
    plan = session((recorded("hand", "static"), ACCEPT), skipped=skipped)
    assert (plan.skipped, plan.done) == (frozenset(), {first})
    plan = session((recorded("hand", "static"), ACCEPT), setup=ONE_CUFF, skipped=frozenset({second}))
    assert [plan.trial_state(trial) for trial in plan.trials] == ["kept", "skipped", "next", "to come"]


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


def test_the_time_left_is_that_of_the_protocol(session) -> None:
    """Two static trials of 5 loads, two dynamic ones of 20 s, one donning, one pause of 60 s, four decisions; after the
    first two, the cuff is worn already.
    """
    journal = Journal(ONE_CUFF)
    assert minutes_left(session(setup=ONE_CUFF), journal, PACED) == round((2 * 5 * 12 + 2 * 20 + 90 + 60 + 80) / 60)
    assert minutes_left(session(*accepted(ONE_CUFF, 4), setup=ONE_CUFF), journal, PACED) == 1
    done = accepted(ONE_CUFF, 2)
    journal = replace(journal, recorded=tuple(trial for trial, _ in done))
    assert minutes_left(session(*done, setup=ONE_CUFF), journal, PACED) == round((5 * 12 + 20 + 60 + 40) / 60)


@pytest.mark.parametrize(
    ("setup", "done", "seconds"),
    [
        (replace(WEARER, cuffs=(), conditions=("unsuited", "slack")), 0, 5 + 2 * 30 * 4 + 3 * 20),
        (replace(SETUP, cuffs=("hand",), repeats=1), 1, 20 + 20),  # though motions are configured
    ],
    ids=["a pose and two motions, a decision on each", "a swing and its decision"],
)
def test_the_time_left_counts_the_pose_and_the_cycles_of_motions_alone(
    session, setup: Setup, done: int, seconds: float
) -> None:
    made = accepted(setup, done)
    journal = Journal(setup, tuple(trial for trial, _ in made))
    assert minutes_left(session(*made, setup=setup), journal, WITH_BODY) == round(seconds / 60)


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


STATIC, SECOND = recorded("hand", "static"), recorded("hand", "static", donning="2")


@pytest.mark.parametrize(
    ("decision", "donnings", "trials", "is_donned"),
    [
        pytest.param(REDO, 1, (STATIC,), True, id="donned anew"),
        pytest.param(REDO, 2, (SECOND, STATIC), True, id="donned anew twice"),
        pytest.param(REDO, 1, (STATIC, recorded("elbow", "static", donning="2")), True, id="another cuff since"),
        pytest.param(REDO, 1, (STATIC, SECOND), False, id="recorded since"),
        pytest.param(REDO, 0, (STATIC,), False, id="not donned anew"),
        pytest.param(REDO, 2, (STATIC,), False, id="donned anew later"),
        pytest.param(ACCEPT, 1, (STATIC,), False, id="accepted"),
        pytest.param(REDO, 1, (recorded(None, "bounce"),), False, id="no cuff"),
    ],
)
def test_a_cuff_is_donned_without_a_trial_from_its_redo_to_its_next_recording(
    decision: Decision, donnings: int, trials: tuple[Recorded, ...], is_donned: bool
) -> None:
    """An undo of the redo then undoes the donning, too; else later trials would be filed under another donning."""
    donned = {"hand": donnings} if donnings else {}
    journal = Journal(SETUP, trials, {trials[0].file: decision}, donnings=donned)
    assert is_donned_without_trial(trials[0], journal) is is_donned


# Names of people are recognised, so that a session is filed under a code; faults of a plan are found.


@pytest.mark.parametrize(
    ("word", "is_name"),
    [(word, True) for word in ("Maria", "smith", "Anna Lee", "de Vries")]
    + [(word, False) for word in ("P01", "S12b", "AB", "x3", "")],
)
def test_a_name_is_recognised_and_a_code_is_none(word: str, is_name: bool) -> None:
    assert looks_like_a_name(word) is is_name


@pytest.mark.parametrize(
    ("word", "is_code"), [("P01", True), ("7", True), ("P" * 32, True), ("P" * 33, False), ("P 1", False), ("", False)]
)
def test_a_code_is_of_ascii_letters_and_digits_that_a_file_name_can_have(word: str, is_code: bool) -> None:
    assert is_subject_code(word) is is_code


@pytest.mark.parametrize(
    ("changed", "fault"),
    [
        ({}, None),
        ({"subject": ""}, Message(CommandCode.NO_SUBJECT)),
        ({"subject": "../P"}, Message(CommandCode.WRONG_SUBJECT, {"subject": "'../P'"})),
        ({"number": "1 "}, Message(CommandCode.WRONG_NUMBER, {"number": "'1 '"})),
        ({"repeats": 0}, Message(CommandCode.WRONG_REPEATS, {"repeats": 0, "most": 1000})),
        ({"repeats": 1000}, None),
        ({"repeats": 1001}, Message(CommandCode.WRONG_REPEATS, {"repeats": 1001, "most": 1000})),
        ({"step_masses_kg": (1.5, 0.25)}, None),
        ({"step_masses_kg": (1.5, 0.0)}, Message(CommandCode.WRONG_MASSES, {"masses": "(1.5, 0.0)"})),
        ({"step_masses_kg": (math.inf,)}, Message(CommandCode.WRONG_MASSES, {"masses": "(inf,)"})),
        ({"step_masses_kg": (math.nan,)}, Message(CommandCode.WRONG_MASSES, {"masses": "(nan,)"})),
        ({"cuffs": ("hand", "waist")}, None),
        ({"cuffs": ()}, Message(CommandCode.NO_CUFF_CHOSEN, {"known": "hand, waist"})),
        ({"cuffs": ("hand", "knee")}, Message(CommandCode.UNKNOWN_CUFF, {"unknown": "knee", "known": "hand, waist"})),
        ({"cuffs": ("hand", "waist", "hand")}, Message(CommandCode.REPEATED_CUFF, {"repeated": "hand"})),
        ({"conditions": ("slack",)}, Message(CommandCode.NO_BODY)),
    ],
)
def test_a_set_up_is_refused_for_its_first_fault(changed: dict[str, Any], fault: Message[CommandCode] | None) -> None:
    assert check_setup(replace(Setup("P01", "", ("hand",), 1), **changed), TWO_CUFFS) == fault


def test_a_session_of_motions_alone_needs_no_cuff() -> None:
    assert check_setup(replace(WEARER, cuffs=()), WITH_BODY) is None


def test_load_steps_of_the_set_up_come_before_those_of_the_configuration() -> None:
    assert load_steps(SETUP, PACED) == (1.0, 1.0)
    assert load_steps(replace(SETUP, step_masses_kg=(2.0,)), PACED) == (2.0,)


@pytest.mark.parametrize(
    ("setup", "text"),
    [
        (SETUP, "2 repeats of hand, elbow with load steps of 1 + 1 kg"),
        (
            replace(WEARER, step_masses_kg=(0.25,)),
            "1 repeat of hand with load steps of 0.25 kg, motions unsuited, slack",
        ),
        (replace(WEARER, cuffs=()), "motions unsuited, slack"),
    ],
)
def test_a_plan_is_described_on_one_line(setup: Setup, text: str) -> None:
    conditions = setup.conditions[:2]
    assert describe_plan(replace(setup, conditions=conditions), PACED) == text
    no_steps = PACED.model_copy(update={"protocol": PACED.protocol.model_copy(update={"step_masses_kg": ()})})
    assert describe_plan(ONE_CUFF, no_steps) == "2 repeats of hand"
