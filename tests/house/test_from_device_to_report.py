"""The one test to run: from simulated devices on real wires to the report, with cuffs that are not published."""

import json
import sys
from pathlib import Path

import pytest

from station.assessment.assess import assess_cuffs, write_assessment
from station.assessment.assessment_inputs import AssessmentInputs
from station.cli import main
from station.config import parse_config
from station.demo import demo_config, record_session
from station.fit import fit_session_folder
from station.progress import silent
from station.report.page import write_report

TRUTH = {
    "waist": {"stiffness_n_per_m": 2140.0, "damping_n_s_per_m": 124.0, "migration_m": 0.012},
    "hand": {"stiffness_n_per_m": 8520.0, "damping_n_s_per_m": 210.0, "migration_m": 0.012},
    "elbow": {"stiffness_n_per_m": 3300.0, "damping_n_s_per_m": 95.0, "migration_m": 0.006},
}
"""Two cuffs as published; the elbow is our own, so that no result can be a memory of the published figures."""


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session of one repeat per cuff, with shorter holds than a person would take."""
    folder = tmp_path_factory.mktemp("session")
    plain = demo_config().model_dump()
    plain["cuffs"] = {name: plain["cuffs"][name] for name in TRUTH}
    plain["protocol"] = {"repeats": 1, "pause_s": 0, "hold_s": 4.0, "step_masses_kg": [2.5] * 3}
    plain["simulation"] = {"cuffs": TRUTH, "protocol": {"dynamic": {"swing_s": 15.0}}}
    trials, _ = record_session(folder, parse_config(plain, "test"), None, 7, silent)
    results = [trial.result for trial in trials]
    assert [result.sentence for result in results if not result.accepted or result.lost_samples] == []
    assert [trial.problem for trial in trials if trial.problem] == []
    return folder


def test_a_session_becomes_cuffs_within_two_percent_and_a_report_of_what_they_do(session: Path) -> None:
    fitted = fit_session_folder(session, session / "cuffs.json")
    for name, truth in TRUTH.items():
        fit = fitted.cuffs[name]
        assert fit.stiffness and fit.damping and fit.migration, fit.verdict
        assert fit.stiffness.value == pytest.approx(truth["stiffness_n_per_m"], rel=0.02)
        assert fit.migration.value == pytest.approx(truth["migration_m"], abs=0.0008)
        low, high = fit.damping.ci95
        assert low - 0.5 * (high - low) < truth["damping_n_s_per_m"] < high + 0.5 * (high - low)

    inputs = AssessmentInputs(session / "cuffs.json")
    assessed = assess_cuffs(
        {name: fit.wearable() for name, fit in fitted.cuffs.items()}, inputs, most_frames=12, most_rest_lengths=16
    )
    write_assessment(assessed, session)
    plain = json.loads((session / "assessment.json").read_text(encoding="utf-8"))
    assert plain["origin"] == json.loads((session / "cuffs.json").read_text(encoding="utf-8"))["origin"] == "simulated"
    assert assessed.assessment.unsolved == 0
    assert plain["at_rigid_optimum"]["rigid"]["value"] < 1, "a suit with rigid cuffs saves effort at its rest length"
    assert set(plain["optimum"]) == {"rigid", "hand", "elbow"}

    page = write_report(session, fitted).read_text(encoding="utf-8")
    assert page.count("<figcaption>") == 2 * 3 + 2 + 5, "two of each cuff, one of each motion, five of the suit"
    assert page.count('<p class="banner">Simulated data.') == 1
    assert "http://" not in page and "https://" not in page, "self-contained"


def test_a_fit_of_a_cut_recording_is_lossy(session: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    name = "cuff-waist_test-static_run-1.mcap"
    content = (session / name).read_bytes()
    codes = []
    for kept in (len(content), len(content) * 9 // 10):
        (tmp_path / name).write_bytes(content[:kept])
        monkeypatch.setattr(sys, "argv", ["station", "fit", str(tmp_path), "--format", "json"])
        with pytest.raises(SystemExit) as ended:
            main()
        codes.append(ended.value.code)
    assert codes == [0, 3]
