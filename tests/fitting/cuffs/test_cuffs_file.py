"""cuffs.json, written and read."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fitting.cuffs.cuff_fit import CuffFit, SessionFit
from fitting.cuffs.cuffs_file import cuffs_json, read_cuffs
from fitting.cuffs.wearable_cuff import Cuff, joint_covariance
from fitting.results.codes import FitErrorCode, NoteCode, Verdict
from fitting.results.sentences import Note
from fitting.results.trial_codes import RejectionCode
from fitting.trial.trial import RejectedTrial
from fitting.uncertainty import Estimate
from tests.refusals import raises_refusal

K, C, M = (
    Estimate(8520.0, 10.0, (8500.0, 8540.0), {"noise": 8.0, "between_repeats": 6.0}, 8.0),
    Estimate(210.0, 6.0, (198.0, 222.0)),
    Estimate(0.012, 1e-5, (0.0119, 0.0121)),
)


def _fit(donning: str = "1", damping: Estimate | None = C, verdict: Verdict = Verdict.IDENTIFIED) -> CuffFit:
    covariance = joint_covariance((K, damping, M))
    return CuffFit("hand", "arm", donning, K, damping, M, (verdict,), covariance, {"a.mcap": "abc"})


def _session(*fits: CuffFit) -> SessionFit:
    return SessionFit(
        {"hand": {fit.donning: fit for fit in fits}},
        (RejectedTrial("x.mcap", Note(RejectionCode.UNREADABLE, {"problem": "is empty"})),),
    )


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "cuffs.json"


def _read(path: Path, content: str | dict[str, Any]) -> dict[str, Cuff]:
    """The cuffs of a file with this text or document."""
    path.write_text(content if isinstance(content, str) else json.dumps(content), encoding="utf-8")
    return read_cuffs(path)


def _plain(*fits: CuffFit) -> dict[str, Any]:
    document: dict[str, Any] = json.loads(cuffs_json(_session(*fits)))
    return document


def test_what_is_written_is_read_back(path: Path) -> None:
    read = _read(path, cuffs_json(_session(_fit())))["hand"]
    assert (read.stiffness, read.damping, read.migration) == (K, C, M)
    assert read.verdicts == (Verdict.IDENTIFIED,)
    parameters = read.parameters()
    assert (parameters.stiffness, parameters.damping, parameters.migration) == (8520.0, 210.0, 0.012)
    np.testing.assert_allclose(np.diag(parameters.covariance), [100.0, 36.0, 1e-10])
    assert parameters.source == "abc"


def test_the_file_has_the_keys_others_rely_on_and_the_latest_donning_at_the_top() -> None:
    cuff = _plain(_fit())["cuffs"]["hand"]
    assert cuff["stiffness_n_per_m"] == {
        "value": 8520.0,
        "standard_error": 10.0,
        "ci95": [8500.0, 8540.0],
        "parts": {"noise": 8.0, "between_repeats": 6.0},
        "cramer_rao_bound": 8.0,
    }
    assert set(cuff) >= {"damping_n_s_per_m", "migration_m", "verdict", "donnings", "trials", "sources"}
    cuff = _plain(_fit("1"), _fit("2"))["cuffs"]["hand"]
    assert cuff["donning"] == "2"
    assert list(cuff["donnings"]) == ["1", "2"]


def test_what_is_not_identified_is_null_and_the_verdict_says_why(path: Path) -> None:
    plain = _plain(_fit(damping=None, verdict=Verdict.LAG))
    cuff = plain["cuffs"]["hand"]
    assert cuff["damping_n_s_per_m"] == {"value": None, "standard_error": None, "ci95": None}
    assert cuff["verdict_codes"] == ["damping_not_identified.lag"]
    assert cuff["verdict"] == Verdict.LAG.sentence()
    with raises_refusal(FitErrorCode.NOT_IDENTIFIED, cuff="hand", missing="damping", verdict=Verdict.LAG.sentence()):
        _read(path, plain)["hand"].parameters()


def test_what_noise_leaves_open_is_null_beside_its_figure_and_cannot_be_worn(path: Path) -> None:
    wide = Estimate(210.0, 120.0, (-25.0, 445.0))
    plain = _plain(_fit(damping=wide, verdict=Verdict.LAG))
    written = plain["cuffs"]["hand"]
    plain["cuffs"]["hand"]["verdict"] = "another sentence"  # the code decides
    assert written["damping_n_s_per_m"] == {"value": None, "standard_error": None, "ci95": None}
    assert written["not_identified"]["damping_n_s_per_m"]["ci95"] == [-25.0, 445.0]
    read = _read(path, plain)["hand"]
    assert read.damping == wide
    assert (read.verdicts, read.missing) == ((Verdict.LAG,), ("damping",))
    with raises_refusal(FitErrorCode.NOT_IDENTIFIED, cuff="hand", missing="damping"):
        read.parameters()


def test_a_trial_that_ended_early_does_not_lead_the_verdict_of_a_value_given_by_hand(path: Path) -> None:
    note = Note(NoteCode.STOPPED_SWINGING, {"file": "a.mcap", "repeat": 1, "found_s": 6.0, "planned_s": 20.0})
    plain = _plain(replace(_fit(verdict=Verdict.DAMPING_UNCERTAIN), notes=(note,)))
    assert _read(path, plain)["hand"].verdict == str(note)
    plain["cuffs"]["hand"]["damping_n_s_per_m"] = 210.0
    assert _read(path, plain)["hand"].verdict == Verdict.GIVEN.sentence()


@pytest.mark.parametrize(
    ("verdict", "key", "value"),
    [
        (Verdict.NO_DYNAMIC, "damping_n_s_per_m", 210.0),
        (Verdict.FEW_LOADS, "stiffness_n_per_m", 8500.0),
        (Verdict.NOT_UNLOADED, "migration_m", 0.012),
    ],
)
def test_a_value_given_by_hand_ends_the_verdict_that_there_is_none(
    path: Path, verdict: Verdict, key: str, value: float
) -> None:
    plain = _plain(_fit(verdict=verdict))
    for figures in (plain["cuffs"]["hand"], plain["cuffs"]["hand"]["not_identified"]):
        figures.pop(key, None)
    assert _read(path, plain)["hand"].verdicts == (verdict,)
    plain["cuffs"]["hand"][key] = value
    assert _read(path, plain)["hand"].verdicts == (Verdict.GIVEN,)


@pytest.mark.parametrize("verdict", [Verdict.SCALE, Verdict.SKIN])
def test_a_stiffness_that_the_diagnosis_calls_wrong_cannot_be_worn(path: Path, verdict: Verdict) -> None:
    read = _read(path, _plain(_fit(verdict=verdict)))["hand"]
    assert read.verdicts == (verdict,)
    with raises_refusal(FitErrorCode.NOT_IDENTIFIED, missing="stiffness and damping"):
        read.parameters()


def test_a_file_written_by_hand_needs_only_values(path: Path) -> None:
    stiffness, damping = {"value": 2140, "standard_error": None}, {"value": 124}
    cuff = {"stiffness_n_per_m": stiffness, "damping_n_s_per_m": damping, "migration_m": 0.012}
    parameters = _read(path, {"cuffs": {"waist": cuff}})["waist"].parameters()
    assert parameters.site == "waist"
    assert (parameters.stiffness, parameters.damping, parameters.migration) == (2140.0, 124.0, 0.012)
    np.testing.assert_array_equal(parameters.covariance, np.zeros((3, 3)))
    assert parameters.source == Verdict.GIVEN.sentence()


def test_a_key_that_a_later_station_adds_is_ignored_and_its_format_refused(path: Path) -> None:
    plain = _plain(_fit())
    plain["cuffs"]["hand"]["colour"] = "blue"
    assert _read(path, plain)["hand"].stiffness == K
    with raises_refusal(FitErrorCode.CUFFS_FORMAT, found="2", expected=1):
        _read(path, {"format": 2, "cuffs": {}})


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("{", FitErrorCode.CUFFS_NOT_JSON),
        ("[]", FitErrorCode.CUFFS_MISSING),
        ('{"cuffs": {"../hand": {}}}', FitErrorCode.CUFFS_NAME),
    ],
)
def test_a_file_that_is_missing_or_not_a_cuffs_file_is_refused(text: str, code: FitErrorCode, path: Path) -> None:
    with raises_refusal(FitErrorCode.CUFFS_UNREADABLE, file=str(path)):
        read_cuffs(path)
    with raises_refusal(code, file=str(path)):
        _read(path, text)


@pytest.mark.parametrize(
    ("entry", "key"),
    [
        ("3", "cuffs.hand"),
        ('{"stiffness_n_per_m": {"value": "soft"}}', "cuffs.hand.stiffness_n_per_m.value"),
        ('{"site": "leg"}', "cuffs.hand.site"),
        ('{"migration_m": {"value": 1, "standard_error": -1}}', "cuffs.hand.migration_m.standard_error"),
        ('{"migration_m": {"value": true}}', "cuffs.hand.migration_m.value"),
        ('{"migration_m": {"value": 1, "ci95": [1]}}', "cuffs.hand.migration_m.ci95"),
        ('{"migration_m": {"value": 1, "ci95": [2, 1]}}', "cuffs.hand.migration_m"),
        ('{"stiffness_n_per_m": -1}', "cuffs.hand"),
        ('{"stiffness_n_per_m": 0.852}', "cuffs.hand"),
        ('{"damping_n_s_per_m": -3}', "cuffs.hand"),
        ('{"migration_m": 12}', "cuffs.hand"),
        ('{"stiffness": 8520}', "cuffs.hand.stiffness"),
        ('{"stiffness_n_per_m": "8520"}', "cuffs.hand.stiffness_n_per_m"),
        ('{"stiffness_n_per_m": [8520, 30]}', "cuffs.hand.stiffness_n_per_m"),
        ('{"donning": [1]}', "cuffs.hand.donning"),
        ('{"not_identified": {"damping": 210}}', "cuffs.hand.not_identified.damping"),
        ('{"not_identified": {"damping_n_s_per_m": {"sd": 1}}}', "cuffs.hand.not_identified.damping_n_s_per_m.sd"),
        ('{"stiffness_n_per_m": {"value": 8520, "sd": 10}}', "cuffs.hand.stiffness_n_per_m.sd"),
        ('{"note_codes": [{"code": "note.stopped_loading"}]}', "cuffs.hand.note_codes.0"),
        ('{"note_codes": [{"code": "note.stopped_loading", "figures": {"repeat": "1"}}]}', "cuffs.hand.note_codes.0"),
        ('{"covariance": [[1, 2], [3, 4]]}', "cuffs.hand.covariance.0"),
        ('{"covariance": "none"}', "cuffs.hand.covariance"),
        ('{"verdict_codes": ["damping_not_identified"]}', "cuffs.hand.verdict_codes.0"),
        ('{"verdict_codes": [5]}', "cuffs.hand.verdict_codes.0"),
        ('{"covariance": [[1, 2, 0], [2, 1, 0], [0, 0, 1]]}', "cuffs.hand"),  # a correlation of 2
        ('{"covariance": [[1, 0.5, 0], [0, 1, 0], [0, 0, 1]]}', "cuffs.hand"),
    ],
)
def test_a_wrong_value_is_refused_with_its_key(entry: str, key: str, path: Path) -> None:
    with raises_refusal(FitErrorCode.CUFFS_INVALID, file=str(path), key=key):
        _read(path, f'{{"cuffs": {{"hand": {entry}}}}}')
