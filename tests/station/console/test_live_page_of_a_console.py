"""The live page of a console while a motion is recorded: it opens beside the trial, and may freeze."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from playwright.sync_api import Browser

from recordings.contents import contents_of
from station.live.warm_up import warm_up
from tests.station.console.browsing import CHROMIUM, open_page, runs, seen
from tests.station.console.served import ServedConsole, write_config
from tests.station.console.test_wearer_in_a_browser import WEARER
from tests.station.live.trials import generic_plan
from tests.station.wearer import wearer_config

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine"),
    pytest.mark.timeout(300),
]


def test_a_frozen_live_page_does_not_affect_the_recording(polite_browser: Browser, tmp_path: Path) -> None:
    warm_up(generic_plan(wearer_config(), tmp_path).plan)  # compiles what the pose, which is short, does not wait for
    config = write_config(tmp_path)
    config.write_text(f"{config.read_text()}{WEARER}\n[live]\nenabled = true\n")
    with ServedConsole(config, "--simulated") as console:
        page, live = open_page(polite_browser, console.address), open_page(polite_browser, f"{console.address}live")
        seen(live, "No live values")
        page.get_by_label("Subject code").fill("P01")
        page.get_by_label("Operator").fill("ab")
        page.get_by_role("button", name="Begin").click()
        seen(page, "next: pose")
        page.keyboard.press("a")
        runs(page)
        seen(live, re.compile(r"^(ended · )?lag 150 ms · values \d+\.\d+ s old$|^VALUES ARE"))
        seen(live, "generic body")
        session = live.context.new_cdp_session(live)
        session.send("Debugger.enable")
        session.send("Debugger.pause")
        seen(page, "Keep (k)")
    contents = contents_of(next((tmp_path / "sessions").rglob("*task-pose*.mcap")))
    assert contents.complete and not contents.gaps
