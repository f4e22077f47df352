from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from station.journal import Decision, Journal, Recorded, Setup
from station.session.agenda import Agenda, agenda, redo_loses_migration

SETUP = Setup("P01", "ab", ("hand", "elbow"), 2, has_bounce=False)
ACCEPT, REDO = Decision("accept", ""), Decision("redo", "slipped")


def recorded(cuff: str, test: str, repeat: int, donning: str = "1", run: int = 1) -> Recorded:
    return Recorded(f"{cuff}-{test}-{repeat}-{donning}-{run}.mcap", cuff, test, repeat, donning, True, 0, "")


@pytest.fixture
def session(tmp_path: Path):
    """Where a session stands after these recordings, each with its verdict or None."""

    def stand(
        *made: tuple[Recorded, Decision | None], setup: Setup = SETUP, donnings: dict[str, int] | None = None
    ) -> Agenda:
        for each, _ in made:
            (tmp_path / each.file).touch()
        verdicts = {each.file: verdict for each, verdict in made if verdict is not None}
        journal = Journal(setup, tuple(each for each, _ in made), verdicts, donnings=donnings or {})
        return agenda(setup, journal, tmp_path)

    return stand


def names(plan: Agenda) -> list[str]:
    return [f"{each.cuff} {each.test} {each.repeat}" for each in plan.trials]


def test_the_plan_goes_cuff_by_cuff_static_before_dynamic(session) -> None:
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


def test_what_is_accepted_is_done_and_the_wearer_rests_between_repeats(session) -> None:
    made = [(recorded("hand", test, 1), ACCEPT) for test in ("static", "dynamic")]
    plan = session(*made)
    assert plan.undecided is None and len(plan.done) == 2
    assert plan.spec == plan.trials[2]
    assert plan.has_pause and not plan.is_new_cuff


def test_what_is_redone_comes_again_until_it_is_accepted(session) -> None:
    first = (recorded("hand", "static", 1), REDO)
    assert session(first).spec == session(first).trials[0]
    assert session(first, (recorded("hand", "static", 1, run=2), ACCEPT)).spec == session().trials[1]


def test_a_cuff_donned_anew_starts_its_repeats_anew(session) -> None:
    plan = session((recorded("hand", "static", 1), ACCEPT), donnings={"hand": 1})
    assert plan.done == frozenset()
    assert plan.spec is not None and (plan.spec.donning, plan.spec.test) == ("2", "static")
    assert plan.is_new_cuff
    assert [each.donning for each in plan.trials] == ["2"] * 4 + ["1"] * 4


def test_a_recording_whose_file_is_gone_does_not_count(session, tmp_path: Path) -> None:
    trial = recorded("hand", "static", 1)
    session((trial, ACCEPT))
    (tmp_path / trial.file).unlink()
    journal = Journal(SETUP, (trial,), {trial.file: ACCEPT})
    assert agenda(SETUP, journal, tmp_path).done == frozenset()


def test_the_next_cuff_is_a_new_one(session) -> None:
    made = [(recorded("hand", test, repeat), ACCEPT) for repeat in (1, 2) for test in ("static", "dynamic")]
    plan = session(*made)
    assert plan.spec is not None and plan.spec.cuff == "elbow"
    assert plan.is_new_cuff and not plan.has_pause


def test_after_the_last_trial_nothing_comes(session) -> None:
    setup = replace(SETUP, cuffs=("hand",), repeats=1)
    made = [(recorded("hand", test, 1), ACCEPT) for test in ("static", "dynamic")]
    plan = session(*made, setup=setup)
    assert plan.spec is None and len(plan.done) == 2


def test_only_the_first_static_trial_of_a_donning_takes_migration_along() -> None:
    first, dynamic, second = (
        recorded("hand", "static", 1),
        recorded("hand", "dynamic", 1),
        recorded("hand", "static", 2),
    )
    other = recorded("hand", "static", 1, donning="2")
    journal = Journal(SETUP, (first, dynamic, second, other))
    assert [redo_loses_migration(trial, journal) for trial in journal.recorded] == [True, False, False, True]
    assert not redo_loses_migration(recorded("hand", "static", 1, run=2), journal), "lost already"
