from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from station.journal import Decision, Journal, Recorded, Setup
from station.session.plan_status import PlanStatus, plan_status, preparation, redo_loses_migration

SETUP = Setup("P01", "ab", ("hand", "elbow"), 2, has_bounce=False)
ACCEPT, REDO = Decision("accept", ""), Decision("redo", "slipped")


def recorded(cuff: str, test: str, repeat: int, donning: str = "1", run: int = 1) -> Recorded:
    return Recorded(f"{cuff}-{test}-{repeat}-{donning}-{run}.mcap", cuff, test, repeat, donning, True, 0, "")


@pytest.fixture
def session(tmp_path: Path):
    """Where a session stands after these recordings, each with its verdict or None."""

    def stand(
        *made: tuple[Recorded, Decision | None], setup: Setup = SETUP, donnings: dict[str, int] | None = None
    ) -> PlanStatus:
        for trial, _ in made:
            (tmp_path / trial.file).touch()
        verdicts = {trial.file: verdict for trial, verdict in made if verdict is not None}
        journal = Journal(setup, tuple(trial for trial, _ in made), verdicts, donnings=donnings or {})
        return plan_status(setup, journal, tmp_path)

    return stand


def names(plan: PlanStatus) -> list[str]:
    return [f"{trial.cuff} {trial.test} {trial.repeat}" for trial in plan.trials]


def test_the_plan_is_in_the_order_of_the_cuffs_static_before_dynamic(session) -> None:
    plan = session()
    assert names(plan)[:4] == ["hand static 1", "hand dynamic 1", "hand static 2", "hand dynamic 2"]
    assert len(plan.trials) == 8 and plan.done == frozenset()
    assert plan.spec == plan.trials[0]
    assert plan.is_new_cuff and not plan.has_pause


def test_a_bounce_comes_first_and_needs_no_donning(session) -> None:
    plan = session(setup=replace(SETUP, has_bounce=True))
    assert plan.spec is not None and plan.spec.test == "bounce" and plan.spec.cuff is None
    assert not plan.is_new_cuff and not plan.has_pause


def test_a_recording_waits_for_its_decision(session) -> None:
    trial = recorded("hand", "static", 1)
    plan = session((trial, None))
    assert plan.undecided == trial
    assert plan.done == frozenset()


def test_accepted_trials_are_done_and_the_wearer_rests_between_repeats(session) -> None:
    made = [(recorded("hand", test, 1), ACCEPT) for test in ("static", "dynamic")]
    plan = session(*made)
    assert plan.undecided is None and len(plan.done) == 2
    assert plan.spec == plan.trials[2]
    assert plan.has_pause and not plan.is_new_cuff


def test_a_redone_trial_is_next_until_it_is_accepted(session) -> None:
    first = (recorded("hand", "static", 1), REDO)
    assert session(first).spec == session(first).trials[0]
    assert session(first, (recorded("hand", "static", 1, run=2), ACCEPT)).spec == session().trials[1]


def test_a_cuff_donned_anew_starts_its_repeats_anew(session) -> None:
    plan = session((recorded("hand", "static", 1), ACCEPT), donnings={"hand": 1})
    assert plan.done == frozenset()
    assert plan.spec is not None and (plan.spec.donning, plan.spec.test) == ("2", "static")
    assert plan.is_new_cuff
    assert [trial.donning for trial in plan.trials] == ["2"] * 4 + ["1"] * 4


def test_a_recording_whose_file_is_missing_does_not_count(session, tmp_path: Path) -> None:
    trial = recorded("hand", "static", 1)
    session((trial, ACCEPT))
    (tmp_path / trial.file).unlink()
    journal = Journal(SETUP, (trial,), {trial.file: ACCEPT})
    assert plan_status(SETUP, journal, tmp_path).done == frozenset()


def test_the_next_cuff_is_a_new_one(session) -> None:
    made = [(recorded("hand", test, repeat), ACCEPT) for repeat in (1, 2) for test in ("static", "dynamic")]
    plan = session(*made)
    assert plan.spec is not None and plan.spec.cuff == "elbow"
    assert plan.is_new_cuff and not plan.has_pause


def test_after_the_last_trial_there_is_no_next_one(session) -> None:
    setup = replace(SETUP, cuffs=("hand",), repeats=1)
    made = [(recorded("hand", test, 1), ACCEPT) for test in ("static", "dynamic")]
    plan = session(*made, setup=setup)
    assert plan.spec is None and len(plan.done) == 2


def test_only_a_redo_of_the_first_static_trial_of_a_donning_loses_migration() -> None:
    first, dynamic, second = (
        recorded("hand", "static", 1),
        recorded("hand", "dynamic", 1),
        recorded("hand", "static", 2),
    )
    other = recorded("hand", "static", 1, donning="2")
    journal = Journal(SETUP, (first, dynamic, second, other))
    assert [redo_loses_migration(trial, journal) for trial in journal.recorded] == [True, False, False, True]
    assert not redo_loses_migration(recorded("hand", "static", 1, run=2), journal), "lost already"


def test_the_wearers_trials_are_planned_around_the_cuffs(session) -> None:
    setup = replace(SETUP, cuffs=("hand",), repeats=1, conditions=("unsuited", "slack", "tight"))
    plan = session(setup=setup)
    assert [trial.title for trial in plan.trials] == [
        "pose",
        "motion, without the suit",
        "hand, static, repeat 1",
        "hand, dynamic, repeat 1",
        "motion, suit, cord slack",
        "motion, suit, cord tight",
    ]
    assert not plan.is_new_cuff and preparation(plan, 60.0).startswith("Wearer without the suit")


def test_a_motion_is_done_in_its_condition_only(session) -> None:
    setup = replace(SETUP, cuffs=(), conditions=("unsuited", "slack", "tight"))
    pose = Recorded("pose.mcap", None, "pose", 1, "1", True, 0, "")
    slack = Recorded("slack.mcap", None, "motion", 1, "1", True, 0, "", condition="slack")
    plan = session((pose, ACCEPT), (slack, ACCEPT), setup=setup)
    assert {(trial.test, trial.condition) for trial in plan.done} == {("pose", None), ("motion", "slack")}
    assert plan.spec is not None and plan.spec.condition == "unsuited" and not plan.has_pause
    assert preparation(plan, 60.0).startswith("Wearer without the suit")
    plan = session((pose, ACCEPT), (replace(slack, file="unsuited.mcap", condition="unsuited"), ACCEPT), setup=setup)
    assert plan.spec is not None and plan.spec.condition == "slack"
    assert preparation(plan, 60.0) == "Don the suit, cord slack; wearer at ease, arm hanging"
