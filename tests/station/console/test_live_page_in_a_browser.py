"""The live page as a visitor sees it: body, effort, rest length, age, and every outcome as a line."""

import os
import re
import socket
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from recordings.contents import read_contents
from recordings.topics import MARKERS
from station.child import Child
from station.live.process import warm_up
from station.live.published import LiveFinding, LiveSubject
from tests.station.console.browsing import begin, open_page, runs, seen, stop, unreadable, until
from tests.station.console.live_source import LiveSource, live_setup
from tests.station.console.served import ServedConsole, write_config
from tests.station.console.test_wearer_in_a_browser import WEARER
from tests.station.live.trials import generic_plan
from tests.station.wearer import wearer_config

pytestmark = pytest.mark.timeout(300)

OUTCOMES = ("generic_body", "no_glenoid", "wearer_left", "markers_exchanged", "not_held", "decimated", "overloaded")
FINDINGS = tuple(LiveFinding(f"live.{code}", f"a sentence about {code.replace('_', ' ')}") for code in OUTCOMES)
IS_DRAWN = """() => {
    const canvas = document.querySelector("canvas.body");
    return canvas && canvas.getContext("2d").getImageData(0, 0, 400, 400).data.some(Boolean);
}"""
DRAWN_AT = """level => {
    document.querySelector("#made")?.remove();
    document.body.insertAdjacentHTML("beforeend",
        "<canvas id=made style='position:fixed;left:0;top:0;width:400px;height:300px;z-index:99'></canvas>");
    const bones = [["shaft", [[0, 0, 0], [0, -300, 0]]], ["plate", [[0, 0, 0], [0, -50, 90], [0, 40, 90], [0, 0, 0]]]];
    drawBody("made", {bones, muscles: [[[0, 50, 100], [0, -50, -50], [0, -200, 60]]], levels: [level], cord: []});
    return document.querySelector("#made").toDataURL();
}"""
ENDLESS = WEARER.replace("cycles = 2", "cycles = 2\npose_s = 3600.0")
"""A pose that the operator stops: on a busy machine the first live values take a minute."""


