"""The demo with a missing part: it reports the rest, names the missing part, and exits with 3."""

import json
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import pytest

from documents.message import Message
from drivers.errors import DeviceUnavailable
from station import demo
from station.assessment.compilation import CompilationAhead
from station.bench.trial_recorder import TrialRefused, TrialResult
from station.demo import RecordedTrial, record_plan
from station.exit_code import LOSSY
from station.journal import read_journal
from station.messages.bench_messages import TrialCode
from station.progress import silent
from station.protocol import TrialSpec, published_plan

GOOD = ""
SILENT = (Message(TrialCode.DEVICE_LOST, {"reason": "QTM went silent", "reason_code": "device_lost.silent"}),)


def test_the_report_is_written_without_the_missing_part(
    given_fit: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    result = TrialResult(None, 0, (), accepted=False)
    failed = RecordedTrial(TrialSpec("hand", "static", 2), result, None, "no edge came")
    monkeypatch.setattr(demo, "record_session", lambda *_: ([failed], {}))
    (tmp_path / "session").mkdir()
    assert demo.run_demo(tmp_path / "session", 30.0, 1, CompilationAhead()) == LOSSY

    page = (tmp_path / "session" / "report.html").read_text(encoding="utf-8")
    printed = capsys.readouterr()
    missing = json.loads((tmp_path / "session" / "missing.json").read_text(encoding="utf-8"))
    assert missing[0] == "hand, static, repeat 2: no edge came"
    assert len(missing) == 2
    for sentence in missing:
        assert sentence in page
        assert f"missing: {sentence}" in printed.err
    assert "waist" in printed.out
    assert printed.out.endswith("report.html\n")


# An unusable trial is recorded a second time, and a missing one is named. The bench is a fake.


@dataclass
class FakeBench:
    """Plays the outcomes in turn, then good ones: a sentence is why the fit cannot use it, an exception is raised."""

    folder: Path
    outcomes: Iterator[object]
    attempts: list[tuple[TrialSpec, bool]] = field(default_factory=list)
    problems: dict[str, str] = field(default_factory=dict)

    def __call__(self, spec: TrialSpec, *, is_new_donning: bool) -> TrialResult:
        self.attempts.append((spec, is_new_donning))
        outcome = next(self.outcomes, GOOD)
        if isinstance(outcome, Exception):
            raise outcome
        if isinstance(outcome, TrialResult) and outcome.path is None:
            return outcome
        path = self.folder / spec.file_name(spec.next_free_run(self.folder))
        path.write_bytes(b"")
        self.problems[path.name] = str(outcome)
        if isinstance(outcome, TrialResult):
            return replace(outcome, path=path)
        return TrialResult(path, 0, (Message(TrialCode.CAPTURE_ENDED),), accepted=True)


class Ran(NamedTuple):
    trials: list[RecordedTrial]
    messages: list[str]
    bench: FakeBench


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def run(*outcomes: object, repeats: int = 1) -> Ran:
        bench, messages = FakeBench(tmp_path, iter(outcomes)), []
        monkeypatch.setattr("station.demo.read_alone", lambda path, _: path.name)
        monkeypatch.setattr("station.demo.find_rejection", lambda name: bench.problems[name])
        plan = list(published_plan(["hand"], repeats, has_bounce=True))
        return Ran(record_plan(tmp_path, plan, bench, messages.append, silent), messages, bench)

    return run


def test_a_plan_without_problems_is_recorded_once_without_messages(run, tmp_path: Path) -> None:
    ran = run(repeats=2)
    assert [trial.problem for trial in ran.trials] == [GOOD] * 5
    assert len(ran.bench.attempts) == 5
    assert [is_new for _, is_new in ran.bench.attempts] == [False, True, False, False, False]
    assert ran.messages == []
    assert not (tmp_path / "session.jsonl").exists()


def test_a_trial_that_is_not_accepted_is_rejected_and_recorded_again(run, tmp_path: Path) -> None:
    ran = run(GOOD, GOOD, TrialResult(tmp_path, 0, SILENT, accepted=False))
    assert [trial.problem for trial in ran.trials] == [GOOD] * 3
    assert ran.trials[2].result.path == tmp_path / "cuff-hand_test-dynamic_run-2.mcap"
    (message,) = ran.messages
    assert "hand, dynamic, repeat 1" in message and "QTM went silent" in message
    assert read_journal(tmp_path).redone == {"cuff-hand_test-dynamic_run-1.mcap": f"not accepted: {SILENT[0]}"}


def test_a_trial_that_the_fit_cannot_use_is_recorded_again(run, tmp_path: Path) -> None:
    ran = run("the bounce hangs still")
    assert ran.trials[0].result.path == tmp_path / "test-bounce_run-2.mcap"
    assert read_journal(tmp_path).redone == {"test-bounce_run-1.mcap": "the bounce hangs still"}
    assert [is_new for _, is_new in ran.bench.attempts] == [False, False, True, False]


def test_the_first_static_trial_is_repeated_on_the_cuff_donned_anew(run, tmp_path: Path) -> None:
    ran = run(GOOD, "does not start unloaded")
    donnings = [(spec.test, spec.donning, is_new) for spec, is_new in ran.bench.attempts[1:]]
    assert donnings == [("static", "1", True), ("static", "2", True), ("dynamic", "2", False)]
    assert read_journal(tmp_path).donnings == {"hand": 1}


def test_a_later_static_trial_is_repeated_in_the_same_donning(run, tmp_path: Path) -> None:
    ran = run(GOOD, GOOD, GOOD, "fewer than three loads", repeats=2)
    assert {spec.donning for spec, _ in ran.bench.attempts} == {"1"}
    assert [is_new for _, is_new in ran.bench.attempts].count(True) == 1
    assert read_journal(tmp_path).donnings == {}


def test_a_trial_that_fails_twice_is_named_and_the_plan_continues_on_a_cuff_donned_anew(run, tmp_path: Path) -> None:
    ran = run(GOOD, "no loads", "no loads again", repeats=2)
    assert [trial.problem for trial in ran.trials] == [GOOD, "no loads again", GOOD, GOOD, GOOD]
    assert ran.messages[1].startswith("hand, static, repeat 1: no loads again")
    assert "missing" in ran.messages[1]
    placed = [(spec.test, spec.repeat, spec.donning, is_new) for spec, is_new in ran.bench.attempts[3:]]
    assert placed == [("dynamic", 1, "3", True), ("static", 2, "3", False), ("dynamic", 2, "3", False)]
    assert read_journal(tmp_path).donnings == {"hand": 2}


@pytest.mark.parametrize("error", [DeviceUnavailable("QTM does not answer"), TrialRefused("the disk is full")])
def test_a_trial_that_cannot_begin_is_tried_twice(run, tmp_path: Path, error: Exception) -> None:
    ran = run(GOOD, error, error)
    assert ran.trials[1].result.path is None
    assert str(error) in ran.trials[1].problem
    assert [spec.donning for spec, _ in ran.bench.attempts] == ["1"] * 4, "nothing was loaded"
    assert read_journal(tmp_path).redone == {}


def test_the_first_recording_still_counts_where_the_second_attempt_records_nothing(run, tmp_path: Path) -> None:
    ran = run(GOOD, GOOD, "too short a swing", TrialResult(None, 0, (Message(TrialCode.CANCELLED),), accepted=False))
    assert str(Message(TrialCode.CANCELLED)) in ran.trials[2].problem
    assert read_journal(tmp_path).redone == {}
