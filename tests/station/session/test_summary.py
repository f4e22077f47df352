from __future__ import annotations

from pathlib import Path

import pytest

from station.muscles.assessment_inputs import InputError
from station.session.summary import SummaryError, summarise
from tests.station.foreign import static_and_dynamic


def test_a_session_whose_cuff_no_suit_wears_still_has_its_table_and_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise InputError("the cuff hand has the law creep")

    monkeypatch.setattr("station.muscles.assess.assess_file", refuse)
    for truth in static_and_dynamic():
        truth.record(tmp_path / f"cuff-hand_test-{truth.manifest.test}_run-1.mcap")
    summary = summarise(tmp_path)
    assert [row["cuff"] for row in summary.rows] == ["hand"]
    assert summary.findings == ("no assessment: the cuff hand has the law creep",)
    assert (tmp_path / "report.html").is_file() and (tmp_path / "cuffs.json").is_file()


def test_an_empty_session_is_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(SummaryError, match="holds no recording"):
        summarise(tmp_path)
