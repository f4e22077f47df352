"""Pose and motion of a wearer as an operator guides them: in a browser, on a simulated person."""

from __future__ import annotations

import json
import re
from functools import partial
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from fitting.wearer.wearer_trial import read_wearer_trial
from tests.station.console.browsing import (
    buttons_are_in_view,
    fits_on_the_screen,
    open_page,
    runs,
    seen,
    unreadable,
    until,
)
from tests.station.console.served import ServedConsole, write_config

pytestmark = pytest.mark.timeout(400)

WEARER = """
[body]
markers = ["ij", "px", "c7", "t8", "ac", "aa", "ts", "ai", "gu", "EpL", "EpM"]
suit_markers = ["cord_waist", "cord_shoulder", "cord_arm"]
arm = ["ac", "EpL"]
trunk = ["c7", "t8"]
cycles = 2
conditions = ["unsuited"]

[emg]
range_v = 2.0
channels = { deltoid = { input = "ai2", gain = 500.0 } }
"""


def test_a_pose_and_a_motion_are_guided_shown_judged_and_kept(browser: Browser, tmp_path: Path, pictures: Path) -> None:
    config = write_config(tmp_path)
    config.write_text(config.read_text() + WEARER)
    with ServedConsole(config, "--simulated", "--speed", "2") as console:
        page = open_page(browser, console.address)
        page.get_by_label("Subject code").fill("P01")
        page.get_by_label("Operator").fill("ab")
        page.get_by_role("button", name="Begin").click()
        record_the_pose(page)
        record_the_motion(page, pictures)
        seen(page, "next: hand, static, repeat 1")
    folder = tmp_path / "sessions" / "simulated" / "sub-P01_ses-1"
    kinds = [json.loads(line)["kind"] for line in (folder / "session.jsonl").read_text().splitlines()]
    assert kinds == ["setup", "recorded", "verdict", "recorded", "verdict"]
    trial = read_wearer_trial(next(folder.glob("*task-motion*.mcap")))
    assert len(trial.cycles) == 2 and trial.emg is not None and trial.is_whole


def record_the_pose(page: Page) -> None:
    seen(page, "next: pose")
    seen(page, "stand upright, arm hanging")
    assert unreadable(page) == []
    page.keyboard.press("a")
    runs(page)
    seen(page, re.compile(r"^pose: no problems found"))
    seen(page, "largest movement [mm]")
    expect(page.get_by_text("donning so far")).to_have_count(0)
    page.keyboard.press("k")


def record_the_motion(page: Page, pictures: Path) -> None:
    seen(page, "next: motion, without the suit")
    page.keyboard.press("a")
    runs(page)
    seen(
        page, re.compile(r"lower the arm|cycle 2 of 2$")
    )  # lasts to the end of the trial, as a step of its own may not
    seen(page, re.compile(r"EMG RMS \[µV\] deltoid \d+"))
    assert fits_on_the_screen(page)
    page.screenshot(path=pictures / "console-motion.png")
    page.set_viewport_size({"width": 390, "height": 844})
    until(page, partial(buttons_are_in_view, page))  # a telephone: the middle scrolls
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    page.set_viewport_size({"width": 1280, "height": 800})
    seen(page, re.compile(r"^motion, without the suit: no problems found"))
    seen(page, "2 of 2")
    page.screenshot(path=pictures / "console-motion-verdict.png")
    assert unreadable(page) == []
    page.keyboard.press("k")
