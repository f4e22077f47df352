"""The demo with a missing part: it reports the rest, names the missing part, and exits with 3."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from fitting.cuffs.cuff_fit import SessionFit
from fitting.cuffs.cuffs_json import cuffs_json
from fitting.session import fit_session
from fitting.trial.trial import build_trial
from station import demo
from station.assessment.compilation import CompilationAhead
from station.bench.trial_recorder import TrialResult
from station.demo import RecordedTrial
from station.exit_code import LOSSY
from station.protocol import TrialSpec
from tests.fitting.experiment import Session, published


@pytest.fixture(scope="module")
def fitted() -> SessionFit:
    """A waist cuff and no arm cuff, as if every trial of the arm cuff had failed."""
    session = Session(published("waist", hold=4.0, duration=12.0), 3)
    return fit_session([build_trial(*session.static(), "s", "s"), build_trial(*session.dynamic(), "d", "d")])


def test_the_report_is_written_without_the_missing_part(
    fitted: SessionFit, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    failed = RecordedTrial(
        TrialSpec("hand", "static", 2), TrialResult(None, 0, (), accepted=False), None, "no edge came"
    )

    def fit(_folder: Path, output: Path, *_: object) -> SessionFit:
        output.write_text(cuffs_json(fitted), encoding="utf-8")
        return fitted

    monkeypatch.setattr(demo, "record_session", lambda *_: ([failed], {}))
    monkeypatch.setattr("station.fit.fit_session_folder", fit)
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
