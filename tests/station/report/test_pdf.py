"""The report as PDF: A4 pages printed by a browser, and a code where the extra or a browser is missing."""

import re
import shutil
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NoReturn

import pytest

from station.assessment.assess import assess_cuffs, write_assessment
from station.assessment.assessment_inputs import AssessmentInputs
from station.checksums import Checksums, file_sha256
from station.extras import MissingExtra, with_extras
from station.fit import fit_session_folder
from station.messages.setup_messages import ConfigCode, FolderCode
from station.report import page
from station.report.page import BrowserError, _launch, write_pdf, write_report
from station.verbs.whole import report
from tests.fitting.experiment import PUBLISHED, Session, published
from tests.refusals import raises_refusal
from tests.station.console.browsing import CHROMIUM, chromium, patience_ms
from tests.station.foreign import Truth
from tests.station.reported import few_people
from tests.station.wearer import WearerSession

STYLE = Path(page.__file__).with_name("page.css").read_text(encoding="utf-8")
POINTS_PER_MM = 72 / 25.4
MOST_UNFOLDED, MOST_SHEETS = 8.0, 4
MOST_FOLDED = {(390, 844): 2.2, (768, 1024): 2.0, (1024, 768): 2.0, (1440, 900): 2.0}
"""Screens by their size. On a telephone it is 1.97 with the fonts of one machine."""
CUT_TABLES = """() => [...document.querySelectorAll(".scroll")].filter((part) => part.scrollWidth > part.clientWidth)
    .map((part) => part.innerText.slice(0, 80))"""
UNFOLD = "document.querySelectorAll('details').forEach(section => section.open = true)"


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")
def test_a_page_is_printed_on_a4_and_its_hash_is_kept(tmp_path: Path) -> None:
    page = tmp_path / "report.html"
    page.write_text(f"<style>{STYLE}</style><section class=first>first</section><p>second</p>", encoding="utf-8")
    written = write_pdf(page)
    printed = written.read_bytes()
    sheets = re.findall(rb"/Type\s*/Page\b.*?/MediaBox\s*\[0 0 ([\d.]+) ([\d.]+)\]", printed, re.DOTALL)
    assert len(sheets) == 2, "the first page stands alone"
    for width, height in sheets:
        assert (float(width), float(height)) == pytest.approx((210 * POINTS_PER_MM, 297 * POINTS_PER_MM), abs=1.0)
    assert Checksums(tmp_path).sums == {"report.pdf": file_sha256(written)}


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")
def test_a_report_of_four_cuffs_and_a_wearer_is_short(tmp_path: Path, wearer: WearerSession) -> None:
    """At most two screens folded, eight unfolded, four pages of paper; no table is cut.

    At 1024 px it is 7.5 with the fonts of one machine: those of others may differ.
    """
    report = report_four_cuffs(tmp_path, wearer)
    with chromium(CHROMIUM) as browser:
        shown = browser.new_page()
        shown.set_default_timeout(patience_ms())
        shown.goto(report.as_uri())
        for (width, height), most in MOST_FOLDED.items():
            shown.set_viewport_size({"width": width, "height": height})
            assert shown.evaluate("document.documentElement.scrollHeight / innerHeight") <= most, width
        shown.evaluate(UNFOLD)
        for width, height in MOST_FOLDED:
            shown.set_viewport_size({"width": width, "height": height})
            assert shown.evaluate(CUT_TABLES) == [], width
            if width >= 1024:
                assert shown.evaluate("document.documentElement.scrollHeight / innerHeight") <= MOST_UNFOLDED, width
    assert len(re.findall(rb"/Type\s*/Page\b", write_pdf(report).read_bytes())) <= MOST_SHEETS


def report_four_cuffs(folder: Path, wearer: WearerSession) -> Path:
    """Three static and three dynamic trials of every published cuff, and the pose and motions of the wearer."""
    for cuff in PUBLISHED:
        session = Session(published(cuff, hold=4.2), 3)
        for repeat in (1, 2, 3):
            for test, make in (("static", session.static), ("dynamic", session.dynamic)):
                Truth(*make(repeat)).record(folder / f"cuff-{cuff}_test-{test}_run-{repeat}.mcap")
    for recording in wearer.folder.glob("*.mcap"):
        shutil.copy(recording, folder)
    fitted = fit_session_folder(folder, folder / "cuffs.json")
    worn = {name: fit.wearable() for name, fit in fitted.cuffs.items()}
    inputs = AssessmentInputs(folder / "cuffs.json")
    write_assessment(assess_cuffs(worn, inputs, most_frames=4, most_rest_lengths=9, people=few_people(4)), folder)
    return write_report(folder, fitted)


def test_without_the_extra_the_command_names_it_before_it_fits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "playwright", None)
    with raises_refusal(ConfigCode.MISSING_PACKAGE, "[pdf]", kind=MissingExtra) as caught:
        with_extras(report, "report")(tmp_path, format="pdf")
    assert caught.value.exit_code == 1


def test_a_computer_without_a_browser_has_a_code(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("station.report.page.PROGRAMS", ())
    tried: list[Any] = []

    def launch(channel: str | None) -> NoReturn:
        tried.append(channel)
        raise OSError("not installed")

    with raises_refusal(FolderCode.NO_BROWSER, kind=BrowserError):
        _launch(SimpleNamespace(chromium=SimpleNamespace(launch=launch)), OSError)  # type: ignore[arg-type]
    assert tried == ["chrome", "msedge", None]
