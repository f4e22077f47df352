"""Where the console's page has its buttons, findings and markers, in a browser."""

import json
import time
from functools import partial
from pathlib import Path

import pytest
from playwright.sync_api import Browser, expect

from station.journal import Recorded, Setup, write_recorded, write_setup
from tests.station.console.browsing import begin, buttons_are_in_view, fits_on_the_screen, open_page, runs, seen, until
from tests.station.console.served import ServedConsole, write_config

pytestmark = pytest.mark.timeout(600)

IN_VIEW = """() => {
    const canvas = {clientWidth: 300, clientHeight: 300};
    const view = {order: (at) => at, centre: [10, 20, 30], extent: 5, zoom: 1, turn: 0.7, tilt: 0.22};
    const place = view3d.projector(canvas, view);
    return Array.from({length: 36}, (_, n) => 10 * n * Math.PI / 180)
        .map((angle) => place([10 + 5 * Math.cos(angle), 20 + 5 * Math.sin(angle), 30]))
        .every(([x, y]) => x >= 5 && x <= 295 && y >= 5 && y <= 295);
}"""


def test_the_buttons_that_leave_a_decision_are_apart_from_it_at_every_width(browser: Browser, tmp_path: Path) -> None:
    folder = tmp_path / "sessions" / "sub-P01_ses-1"
    folder.mkdir(parents=True)
    write_setup(folder, Setup("P01", "ab", ("hand",), 1))
    (folder / "a.mcap").write_text("no recording\n")
    write_recorded(folder, Recorded("a.mcap", "hand", "static", 1, "1", False, 0, "the mocap capture ended"))
    with ServedConsole(write_config(tmp_path)) as console:
        page = open_page(browser, console.address)
        page.locator("button.session", has_text="P01, session 1").click()
        seen(page, "redo advised")
        for width in (801, 1000, 1101, 1280, 1400, 1900):
            page.set_viewport_size({"width": width, "height": 800})
            until(page, partial(buttons_are_in_view, page))
            decide, leave = (page.locator(f"footer .{group}").bounding_box() for group in ("main", "apart"))
            assert decide is not None and leave is not None
            assert decide["x"] + decide["width"] < leave["x"], width
        expect(page.locator("footer .apart button")).to_have_text(["Session list (l)", "Skip to report (e)"])
        assert page.evaluate(IN_VIEW), "a marker at any side of the centre"


def test_the_set_up_asks_for_a_code_and_offers_no_file_name_without_one(browser: Browser, tmp_path: Path) -> None:
    with ServedConsole(write_config(tmp_path)) as console:
        page = open_page(browser, console.address)
        page.get_by_role("button", name="Begin").click()
        seen(page, "no subject is given; enter a code")
        for subject, offered in (("P01", 1), ("M\u00fcller / x", 0)):
            page.get_by_label("Subject code").fill(subject)
            expect(page.get_by_text("files such as")).to_have_count(offered)
        card = page.locator(".q-card", has=page.get_by_text("Bench", exact=True))
        expect(card.get_by_text("NI Dev1: ")).to_be_visible()
        card.get_by_text("1 check passed").click()
        expect(card.get_by_text("disk:")).to_be_visible()
        expect(card.get_by_text("Resume a session")).to_have_count(0)


def test_a_session_begins_on_a_bench_with_faults_only_after_a_confirmation(browser: Browser, tmp_path: Path) -> None:
    with ServedConsole(write_config(tmp_path)) as console:  # no device answers at its ports
        page = open_page(browser, console.address)
        page.get_by_label("Subject code").fill("P01")
        page.get_by_role("button", name="Begin").click()
        seen(page, "Begin anyway?")
        seen(page, "Not ready: ")
        assert not (tmp_path / "sessions").exists()
        page.get_by_role("button", name="Back to the set-up").click()
        expect(page.get_by_text("Begin anyway?")).to_have_count(0)
        page.get_by_role("button", name="Begin").click()
        page.get_by_role("button", name="Begin anyway").click()
        seen(page, "next: hand, static")


MARKERS = ("anchor_1", "anchor_2", "anchor_3", "anchor_4", "cuff_1", "rope_1", "rope_2")
RATES_HZ = {"/emg": 2000.0, "/force": 1000.0, "/markers": 100.0, "/sync": 1000.0}
MUSCLES = ("anterior deltoid", "middle deltoid", "posterior deltoid", "upper trapezius", "pectoralis major", "biceps")
EVERYTHING = {
    "state": "recording",
    "sentence": "recording",
    "problems": "frames of the capture are missing",
    "sync_v": 5.0,
    "recorded_s": 1234.5,
    "edge_s": 0.5,
    "lost_samples": 1240,
    "marks": 0,
    "dropped": 1853,
    "slow_rate": 0.61,
    "disk_left_s": 1.1e6,
    "streams": {name: {"rate_hz": 0.97 * rate, "nominal_hz": rate, "samples": 1} for name, rate in RATES_HZ.items()},
    "force": [[t / 40, 155 + t / 400] for t in range(100)],  # above the limit: an alarm
    "displacement": [[t / 40, t / 10] for t in range(100)],
    "elevation": [],
    "emg_uv": dict.fromkeys(MUSCLES, 123.4),
    "seen": {name: name != "anchor_1" for name in MARKERS},
    "points": [None, *([100.0 * n, 200.0, 50.0 * n] for n in range(6))],
    "events": ["lost 1240 samples of /force: the buffer of the device overflowed"],
}
"""Telemetry of a slow bench with every warning at once."""


def test_a_trial_with_every_warning_is_one_screen_and_no_line_is_cut(browser: Browser, tmp_path: Path) -> None:
    program = (str(Path(__file__).with_name("shown_trial.py")), json.dumps({**EVERYTHING, "at": time.time()}))
    with ServedConsole(write_config(tmp_path), program=program) as console:
        page = open_page(browser, console.address)
        begin(page)
        page.keyboard.press("a")
        runs(page)
        seen(page, "STOP: ")
        seen(page, "simulated bench runs at 0.61 of real time")
        page.keyboard.press("s")
        seen(page, "End this recording now?")
        for _ in ("an alarm and a question", "its alarm silenced"):
            for width, height in ((1440, 900), (1366, 768), (1024, 768), (768, 1024), (390, 844)):
                page.set_viewport_size({"width": width, "height": height})
                is_right = buttons_are_in_view if width == 390 else fits_on_the_screen  # a telephone scrolls
                until(page, partial(is_right, page))  # the page follows its new size after a moment
                assert page.locator(".status").evaluate("line => line.scrollHeight <= line.clientHeight"), width
            page.keyboard.press("i")
            seen(page, "seen: STOP: ")
        chart = page.locator(".nicegui-echart").first.get_attribute("id")
        page.keyboard.press("y")
        seen(page, "the shown trial ends")
        age = page.locator(".age")
        expect(age).to_be_empty()
        late = f"station.draw({{at: 0, charts: [[{(chart or '').removeprefix('c')}, []]], markers: ['', []]}})"
        assert page.evaluate(late), "an update that arrives after the end of the trial"
        assert age.inner_text() == ""
