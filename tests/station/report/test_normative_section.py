"""A session's cuffs beside the normative table of a study."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from fitting.cuffs.cuffs_file import cuffs_json
from recordings.manifest import DataOrigin
from station.files.chain import trace_chain
from station.messages.study_messages import StudyCode
from station.report.cuff_section import adopt_normative, normative_section
from station.report.page import write_report
from station.report.verification import number_links
from station.study.sessions import StudyError
from tests.refusals import raises_refusal
from tests.station.report.test_page import _fitted
from tests.station.reported import unmarked_numbers


def _entry(mean: float, low: float, high: float) -> dict[str, Any]:
    return {
        "mean": mean,
        "mean_ci95": [0.9 * mean, 1.1 * mean],
        "prediction95": [low, high],
        "volunteers": 12,
        "repeats": 3,
    }


@pytest.fixture
def table(tmp_path: Path) -> Path:
    path = tmp_path / "study" / "normative.json"
    path.parent.mkdir()
    cuffs = {"waist": {"stiffness": _entry(3000.0, 2500.0, 3500.0), "migration": _entry(0.012, 0.006, 0.018)}}
    document = {"format": 1, "origin": "measured", "study_sha256": "0" * 64, "cuffs": cuffs}
    path.write_text(json.dumps(document), encoding="utf-8")
    return path


def test_a_value_is_below_within_or_above_the_prediction_interval(table: Path) -> None:
    fit = _fitted().cuffs["waist"]
    assert fit.stiffness and fit.migration and fit.stiffness.value < 2500.0 and 0.006 < fit.migration.value < 0.018
    worn = {"waist": fit.wearable()}
    section = normative_section(table.parent, worn, DataOrigin.MEASURED)
    assert section is not None and section.has_same_origin
    assert [(row.cuff, row.quantity, row.place) for row in section.rows] == [
        ("waist", "stiffness [N/m]", "below the interval"),
        ("waist", "migration [mm]", "within the interval"),
    ]
    assert str(section.rows[1].interval) == "6.0 to 18.0"
    assert normative_section(table.parent.parent, worn, DataOrigin.MEASURED) is None


def test_the_table_is_kept_with_the_session_shown_and_verified(table: Path, tmp_path: Path) -> None:
    folder = tmp_path / "session"
    folder.mkdir()
    adopt_normative(table, folder)
    (folder / "cuffs.json").write_text(cuffs_json(_fitted()), encoding="utf-8")
    path = write_report(folder, _fitted())
    page = path.read_text(encoding="utf-8")
    assert 'id="normative"' in page and "2500 to 3500" in page
    assert unmarked_numbers(path, *(trial.file for trial in _fitted().cuffs["waist"].trials)) == []
    assert "report.json ← normative.json, 6 numbers" in {
        link.what for link in number_links(folder) if link.standing == "as recorded"
    }
    links = {link.what: link.standing for link in trace_chain(folder)}
    assert links["normative.json"] == "as recorded"
    adopt_normative(folder / "normative.json", folder)
    assert (folder / "normative.json").read_bytes() == table.read_bytes()


def test_another_file_is_refused_and_not_copied(tmp_path: Path) -> None:
    other = tmp_path / "study.json"
    other.write_text("{}", encoding="utf-8")
    with raises_refusal(StudyCode.WRONG_NORMATIVE, kind=StudyError):
        adopt_normative(other, tmp_path)
    assert not (tmp_path / "normative.json").exists()
