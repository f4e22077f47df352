import shutil
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest
from pytest import approx

import fitting.session
import recordings.reader
from documents.message import Message
from fitting.cuffs.cuff_fit import SessionFit, TrialFit
from fitting.errors import UnusableTrial
from fitting.results.codes import EXPLAINED_BY, NoteCode, Verdict
from fitting.results.sentences import Note
from fitting.results.trial_codes import RejectionCode
from fitting.uncertainty import Estimate
from recordings.chunks import Damage, Entry
from recordings.samples import Event
from station.checksums import JOURNAL_FILE
from station.fit import fit_session_folder
from station.journal import Recorded, write_recorded, write_verdict
from station.messages.bench_messages import TrialCode
from station.messages.session_messages import ReasonCode
from station.session.fitted_judgement import LOADS_MISSING, SWINGING_ENDED, judge_recording
from station.session.judgement import Judgement, judgement_without_fit, notes_at_the_bench
from tests.station.foreign import static_and_dynamic

Judge = Callable[..., Judgement]
FIT = "station.session.fitted_judgement.fit_trial_donning"
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
def refit(fitted: SessionFit, monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """The fit of the cuff is changed."""

    def change(**changes: Any) -> None:
        cuff = replace(fitted.cuffs["hand"], **changes)
        monkeypatch.setattr(FIT, lambda *_: replace(fitted, donnings={"hand": {cuff.donning: cuff}}))

    return change


@pytest.fixture
def judged(session: Path, fitted: SessionFit, refit: Callable[..., None]) -> Judge:
    """The judgement of the static trial where its fit is changed, and other trials of its donning are added."""

    def judge(*others: TrialFit, **changes: Any) -> Judgement:
        trials = fitted.cuffs["hand"].trials
        changed = (replace(trial, **changes) if trial.file == STATIC else trial for trial in trials)
        refit(trials=(*changed, *others))
        return judge_recording(session, STATIC)

    return judge


def codes(judgement: Judgement) -> list[ReasonCode]:
    return [reason.code for reason in judgement.reasons]


def estimate(value: float, error: float) -> Estimate:
    return Estimate(value, error, (value - 2 * error, value + 2 * error))


def of(fitted: SessionFit, file: str) -> TrialFit:
    (trial,) = [trial for trial in fitted.cuffs["hand"].trials if trial.file == file]
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


@pytest.mark.parametrize(
    ("changes", "code", "figures"),
    [
        ({"test": "static", "stiffness": None, "damping": None}, ReasonCode.NO_STATIC_RESULT, {}),
        ({"test": "dynamic", "stiffness": None, "damping": None}, ReasonCode.NO_DYNAMIC_RESULT, {}),
        ({"zero_drift": 5.0}, ReasonCode.ZERO_DRIFT, {}),
        ({"migration": estimate(0.031, 0.0001)}, ReasonCode.SLIPPED, {"slip_mm": approx(31), "limit_mm": 25.0}),
    ],
)
def test_a_trial_without_a_result_with_slip_or_drift_is_to_be_redone(
    judged: Judge, changes: dict[str, Any], code: ReasonCode, figures: dict[str, Any]
) -> None:
    judgement = judged(**changes)
    (reason,) = judgement.reasons
    assert (judgement.advice, reason.code) == ("redo", code)
    assert {name: reason.figures[name] for name in figures} == figures


def test_a_repeat_that_differs_from_the_earlier_ones_has_its_distance(judged: Judge, fitted: SessionFit) -> None:
    mine = of(fitted, STATIC)
    assert mine.stiffness is not None
    theirs = estimate(1.2 * mine.stiffness.value, mine.stiffness.standard_error)
    others = [replace(mine, file=f"{number}.mcap", repeat=number, stiffness=theirs) for number in (2, 3)]
    judgement = judged(*others)
    assert judgement.advice == "redo"
    (reason,) = judgement.reasons
    assert (reason.code, reason.figures["symbol"]) == (ReasonCode.OUTLIER, "k")
    assert reason.figures["mean"] == f"{theirs.value:.0f}"
    assert judgement.rows[0].earlier == ", ".join([f"{theirs.value:.0f}"] * 2)


def test_a_static_trial_that_ended_under_load_says_after_how_many_weights(
    session: Path, refit: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its stiffness is identified, but not its migration."""
    refit(verdicts=(Verdict.NOT_UNLOADED,))
    assert judge_recording(session, STATIC).reasons == (), "a whole trial ends unloaded; another one did not"
    cause = Message(ReasonCode.WEIGHTS_MISSING, {"found": 2, "planned": 5})
    monkeypatch.setattr("station.session.fitted_judgement.find_unfinished", lambda _: cause)
    judgement = judge_recording(session, STATIC)
    assert (judgement.advice, judgement.reasons, judgement.verdicts) == ("redo", (cause,), ())
    assert judge_recording(session, DYNAMIC).advice == "accept"


def test_an_earlier_trial_that_ended_early_leads_the_doubts_of_a_later_one(
    session: Path, refit: Callable[..., None]
) -> None:
    note = Note(NoteCode.STOPPED_LOADING, {"file": STATIC, "repeat": 1, "count": 3, "total": 5})
    verdicts = (Verdict.ONLY_ROSE, Verdict.NOT_UNLOADED, Verdict.LAG)
    refit(verdicts=verdicts, notes=(note,))
    later = judge_recording(session, DYNAMIC)
    assert later.doubts == (str(note), Verdict.LAG.sentence()) and later.verdicts == verdicts
    itself = judge_recording(session, STATIC)
    assert itself.reasons == (Message(ReasonCode.WEIGHTS_MISSING, {"found": 3, "planned": 5}),)
    assert (itself.advice, itself.doubts) == ("redo", ())
    refit(verdicts=verdicts, notes=(replace(note, code=NoteCode.HIDDEN_LOADS),))
    assert codes(judge_recording(session, STATIC)) == [ReasonCode.LOADS_HIDDEN]


def test_every_early_end_of_a_trial_has_a_reason_to_redo_it() -> None:
    assert {*LOADS_MISSING, *SWINGING_ENDED} == set(EXPLAINED_BY)


def test_only_a_checked_recording_without_a_problem_is_good(session: Path, refit: Callable[..., None]) -> None:
    for verdicts, grade in (
        ((Verdict.IDENTIFIED,), "good"),
        ((Verdict.NO_DYNAMIC,), "good"),  # the dynamic trial is still to come
        ((Verdict.NOT_UNLOADED,), "doubtful"),
        ((Verdict.NO_DYNAMIC, Verdict.MIGRATED_BEFORE), "doubtful"),
    ):
        refit(verdicts=verdicts)
        assert judge_recording(session, STATIC).grade == grade
    assert judgement_without_fit("a.mcap").grade == "doubtful"
    assert replace(judge_recording(session, STATIC), advice="redo").grade == "bad"


def test_repeats_that_agree_are_accepted_and_a_replaced_one_is_not_compared(judged: Judge, fitted: SessionFit) -> None:
    mine = of(fitted, STATIC)
    assert judged(replace(mine, file="2.mcap", repeat=2)).advice == "accept"
    assert judged(replace(mine, file="2.mcap", state="superseded", stiffness=estimate(1.0, 0.1))).advice == "accept"


def test_the_step_at_which_a_trial_ended_leads_and_its_consequences_are_notes(
    judged: Judge, monkeypatch: pytest.MonkeyPatch
) -> None:
    cause = Message(ReasonCode.WEIGHTS_MISSING, {"found": 2, "planned": 5})
    monkeypatch.setattr("station.session.fitted_judgement.find_unfinished", lambda _: cause)
    judgement = judged(stiffness=None, damping=None)
    assert judgement.reasons == (cause,) and judgement.verdicts == ()
    assert judgement.notes[0] == str(Message(ReasonCode.NO_STATIC_RESULT))


def test_a_dynamic_trial_whose_lag_is_unknown_is_doubtful_and_not_redone(
    session: Path, fitted: SessionFit, refit: Callable[..., None]
) -> None:
    """The lag is the same in every repeat: a bounce is needed."""
    trials = fitted.cuffs["hand"].trials
    without = tuple(replace(trial, damping=None) if trial.file == DYNAMIC else trial for trial in trials)
    refit(trials=without, verdicts=(Verdict.LAG,))
    judgement = judge_recording(session, DYNAMIC)
    assert (judgement.advice, judgement.grade, judgement.reasons) == ("accept", "doubtful", ())
    assert judgement.verdicts == (Verdict.LAG,)


def test_an_unusable_trial_has_its_reason(judged: Judge) -> None:
    judgement = judged(state="unusable", reason=Note(RejectionCode.NO_MOTION))
    figures = {"reason": str(Note(RejectionCode.NO_MOTION)), "reason_code": "rejected.no_motion"}
    assert (judgement.advice, judgement.reasons) == ("redo", (Message(ReasonCode.UNUSABLE, figures),))


class Work:
    """Cost of a verdict: complete passes over files, and fits of donnings."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.passes: Counter[str] = Counter()
        self.fit = Mock(wraps=fitting.session.fit_donning)
        read_entries = recordings.reader.read_entries

        def count_pass(path: Path) -> Iterator[Entry | Damage]:
            yield from read_entries(path)
            self.passes[path.name] += 1  # reading a manifest stops before the end

        monkeypatch.setattr("recordings.reader.read_entries", count_pass)
        monkeypatch.setattr("fitting.session.fit_donning", self.fit)


@pytest.mark.slow
def test_the_cost_of_a_verdict_does_not_grow_with_the_session(
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
    assert work.passes == {STATIC: 1, DYNAMIC: 1}
    assert work.fit.call_count == 1


def test_a_session_is_fitted_in_one_pass_over_each_of_its_recordings(
    session: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    work = Work(monkeypatch)
    fit_session_folder(session, None)
    assert (work.passes, work.fit.call_count) == ({STATIC: 1, DYNAMIC: 1}, 1)


def test_marks_are_counted_in_the_pass_that_reads_the_trial(session: Path, tmp_path: Path) -> None:
    (truth, _) = static_and_dynamic()
    truth.record(tmp_path / STATIC, [Event("mark", f"mark {number}", 0, "station") for number in (1, 2)])
    assert judge_recording(tmp_path, STATIC).marks == 2
    assert judge_recording(session, STATIC).marks == 0


@pytest.fixture
def journal(session: Path) -> Iterator[Path]:
    """The journal of the session, as it was before when the test ends."""
    path = session / JOURNAL_FILE
    content = path.read_bytes()
    yield path
    path.write_bytes(content)


def test_a_trial_that_the_recorder_did_not_accept_has_the_reason_of_the_recorder(
    session: Path, judged: Judge, journal: Path
) -> None:
    write_recorded(session, Recorded(STATIC, "hand", "static", 1, "1", False, 12, "NI Dev1 is gone: unplugged"))
    not_accepted = Message(ReasonCode.NOT_ACCEPTED, {"reason": "NI Dev1 is gone: unplugged"})
    assert judged().reasons == (not_accepted, Message(ReasonCode.LOST_SAMPLES, {"samples": 12}))


@pytest.mark.parametrize("test", ["bounce", "static"])
def test_the_reason_of_the_recorder_comes_first_where_nothing_is_fitted(
    tmp_path: Path, test: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The disk was full: the bounce is too short for that, or the file ends before its header."""

    unusable = Mock(side_effect=UnusableTrial(RejectionCode.NO_MOTION))
    if test == "bounce":
        monkeypatch.setattr("station.session.fitted_judgement.read_recording", unusable)
    (tmp_path / "a.mcap").write_text("no recording\n")
    cuff = None if test == "bounce" else "hand"
    failed = (Message(TrialCode.WRITE_FAILED, {"reason": "No space left on device"}),)
    write_recorded(tmp_path, Recorded("a.mcap", cuff, test, 1, "1", False, 0, "No space left on device", codes=failed))
    judgement = judge_recording(tmp_path, "a.mcap")
    assert (judgement.advice, codes(judgement)) == ("redo", [ReasonCode.NOT_ACCEPTED, ReasonCode.UNUSABLE])
    assert judgement.reasons[0].figures["reason"] == "No space left on device"


def test_a_trial_that_was_not_accepted_has_one_reason(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The fit refuses it for the reason of the recorder, which its file has, too."""
    lost = "NI Dev1 is gone: unplugged"
    refused = Mock(side_effect=UnusableTrial(RejectionCode.NOT_ACCEPTED, {"outcome": lost}))
    monkeypatch.setattr("station.session.fitted_judgement.read_recording", refused)
    write_recorded(tmp_path, Recorded("a.mcap", "hand", "static", 1, "1", False, 0, lost))
    assert judge_recording(tmp_path, "a.mcap").reasons == (Message(ReasonCode.NOT_ACCEPTED, {"reason": lost}),)


def test_the_fit_of_a_trial_whose_recorder_was_killed_gives_notes_and_no_reasons(
    session: Path, judged: Judge, journal: Path
) -> None:
    """It lacks its last steps because of the kill, not because the operator left them out."""
    killed = Message(TrialCode.RECORDER_KILLED, {"kept_s": 15.0, "details": "damage at byte 185500"})
    write_recorded(session, Recorded(STATIC, "hand", "static", 1, "1", False, 0, str(killed), codes=(killed,)))
    judgement = judged(stiffness=None, damping=None)
    assert judgement.reasons == (Message(ReasonCode.NOT_ACCEPTED, {"reason": str(killed)}),)
    assert (judgement.advice, judgement.doubts) == ("redo", ())
    assert judgement.notes[:2] == ("damage at byte 185500", str(Message(ReasonCode.NO_STATIC_RESULT)))


def test_a_file_that_is_not_a_recording_is_a_reason_and_not_an_error(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_text("no recording\n")
    judgement = judge_recording(tmp_path, "a.mcap")
    assert (judgement.advice, codes(judgement)) == ("redo", [ReasonCode.UNUSABLE])


def test_a_rejected_recording_is_judged_as_rejected(session: Path, journal: Path) -> None:
    write_verdict(session, DYNAMIC, "redo", "the wearer coughed")
    judgement = judge_recording(session, DYNAMIC)
    assert codes(judgement) == [ReasonCode.UNUSABLE] and "the wearer coughed" in str(judgement.reasons[0])


def test_an_unexpected_error_keeps_the_recording(session: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(FIT, Mock(side_effect=ZeroDivisionError("oh")))
    judgement = judge_recording(session, STATIC)
    assert judgement.advice == "accept"
    assert judgement.reasons == (Message(ReasonCode.FIT_FAILED, {"reason": "ZeroDivisionError: oh"}),)


def test_a_note_on_the_holds_is_shown_with_static_trials_only() -> None:
    holds = Note(NoteCode.SHORT_HOLDS, {"hold_s": 3.7})
    warm_up = Note(NoteCode.ZERO_DRIFT, {"drift_n_per_s": 0.01})
    for_the_report = Note(NoteCode.STIFFNESS_RATIO, {"ratio": 1.2})
    notes = (holds, warm_up, for_the_report)
    assert notes_at_the_bench(notes, "static") == (str(holds), str(warm_up))
    assert notes_at_the_bench(notes, "dynamic") == (str(warm_up),)
