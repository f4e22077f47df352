"""The report as PDF: A4 pages printed by a browser, and a code where the extra or a browser is missing."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NoReturn

import pytest

from station.checksums import Checksums, sha256_of
from station.extras import MissingExtra, with_extras
from station.messages.setup_messages import ConfigCode, FolderCode
from station.report import page
from station.report.pdf import BrowserError, _launch, write_pdf
from station.verbs.whole import report
from tests.station.console.browsing import CHROMIUM
from tests.station.refusals import raises_refusal

STYLE = Path(page.__file__).with_name("page.css").read_text(encoding="utf-8")
POINTS_PER_MM = 72 / 25.4


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
    assert Checksums(tmp_path).sums == {"report.pdf": sha256_of(written)}


def test_without_the_extra_the_command_names_it_before_it_fits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "playwright", None)
    with raises_refusal(MissingExtra, ConfigCode.MISSING_PACKAGE) as caught:
        with_extras(report, "report")(tmp_path, format="pdf")
    assert "[pdf]" in str(caught.value)
    assert caught.value.exit_code == 1


def test_a_computer_without_a_browser_has_a_code(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("station.report.pdf.PROGRAMS", ())
    tried: list[Any] = []

    def launch(channel: str | None) -> NoReturn:
        tried.append(channel)
        raise OSError("not installed")

    with raises_refusal(BrowserError, FolderCode.NO_BROWSER):
        _launch(SimpleNamespace(chromium=SimpleNamespace(launch=launch)), OSError)  # type: ignore[arg-type]
    assert tried == ["chrome", "msedge", None]
