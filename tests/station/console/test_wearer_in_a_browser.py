"""Pose and motion of a wearer as an operator guides them: in a browser, on a simulated person."""

import json
import re
from functools import partial
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from fitting.wearer.wearer_trial import read_wearer_trial
from tests.station.console.browsing import (
    arm,
    begin,
    buttons_are_in_view,
    fits_on_the_screen,
    open_page,
    seen,
    unreadable,
    until,
    was_shown,
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
    config.write_text(config.read_text() + WEARER.replace("cycles = 2", "cycles = 4"))  # time to look at it
    with ServedConsole(config, "--simulated") as console:
        page = open_page(browser, console.address)
        begin(page, "next: pose")
        record_the_pose(page)
        record_the_motion(page, pictures)
        seen(page, "next: hand, static, repeat 1")
    folder = tmp_path / "sessions" / "simulated" / "sub-P01_ses-1"
    kinds = [json.loads(line)["kind"] for line in (folder / "session.jsonl").read_text().splitlines()]
    assert kinds == ["setup", "recorded", "verdict", "recorded", "verdict"]
    trial = read_wearer_trial(next(folder.glob("*task-motion*.mcap")))
    assert len(trial.cycles) == 4 and trial.emg is not None and trial.is_whole


def record_the_pose(page: Page) -> None:
    seen(page, "stand upright, arm hanging")
    assert unreadable(page) == []
    arm(page)
    was_shown(page, r"^REC \d")
    seen(page, re.compile(r"^pose: no problems found"))
    seen(page, "largest movement [mm]")
    expect(page.get_by_text("donning so far")).to_have_count(0)
    page.keyboard.press("k")


def record_the_motion(page: Page, pictures: Path) -> None:
    seen(page, "next: motion, without the suit")
    arm(page)
    seen(page, re.compile(r"EMG RMS \[µV\] deltoid \d+"))
    until(page, partial(fits_on_the_screen, page))
    page.screenshot(path=pictures / "console-motion.png")
    page.set_viewport_size({"width": 390, "height": 844})
    until(page, partial(buttons_are_in_view, page))  # a telephone: the middle scrolls
    page.wait_for_function("document.documentElement.scrollWidth <= innerWidth")
    was_shown(page, r"lower the arm|cycle 2 of 4$")
    page.set_viewport_size({"width": 1280, "height": 800})
    seen(page, re.compile(r"^motion, without the suit: no problems found"))
    seen(page, "4 of 4")
    page.screenshot(path=pictures / "console-motion-verdict.png")
    assert unreadable(page) == []
    page.keyboard.press("k")