@contextmanager
def publishing(source: LiveSource) -> Iterator[None]:
    """Frames at the pace of a live process."""
    over = threading.Event()

    def publish() -> None:
        while not over.wait(0.04):
            source.publish()

    thread = threading.Thread(target=publish, daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def test_body_effort_age_and_findings_are_shown_and_readable(browser: Browser, tmp_path: Path, pictures: Path) -> None:
    with served_live_page(tmp_path) as address:
        page = open_page(browser, address, 1366, 900)
        seen(page, "No live values")
        with LiveSource(tmp_path, findings=FINDINGS) as source, publishing(source):
            seen(page, re.compile(r"^lag 150 ms · values 0\.\d\d s old$"))
            seen(page, "SIMULATED DATA")
            for finding in FINDINGS:
                seen(page, finding.sentence)
            seen(page, re.compile(r"^best for this motion so far: 0\.71 m ± 0\.01, 9 % less effort"))
            page.wait_for_function(IS_DRAWN)
            expect(page.get_by_text("91 %").first).to_be_visible()
            expect(page.get_by_text("88 %").first).to_be_visible()
            assert unreadable(page) == []
            page.screenshot(path=pictures / "live.png")
            for width, height in ((1024, 768), (390, 844)):
                page.set_viewport_size({"width": width, "height": height})
                page.wait_for_function("document.documentElement.scrollWidth <= innerWidth")
                expect(page.get_by_role("slider")).to_be_visible()
            assert unreadable(page) == []


def test_old_values_are_marked_and_a_scaled_body_is_named(browser: Browser, tmp_path: Path) -> None:
    setup = live_setup(subject=LiveSubject("P07 scaled", is_scaled=True), origin="measured")
    with served_live_page(tmp_path) as address, LiveSource(tmp_path, setup) as source:
        page = open_page(browser, address)
        until(page, lambda: source.views == 1)
        source.publish(age_s=0.16)
        source.publish_nothing()
        seen(page, re.compile(r"^VALUES ARE \d+\.\d s OLD$"))
        assert "grayscale" in page.evaluate("getComputedStyle(document.querySelector('.live-grid')).filter")
        seen(page, "body: P07 scaled, scaled to the wearer")
        expect(page.get_by_text("SIMULATED DATA")).to_be_hidden()
        with publishing(source):
            expect(page.locator("body")).not_to_have_class(re.compile("old-data"))


def test_the_colour_of_a_muscle_is_its_activation_and_the_body_turns(browser: Browser, tmp_path: Path) -> None:
    with served_live_page(tmp_path) as address:
        page = open_page(browser, address)
        idle, half, full, unknown = (page.evaluate(DRAWN_AT, level) for level in (0.0, 0.5, 1.0, None))
        assert len({idle, half, full}) == 3 and unknown == idle
        page.mouse.move(200, 150)
        page.mouse.down()
        page.mouse.move(290, 190, steps=4)
        page.mouse.up()
        turned = page.locator("#made").evaluate("canvas => canvas.toDataURL()")
        assert turned != unknown
        page.mouse.dblclick(200, 150)
        assert page.locator("#made").evaluate("canvas => canvas.toDataURL()") == unknown


def test_two_pages_share_the_rest_length(browser: Browser, tmp_path: Path) -> None:
    with served_live_page(tmp_path) as address, LiveSource(tmp_path) as source, publishing(source):
        one, other = open_page(browser, address), open_page(browser, address)
        for page in (one, other):
            seen(page, "rest length of the cord: 0.700 m")
        for page, key, reached in (
            (one, "ArrowRight", "0.705"),
            (other, "ArrowRight", "0.710"),
            (one, "ArrowLeft", "0.705"),
        ):
            page.locator(".q-slider [tabindex]").focus()
            page.keyboard.press(key)
            for shown in (one, other):
                seen(shown, f"rest length of the cord: {reached} m")
        worn = [length for name, length in source.rest_lengths if name == "worn"]
        assert worn == pytest.approx([0.705, 0.71, 0.705])
        assert source.views == 1, "one subscription for all pages"


def test_a_frozen_page_gets_no_further_updates_and_holds_nothing_up(browser: Browser, tmp_path: Path) -> None:
    with served_live_page(tmp_path) as address, LiveSource(tmp_path) as source, publishing(source):
        frozen, other = open_page(browser, address), open_page(browser, address)
        sent: list[str] = []
        frozen.on(
            "websocket",
            lambda socket: socket.on("framereceived", lambda frame: "drawLive" in str(frame) and sent.append("")),
        )
        frozen.reload()
        until(frozen, lambda: len(sent) > 5)
        session = frozen.context.new_cdp_session(frozen)
        session.send("Debugger.enable")
        session.send("Debugger.pause")
        before, frame = len(sent), source.frame
        until(other, lambda: source.frame > frame + 50)  # 25 updates
        assert len(sent) - before <= 4, "two on their way, and what was sent while the page was being frozen"
        seen(other, re.compile(r"^lag 150 ms · values 0\.\d\d s old$"))
        session.send("Debugger.resume")
        until(other, lambda: len(sent) > before + 8)


@contextmanager
def served_live_page(folder: Path) -> Iterator[str]:
    """The address of the page with the values of this folder."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    child = Child(
        "tests.station.console.served",
        str(folder),
        str(port),
        stdout=subprocess.PIPE,
        text=True,
        env={name: value for name, value in os.environ.items() if not name.startswith("PYTEST")},
    )
    assert child.process.stdout is not None
    try:
        address = child.process.stdout.readline().strip()
        assert address == f"http://127.0.0.1:{port}/"
        yield address
    finally:
        child.ensure_ended()
        child.process.stdout.close()


@pytest.mark.timeout(600)
def test_frozen_closed_and_many_pages_do_not_affect_the_recording(polite_browser: Browser, tmp_path: Path) -> None:
    """Four pages and live values starve a small machine: the simulated world slows down, and no sample is lost."""
    warm_up(generic_plan(wearer_config(), tmp_path).plan)  # compiles what the first values would wait for
    config = write_config(tmp_path)
    config.write_text(f"{config.read_text()}{ENDLESS}\n[live]\nenabled = true\n")
    with ServedConsole(config, "--simulated") as console:
        page, live = open_page(polite_browser, console.address), open_page(polite_browser, f"{console.address}live")
        seen(live, "No live values")
        begin(page, "next: pose")
        frozen, closed = open_page(polite_browser, console.address), open_page(polite_browser, console.address)
        page.keyboard.press("a")
        for each in (page, frozen, closed):
            runs(each)
        seen(live, re.compile(r"^lag 150 ms · values \d+\.\d+ s old$|^VALUES ARE"))
        seen(live, "generic body")
        closed.close()
        for each in (live, frozen):  # they answer nothing any more
            session = each.context.new_cdp_session(each)
            session.send("Debugger.enable")
            session.send("Debugger.pause")
        page.keyboard.press("a")  # a second start, while the first runs: the key does nothing
        frozen_s = recorded_s(page)
        until(page, lambda: recorded_s(page) > frozen_s + 3.0)
        stop(page)
        seen(page, "Keep (k)")
    (recording,) = (tmp_path / "sessions").rglob("*.mcap")
    contents = read_contents(recording)
    assert contents.complete and not contents.gaps and contents.outcome is not None
    markers = contents.streams[MARKERS]
    assert markers.samples / markers.nominal_rate_hz > frozen_s + 3.0


def recorded_s(page: Page) -> float:
    """Duration of the recording that the page shows."""
    text = page.get_by_text(re.compile(r"^REC \d")).first.inner_text()
    return float(text.split()[1])
