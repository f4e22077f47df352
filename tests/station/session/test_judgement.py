from __future__ import annotations

import shutil
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import fitting.session
import recordings.reader
from fitting.result import SessionFit, TrialFit
from fitting.results.codes import Verdict
from fitting.uncertainty import Estimate
from recordings.chunks import Damage, Entry
from recordings.samples import Event
from station.fit import fit_session_folder
from station.journal import Recorded, write_recorded, write_verdict
from station.session.judgement import Judgement, judge_recording, unjudged
from tests.station.foreign import static_and_dynamic

STATIC, DYNAMIC = (f"cuff-hand_test-{test}_run-1.mcap" for test in ("static", "dynamic"))


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A static and a dynamic recording of one cuff, each with its recorder's account."""
    folder = tmp_path_factory.mktemp("session")
    for truth, file in zip(static_and_dynamic(), (STATIC, DYNAMIC), strict=True):
        truth.record(folder / file)
        write_recorded(folder, Recorded(file, "hand", truth.manifest.test, 1, "1", True, 0, "the mocap capture ended"))
    return folder


@pytest.fixture(scope="module")
def fitted(session: Path) -> SessionFit:
    return fit_session_folder(session, None)


@pytest.fixture
def judged(session: Path, fitted: SessionFit, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Judgement]:
    """The judgement of the static trial where its fit is changed, and other trials of its donning are added."""

    def judge(*others: TrialFit, **change: object) -> Judgement:
        cuff = fitted.cuffs["hand"]
        trials = [replace(each, **change) if each.file == STATIC else each for each in cuff.trials]  # type: ignore[arg-type]
        changed = replace(cuff, trials=(*trials, *others))
        donnings = {"hand": {cuff.donning: changed}}
        monkeypatch.setattr("station.session.judgement.fit_donning_of", lambda *_: replace(fitted, donnings=donnings))
        return judge_recording(session, STATIC)

    return judge


def estimate(value: float, error: float) -> Estimate:
    return Estimate(value, error, (value - 2 * error, value + 2 * error))


def of(fitted: SessionFit, file: str) -> TrialFit:
    (trial,) = [each for each in fitted.cuffs["hand"].trials if each.file == file]
    return trial


def test_a_good_trial_is_shown_with_its_figures_and_accepted(session: Path, fitted: SessionFit) -> None:
    judgement = judge_recording(session, STATIC)
    assert (judgement.title, judgement.advice, judgement.reasons) == ("hand, static, repeat 1", "accept", ())
    stiffness, _, migration = judgement.rows
    trial = of(fitted, STATIC)
    assert trial.stiffness is not None
    assert stiffness.quantity == "k [N/m]" and stiffness.this.startswith(f"{trial.stiffness.value:.0f} (")
    assert migration.quantity == "migration [mm]" and migration.so_far != "-"
    assert 100 < len(judgement.path) <= 400
    assert max(force for _, force in judgement.path) > 20


def test_a_cuff_that_slipped_is_to_be_redone_and_told_what_to_do(judged: Callable[..., Judgement]) -> None:
    judgement = judged(migration=estimate(0.031, 0.0001))
    assert judgement.advice == "redo"
    assert judgement.reasons[0].startswith("the cuff slipped by 31 mm in this trial, more than any cuff should (25 mm)")


def test_a_repeat_that_differs_from_the_earlier_ones_is_told_by_how_much(
    judged: Callable[..., Judgement], fitted: SessionFit
) -> None:
    mine = of(fitted, STATIC)
    assert mine.stiffness is not None
    theirs = estimate(1.2 * mine.stiffness.value, mine.stiffness.standard_error)
    others = [replace(mine, file=f"{number}.mcap", repeat=number, stiffness=theirs) for number in (2, 3)]
    judgement = judged(*others)
    assert judgement.advice == "redo"
    assert "the earlier repeats say" in judgement.reasons[0] and "standard errors apart" in judgement.reasons[0]
    assert judgement.rows[0].earlier == ", ".join([f"{theirs.value:.0f}"] * 2)


def test_good_is_only_what_was_checked_and_is_right(
    session: Path, fitted: SessionFit, monkeypatch: pytest.MonkeyPatch
) -> None:
    cuff = fitted.cuffs["hand"]

    def grade_of(*verdicts: Verdict) -> str:
        donnings = {"hand": {cuff.donning: replace(cuff, verdicts=verdicts)}}
        monkeypatch.setattr("station.session.judgement.fit_donning_of", lambda *_: replace(fitted, donnings=donnings))
        return judge_recording(session, STATIC).grade

    assert grade_of(Verdict.IDENTIFIED) == "good"
    assert grade_of(Verdict.NO_DYNAMIC) == "good", "the dynamic trial is still to come"
    assert grade_of(Verdict.NOT_UNLOADED) == grade_of(Verdict.NO_DYNAMIC, Verdict.MIGRATED_BEFORE) == "doubtful"
    assert unjudged("a.mcap").grade == "doubtful"
    assert replace(judge_recording(session, STATIC), advice="redo").grade == "bad"


def test_repeats_that_agree_speak_for_each_other(judged: Callable[..., Judgement], fitted: SessionFit) -> None:
    assert judged(replace(of(fitted, STATIC), file="2.mcap", repeat=2)).advice == "accept"


