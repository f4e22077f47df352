"""cuffs.json, written and read."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fitting.cuffs.cuff_fit import CuffFit, SessionFit
from fitting.cuffs.cuffs_file import cuffs_json, read_cuffs
from fitting.cuffs.wearable_cuff import joint_covariance
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


def test_what_is_written_is_read_back(tmp_path: Path) -> None:
    path = tmp_path / "cuffs.json"
    path.write_text(cuffs_json(_session(_fit())), encoding="utf-8")
    read = read_cuffs(path)["hand"]
    assert (read.stiffness, read.damping, read.migration) == (K, C, M)
    assert read.verdicts == (Verdict.IDENTIFIED,)
    parameters = read.parameters()
    assert (parameters.stiffness, parameters.damping, parameters.migration) == (8520.0, 210.0, 0.012)
    np.testing.assert_allclose(np.diag(parameters.covariance), [100.0, 36.0, 1e-10])
    assert parameters.source == "abc"


def test_the_file_has_the_keys_others_rely_on() -> None:
    cuff = json.loads(cuffs_json(_session(_fit())))["cuffs"]["hand"]
    assert cuff["stiffness_n_per_m"] == {
        "value": 8520.0,
        "standard_error": 10.0,
        "ci95": [8500.0, 8540.0],
        "parts": {"noise": 8.0, "between_repeats": 6.0},
        "cramer_rao_bound": 8.0,
    }
    assert set(cuff) >= {"damping_n_s_per_m", "migration_m", "verdict", "donnings", "trials", "sources"}


def test_what_is_not_identified_is_null_and_the_verdict_says_why(tmp_path: Path) -> None:
    text = cuffs_json(_session(_fit(damping=None, verdict=Verdict.LAG)))
    cuff = json.loads(text)["cuffs"]["hand"]
    assert cuff["damping_n_s_per_m"] == {"value": None, "standard_error": None, "ci95": None}
    assert cuff["verdict_codes"] == ["damping_not_identified.lag"]
    assert cuff["verdict"] == Verdict.LAG.sentence()
    path = tmp_path / "cuffs.json"
    path.write_text(text, encoding="utf-8")
    with raises_refusal(FitErrorCode.NOT_IDENTIFIED, cuff="hand", missing="damping", verdict=Verdict.LAG.sentence()):
        read_cuffs(path)["hand"].parameters()


def test_what_noise_leaves_open_is_null_beside_its_figure_and_cannot_be_worn(tmp_path: Path) -> None:
    path = tmp_path / "cuffs.json"
    wide = Estimate(210.0, 120.0, (-25.0, 445.0))
    path.write_text(cuffs_json(_session(_fit(damping=wide, verdict=Verdict.LAG))), encoding="utf-8")
    written = json.loads(path.read_text(encoding="utf-8"))["cuffs"]["hand"]
    assert written["damping_n_s_per_m"] == {"value": None, "standard_error": None, "ci95": None}
    assert written["not_identified"]["damping_n_s_per_m"]["ci95"] == [-25.0, 445.0]
    read = read_cuffs(path)["hand"]
    assert read.damping == wide
    assert read.missing == ("damping",)
    with raises_refusal(FitErrorCode.NOT_IDENTIFIED, cuff="hand", missing="damping"):
        read.parameters()


def test_the_verdict_is_read_from_its_code_and_not_from_its_sentence(tmp_path: Path) -> None:
    path = tmp_path / "cuffs.json"
    wide = Estimate(400.0, 300.0, (-190.0, 990.0))
    plain = json.loads(cuffs_json(_session(_fit(damping=wide, verdict=Verdict.LAG))))
    plain["cuffs"]["hand"]["verdict"] = "another sentence"
    path.write_text(json.dumps(plain), encoding="utf-8")
    read = read_cuffs(path)["hand"]
    assert read.verdicts == (Verdict.LAG,)
    assert read.missing == ("damping",)


def test_a_trial_that_ended_early_does_not_lead_the_verdict_of_a_value_given_by_hand(tmp_path: Path) -> None:
    path = tmp_path / "cuffs.json"
    note = Note(NoteCode.STOPPED_SWINGING, {"file": "a.mcap", "repeat": 1, "found_s": 6.0, "planned_s": 20.0})
    written = replace(_fit(verdict=Verdict.DAMPING_UNCERTAIN), notes=(note,))
    path.write_text(cuffs_json(_session(written)), encoding="utf-8")
    assert read_cuffs(path)["hand"].verdict == str(note)
    plain = json.loads(path.read_text(encoding="utf-8"))
    plain["cuffs"]["hand"]["damping_n_s_per_m"] = 210.0
    path.write_text(json.dumps(plain), encoding="utf-8")
    assert read_cuffs(path)["hand"].verdict == Verdict.GIVEN.sentence()


@pytest.mark.parametrize(
    ("verdict", "key", "value"),
    [
        (Verdict.NO_DYNAMIC, "damping_n_s_per_m", 210.0),
        (Verdict.FEW_LOADS, "stiffness_n_per_m", 8500.0),
        (Verdict.NOT_UNLOADED, "migration_m", 0.012),
    ],
)
def test_a_value_given_by_hand_ends_the_verdict_that_there_is_none(
    tmp_path: Path, verdict: Verdict, key: str, value: float
) -> None:
    path = tmp_path / "cuffs.json"
    plain = json.loads(cuffs_json(_session(_fit(verdict=verdict))))
    for figures in (plain["cuffs"]["hand"], plain["cuffs"]["hand"]["not_identified"]):
        figures.pop(key, None)
    path.write_text(json.dumps(plain), encoding="utf-8")
    assert read_cuffs(path)["hand"].verdicts == (verdict,)
    plain["cuffs"]["hand"][key] = value
    path.write_text(json.dumps(plain), encoding="utf-8")
    assert read_cuffs(path)["hand"].verdicts == (Verdict.GIVEN,)


@pytest.mark.parametrize("verdict", [Verdict.SCALE, Verdict.SKIN])
def test_a_stiffness_that_the_diagnosis_calls_wrong_cannot_be_worn(tmp_path: Path, verdict: Verdict) -> None:
    path = tmp_path / "cuffs.json"
    path.write_text(cuffs_json(_session(_fit(verdict=verdict))), encoding="utf-8")
    read = read_cuffs(path)["hand"]
    assert read.verdicts == (verdict,)
    with raises_refusal(FitErrorCode.NOT_IDENTIFIED, missing="stiffness and damping"):
        read.parameters()


def test_the_latest_donning_is_at_the_top_and_the_others_are_beside_it() -> None:
    cuff = json.loads(cuffs_json(_session(_fit("1"), _fit("2"))))["cuffs"]["hand"]
    assert cuff["donning"] == "2"
    assert list(cuff["donnings"]) == ["1", "2"]


def test_a_file_written_by_hand_needs_only_values(tmp_path: Path) -> None:
    path = tmp_path / "cuffs.json"
    path.write_text(
        '{"cuffs": {"waist": {"stiffness_n_per_m": {"value": 2140, "standard_error": null}, '
        '"damping_n_s_per_m": {"value": 124}, "migration_m": 0.012}}}',
        encoding="utf-8",
    )
    parameters = read_cuffs(path)["waist"].parameters()
    assert parameters.site == "waist"
    assert (parameters.stiffness, parameters.damping, parameters.migration) == (2140.0, 124.0, 0.012)
    np.testing.assert_array_equal(parameters.covariance, np.zeros((3, 3)))
    assert parameters.source == Verdict.GIVEN.sentence()


def test_a_key_that_a_later_station_adds_is_ignored(tmp_path: Path) -> None:
    path = tmp_path / "cuffs.json"
    plain = json.loads(cuffs_json(_session(_fit())))
    plain["cuffs"]["hand"]["colour"] = "blue"
    path.write_text(json.dumps(plain), encoding="utf-8")
    assert read_cuffs(path)["hand"].stiffness == K


def test_a_file_of_a_later_format_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "cuffs.json"
    path.write_text('{"format": 2, "cuffs": {}}', encoding="utf-8")
    with raises_refusal(FitErrorCode.CUFFS_FORMAT, found="2", expected=1):
        read_cuffs(path)


@pytest.mark.parametrize("code", ["damping_not_identified", 5])
def test_an_unknown_code_is_refused(code: str | int, tmp_path: Path) -> None:
    path = tmp_path / "cuffs.json"
    path.write_text(json.dumps({"format": 1, "cuffs": {"hand": {"verdict_codes": [code]}}}), encoding="utf-8")
    with raises_refusal(FitErrorCode.CUFFS_INVALID, file=str(path), key="cuffs.hand.verdict_codes.0"):
        read_cuffs(path)


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("{", FitErrorCode.CUFFS_NOT_JSON),
        ("[]", FitErrorCode.CUFFS_MISSING),
        ('{"cuffs": {"../hand": {}}}', FitErrorCode.CUFFS_NAME),
    ],
)
def test_a_file_that_is_not_a_cuffs_file_is_refused(text: str, code: FitErrorCode, tmp_path: Path) -> None:
    path = tmp_path / "cuffs.json"
    path.write_text(text, encoding="utf-8")
    with raises_refusal(code, file=str(path)):
        read_cuffs(path)


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with raises_refusal(FitErrorCode.CUFFS_UNREADABLE, file=str(tmp_path / "cuffs.json")):
        read_cuffs(tmp_path / "cuffs.json")


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
        ('{"covariance": [[1, 2, 0], [2, 1, 0], [0, 0, 1]]}', "cuffs.hand"),  # a correlation of 2
        ('{"covariance": [[1, 0.5, 0], [0, 1, 0], [0, 0, 1]]}', "cuffs.hand"),
    ],
)
def test_a_wrong_value_is_refused_with_its_key(entry: str, key: str, tmp_path: Path) -> None:
    path = tmp_path / "cuffs.json"
    path.write_text(f'{{"cuffs": {{"hand": {entry}}}}}', encoding="utf-8")
    with raises_refusal(FitErrorCode.CUFFS_INVALID, file=str(path), key=key):
        read_cuffs(path)
