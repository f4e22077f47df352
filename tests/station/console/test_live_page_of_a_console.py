"""The live page of a console during a pose: it opens beside the trial, and may freeze."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page

from recordings.contents import contents_of
from recordings.topics import MARKERS
from station.live.process import warm_up
from tests.station.console.browsing import CHROMIUM, open_page, runs, seen, stop, until
from tests.station.console.served import ServedConsole, write_config
from tests.station.console.test_wearer_in_a_browser import WEARER
from tests.station.live.trials import generic_plan
from tests.station.wearer import wearer_config

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine"),
    pytest.mark.timeout(400),
]

ENDLESS = WEARER.replace("cycles = 2", "cycles = 2\npose_s = 3600.0")
"""A pose that the operator stops: on a busy machine the first live values take a minute."""


def test_a_frozen_live_page_does_not_affect_the_recording(polite_browser: Browser, tmp_path: Path) -> None:
    warm_up(generic_plan(wearer_config(), tmp_path).plan)  # compiles what the first values would wait for
    config = write_config(tmp_path)
    config.write_text(f"{config.read_text()}{ENDLESS}\n[live]\nenabled = true\n")
    with ServedConsole(config, "--simulated") as console:
        page, live = open_page(polite_browser, console.address), open_page(polite_browser, f"{console.address}live")
        seen(live, "No live values")
        page.get_by_label("Subject code").fill("P01")
        page.get_by_label("Operator").fill("ab")
        page.get_by_role("button", name="Begin").click()
        seen(page, "next: pose")
        page.keyboard.press("a")
        runs(page)
        seen(live, re.compile(r"^lag 150 ms · values \d+\.\d+ s old$|^VALUES ARE"))
        seen(live, "generic body")
        session = live.context.new_cdp_session(live)
        session.send("Debugger.enable")
        session.send("Debugger.pause")
        frozen_s = recorded_s(page)
        until(page, lambda: recorded_s(page) > frozen_s + 3.0)
        stop(page)
        seen(page, "Keep (k)")
    contents = contents_of(next((tmp_path / "sessions").rglob("*task-pose*.mcap")))
    assert contents.complete and not contents.gaps
    markers = contents.streams[MARKERS]
    assert markers.samples / markers.nominal_rate_hz > frozen_s + 3.0


def recorded_s(page: Page) -> float:
    """Duration of the recording that the page shows."""
    text = page.get_by_text(re.compile(r"^REC \d")).first.inner_text()
    return float(text.split()[1])