def test_a_repeat_that_was_superseded_is_not_compared_with(
    judged: Callable[..., Judgement], fitted: SessionFit
) -> None:
    mine = of(fitted, STATIC)
    assert judged(replace(mine, file="2.mcap", state="superseded", stiffness=estimate(1.0, 0.1))).advice == "accept"


@pytest.mark.parametrize(("test", "remedy"), [("static", "every step"), ("dynamic", "once a second")])
def test_a_trial_that_gives_nothing_says_what_to_do_in_the_next(
    judged: Callable[..., Judgement], test: str, remedy: str
) -> None:
    told = judged(test=test, stiffness=None, damping=None)
    assert told.advice == "redo" and any(remedy in reason for reason in told.reasons)


def test_an_unusable_trial_says_why(judged: Callable[..., Judgement]) -> None:
    judgement = judged(state="unusable", reason="the rope was slack all the time")
    assert (judgement.advice, judgement.reasons) == ("redo", ("the rope was slack all the time",))


class Work:
    """What a verdict costs: passes over files, and fits of donnings."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.passes: Counter[str] = Counter()
        self.fits = 0
        read_entries, fit_donning = recordings.reader.read_entries, fitting.session.fit_donning

        def count_pass(path: Path) -> Iterator[Entry | Damage]:
            self.passes[path.name] += 1
            return read_entries(path)

        def count_fit(*arguments: Any) -> Any:
            self.fits += 1
            return fit_donning(*arguments)

        monkeypatch.setattr("recordings.reader.read_entries", count_pass)
        monkeypatch.setattr("fitting.session.fit_donning", count_fit)


def test_a_verdict_costs_what_its_donning_costs_however_long_the_session_is(
    session: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = Path(shutil.copytree(session, tmp_path / "session"))
    alone = judge_recording(folder, DYNAMIC)
    work = Work(monkeypatch)
    for number in (2, 3, 4):
        for truth in static_and_dynamic():
            manifest = replace(truth.manifest, donning=str(number), run=number)
            file = f"cuff-hand_test-{manifest.test}_run-{number}.mcap"
            replace(truth, manifest=manifest).record(folder / file)
            if number < 4:  # the last of them is not in the journal
                write_recorded(folder, Recorded(file, "hand", manifest.test, 1, str(number), True, 0, "it ended"))
    write_verdict(folder, "cuff-hand_test-static_run-2.mcap", "redo", "the wearer coughed")
    assert judge_recording(folder, DYNAMIC) == alone, "and it is the same verdict"
    not_in_the_journal = {f"cuff-hand_test-{test}_run-4.mcap": 1 for test in ("static", "dynamic")}  # its manifest
    assert work.passes == {STATIC: 1, DYNAMIC: 1, **not_in_the_journal}
    assert work.fits == 1


def test_a_session_is_fitted_in_one_pass_over_each_of_its_recordings(
    session: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    work = Work(monkeypatch)
    fit_session_folder(session, None)
    assert (work.passes, work.fits) == ({STATIC: 1, DYNAMIC: 1}, 1)


def test_marks_are_counted_in_the_pass_that_reads_the_trial(session: Path, tmp_path: Path) -> None:
    (truth, _) = static_and_dynamic()
    truth.record(tmp_path / STATIC, [Event("mark", f"mark {number}", 0, "station") for number in (1, 2)])
    assert judge_recording(tmp_path, STATIC).marks == 2
    assert judge_recording(session, STATIC).marks == 0


def test_what_the_recorder_said_counts_against_it(session: Path, judged: Callable[..., Judgement]) -> None:
    lost = Recorded(STATIC, "hand", "static", 1, "1", False, 12, "NI Dev1 is gone: unplugged")
    journal = (session / "session.jsonl").read_bytes()
    write_recorded(session, lost)
    try:
        reasons = judged().reasons
    finally:
        (session / "session.jsonl").write_bytes(journal)
    assert reasons == ("NI Dev1 is gone: unplugged", "12 samples were lost on the way")


def test_a_file_that_is_no_recording_is_told_and_not_raised(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_text("no recording\n")
    judgement = judge_recording(tmp_path, "a.mcap")
    assert judgement.advice == "redo" and "a.mcap" in judgement.reasons[0]


def test_a_recording_that_is_set_aside_is_judged_by_that(session: Path) -> None:
    journal = (session / "session.jsonl").read_bytes()
    write_verdict(session, DYNAMIC, "redo", "the wearer coughed")
    try:
        judgement = judge_recording(session, DYNAMIC)
    finally:
        (session / "session.jsonl").write_bytes(journal)
    assert judgement.reasons == ("set aside by the operator: the wearer coughed",)


def test_a_fault_of_ours_keeps_the_recording(session: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise ZeroDivisionError("oh")

    monkeypatch.setattr("station.session.judgement.fit_donning_of", fail)
    judgement = judge_recording(session, STATIC)
    assert judgement.advice == "accept" and "ZeroDivisionError: oh" in judgement.reasons[0]


def test_a_zero_that_moved_speaks_against_the_trial(judged: Callable[..., Judgement]) -> None:
    judgement = judged(zero_drift=5.0)
    assert judgement.advice == "redo"
    assert any("the force at rest changed by +5.00 N" in reason for reason in judgement.reasons)
