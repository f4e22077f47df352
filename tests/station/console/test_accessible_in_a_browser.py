"""axe-core finds nothing serious on the operator's pages, from the set-up to the end of a session."""

from __future__ import annotations

from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page

from tests.station.console.accessible import needs_axe, serious_faults
from tests.station.console.browsing import CHROMIUM, begin, open_page, runs, seen
from tests.station.console.served import ServedConsole, write_config

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine"),
    pytest.mark.timeout(600),
    needs_axe,
]


def assert_usable(page: Page, state: str) -> None:
    """On a screen and on a telephone, nothing is cut and axe-core finds nothing serious."""
    for width, height in ((1440, 900), (390, 844)):
        page.set_viewport_size({"width": width, "height": height})
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth"), f"{state}, {width} px"
        assert serious_faults(page) == [], f"{state}, {width} px"


def test_no_state_of_a_session_has_a_serious_fault(browser: Browser, tmp_path: Path) -> None:
    with ServedConsole(write_config(tmp_path, hold_s=4.0), "--simulated", "--speed", "6") as console:
        page = open_page(browser, console.address)
        seen(page, "Ready; ")
        assert_usable(page, "set-up")
        begin(page)
        assert_usable(page, "next trial")
        page.get_by_role("button", name="dynamic 1, hand: to come").click()
        seen(page, "Record it next")
        assert_usable(page, "dialog of a trial")
        page.get_by_role("button", name="Close").click()
        page.get_by_role("dialog").wait_for(state="detached")
        page.keyboard.press("a")
        runs(page)
        assert_usable(page, "trial")
        seen(page, "Keep (k)")
        assert_usable(page, "verdict")
        page.keyboard.press("k")
        seen(page, "next: hand, dynamic")
        page.keyboard.press("t")
        seen(page, "Recordings of this session")
        assert_usable(page, "recordings")
        page.get_by_role("button", name="Close").click()
        page.get_by_role("dialog").wait_for(state="detached")
        page.keyboard.press("n")
        seen(page, "1 of 2 trials of the plan are accepted, 1 skipped")
        assert_usable(page, "end")
        page.keyboard.press("l")
        seen(page, "New session")
        seen(page, "1 of 2 trials")
        assert_usable(page, "sessions")
        page.goto(f"{console.address}live")
        seen(page, "No live values")
        assert_usable(page, "live muscles")
