"""axe-core finds nothing serious on the operator's pages, from the set-up to the end of a session."""

from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page

from tests.station.console.browsing import (
    arm,
    begin,
    check_until_ready,
    needs_axe,
    open_page,
    seen,
    serious_faults,
    was_shown,
)
from tests.station.console.served import ServedConsole, write_config

pytestmark = [pytest.mark.timeout(600), needs_axe]


CUT = """() => [document.documentElement, ...document.querySelectorAll(".nicegui-content")]
    .filter((part) => part.scrollWidth > part.clientWidth)
    .flatMap((part) => [part, ...[...part.querySelectorAll("*")].filter((element) =>
        element.getBoundingClientRect().right > part.getBoundingClientRect().right)])
    .map((element) => element.cloneNode().outerHTML)"""
STILL = "* { transition: none !important; } .nicegui-echart > div { min-width: 3000px }"
"""Nothing fades in, and charts keep a former width, as for a moment after the page became narrower."""


def assert_usable(page: Page, state: str) -> None:
    """Nothing is cut at any width, and axe-core finds nothing serious on a screen and on a telephone."""
    for width, height in ((1440, 900), (1024, 768), (768, 1024), (390, 844)):
        page.set_viewport_size({"width": width, "height": height})
        assert page.evaluate(CUT) == [], f"{state}, {width} px"
        if width in (1440, 390):
            assert serious_faults(page) == [], f"{state}, {width} px"


def test_no_state_of_a_session_has_a_serious_fault(browser: Browser, tmp_path: Path) -> None:
    with ServedConsole(write_config(tmp_path, hold_s=4.0), "--simulated", "--speed", "2") as console:
        page = open_page(browser, console.address)
        check_until_ready(page)
        page.add_style_tag(content=STILL)
        assert_usable(page, "set-up")
        begin(page)
        page.evaluate(
            "(name) => { const stage = document.querySelector('.stage'); stage.ariaLabel = stage.textContent = name; }",
            "motion, maximal contraction, repeat 12",
        )
        assert_usable(page, "next trial")
        page.get_by_role("button", name="dynamic 1, hand: to come").click()
        seen(page, "Record it next")
        assert_usable(page, "dialog of a trial")
        page.get_by_role("button", name="Close").click()
        page.get_by_role("dialog").wait_for(state="detached")
        arm(page)
        was_shown(page, r"^REC \d")
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


def test_a_report_has_no_serious_fault_folded_or_unfolded(browser: Browser, reported: Path) -> None:
    report = reported / "report.html"
    for scheme in ("light", "dark"):
        page = open_page(browser, report.as_uri())
        page.emulate_media(color_scheme=scheme)  # type: ignore[arg-type]
        assert_usable(page, f"report, {scheme}")
        page.evaluate("document.querySelectorAll('details').forEach(section => section.open = true)")
        assert_usable(page, f"report unfolded, {scheme}")
