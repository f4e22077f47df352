"""The page while a trial runs: what is old is marked, charts and marks answer at once, markers are rotated."""

import re
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import psutil
import pytest
from playwright.sync_api import Browser, Page, expect

from tests.station.console.browsing import (
    begin,
    open_page,
    patience_ms,
    pause_clock,
    picture_updates,
    runs,
    seen,
    until,
)
from tests.station.console.served import ServedConsole, write_config

pytestmark = pytest.mark.timeout(600)
CHART = "getElement(Number(document.querySelector('.charts .nicegui-echart')?.id.slice(1)))?.chart?.getOption()"
LAST_POINT = f"() => {CHART}?.series[0].data.at(-1)?.[0]"
ZOOMED = f"axis => {{ const {{ start, end }} = {CHART}.dataZoom[axis]; return end - start < 100; }}"
MARKS = f"() => ({CHART}?.series[0].markLine?.data ?? []).map((mark) => mark.name)"
FOCUS_AFTER = """action => {
    const button = document.querySelector(".mark-button");
    if (!button?.checkVisibility()) return null;
    document.activeElement.blur();
    action === "click"
        ? button.click()
        : document.body.dispatchEvent(new KeyboardEvent("keydown", {...action, bubbles: true, cancelable: true}));
    return document.activeElement.placeholder ?? "no field";
}"""
"""Within one task of the browser: the console cannot answer before it returns."""


def begun(browser: Browser, console: ServedConsole) -> Page:
    """A page with a clock that the test moves, in a new session."""
    page = browser.new_page(viewport={"width": 1366, "height": 768})
    page.set_default_timeout(patience_ms())
    page.clock.install()
    page.goto(console.address)
    begin(page)
    return page


@pytest.mark.parametrize("death", ["killed", "frozen"])
def test_a_page_without_its_console_turns_grey_within_two_seconds_and_reconnects(
    browser: Browser, tmp_path: Path, death: str
) -> None:
    """Seconds of the page's own clock, which the test moves."""
    config = write_config(tmp_path)
    with ServedConsole(config, "--simulated") as console:
        page = begun(browser, console)
        lost = page.get_by_text("The console does not answer")
        pause_clock(page)
        if death == "killed":
            console.kill()
        else:
            psutil.Process(console.pid).suspend()
        for _ in range(20):
            page.clock.run_for(100)
            if death == "killed":
                page.evaluate("fetch('/beat').catch(() => null)")  # wall time, for the page's own to be refused
        assert lost.is_visible()
        box = page.locator(".console-lost > div").bounding_box()
        assert box is not None and abs(box["x"] + box["width"] / 2 - 683) < 20 and 150 < box["y"] < 450, "in the middle"
        assert "grayscale" in page.evaluate("getComputedStyle(document.querySelector('#app')).filter")
        page.keyboard.press("a")  # a key must neither act later nor be lost without a notice
        page.clock.resume()
        if death == "frozen":
            psutil.Process(console.pid).resume()
            expect(lost).to_be_hidden()
            expect(page.locator(".unconfirmed")).to_contain_text("not executed: Arm. ")
            seen(page, "next: hand, static, repeat 1")
        else:
            with ServedConsole(config, "--simulated", port=console.port):
                seen(page, "P01, session 1: hand")
                expect(lost).to_be_hidden()
                expect(page.locator(".unconfirmed")).to_contain_text("Arm")


def test_a_press_that_waits_in_the_connection_is_reported_only_when_the_console_had_time_to_confirm_it(
    browser: Browser, tmp_path: Path
) -> None:
    """It may still be executed, which no notice must deny."""
    with ServedConsole(write_config(tmp_path), "--simulated") as console:
        page = begun(browser, console)
        notice = page.locator(".unconfirmed")
        pause_clock(page)
        psutil.Process(console.pid).suspend()
        page.keyboard.press("a")
        page.clock.run_for(4900)
        assert not notice.is_visible()
        page.clock.run_for(200)
        assert "not confirmed: Arm" in notice.inner_text()
        page.keyboard.press("a")
        assert "not confirmed: Arm. " in notice.inner_text(), "the page is grey by then, and sends no further key"
        page.evaluate("station.confirmPress()")  # by the console, once the press has arrived
        assert not notice.is_visible()
        psutil.Process(console.pid).resume()


@pytest.fixture(scope="module")
def trial(shared_browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServedConsole]:
    """A console whose first trial does not end by itself."""
    config = write_config(tmp_path_factory.mktemp("trial"), hold_s=3600.0)
    with ServedConsole(config, "--simulated") as console:
        page = open_page(shared_browser, console.address)
        begin(page)
        page.keyboard.press("a")
        runs(page)
        page.context.close()
        yield console


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="the recorder is found by /proc")
def test_old_data_are_marked_while_the_console_answers(browser: Browser, trial: ServedConsole) -> None:
    page = browser.new_page()
    page.set_default_timeout(patience_ms())
    page.goto(trial.address)
    seen(page, re.compile(r"^data \d\.\d s old$"))
    recorder = psutil.Process(recorder_of(trial.pid))
    recorder.suspend()
    try:
        seen(page, re.compile(r"^DATA ARE \d+\.\d s OLD$"))
        expect(page.get_by_text("The console does not answer")).to_be_hidden()
    finally:
        recorder.resume()
    seen(page, re.compile(r"^data \d\.\d s old$"))


def test_a_page_that_does_not_draw_receives_no_further_updates(browser: Browser, trial: ServedConsole) -> None:
    """Else it would draw them one after the other when it can again, ever further behind."""
    frozen, other = open_page(browser, trial.address), open_page(browser, trial.address)
    sent, drawn_by_other = picture_updates(frozen), picture_updates(other)
    runs(frozen)
    frozen.wait_for_function("document.querySelector('.age').textContent.startsWith('data')")
    session = frozen.context.new_cdp_session(frozen)
    session.send("Debugger.enable")
    session.send("Debugger.pause")
    before, before_other = len(sent), len(drawn_by_other)
    until(other, lambda: len(drawn_by_other) > before_other + 12)
    assert len(sent) - before <= 4, "two on their way, and what was sent while the page was being frozen"
    session.send("Debugger.resume")
    until(other, lambda: len(sent) > before + 8)


def test_charts_show_marks_pause_zoom_and_scale(browser: Browser, trial: ServedConsole) -> None:
    page = open_page(browser, trial.address)
    updates = picture_updates(page)
    runs(page)
    page.keyboard.press("m")
    page.keyboard.type("coughed")
    page.keyboard.press("Enter")
    until(page, lambda: any(name.endswith(" coughed") for name in page.evaluate(MARKS)))
    expect(page.get_by_placeholder("name, then Enter")).not_to_be_focused()  # else the key is text
    page.keyboard.press("p")
    page.wait_for_function("document.body.classList.contains('paused')")
    seen_s, so_far = page.evaluate(LAST_POINT), len(updates)
    until(page, lambda: len(updates) > so_far + 5)
    assert page.evaluate(LAST_POINT) == seen_s, "paused"
    page.locator(".charts canvas").first.hover()
    page.mouse.wheel(0, -300)
    page.wait_for_function(ZOOMED, arg=0)
    assert not page.evaluate(ZOOMED, 1)
    page.keyboard.down("Shift")
    page.mouse.wheel(0, -300)
    page.keyboard.up("Shift")
    page.wait_for_function(ZOOMED, arg=1)
    page.locator(".charts canvas").first.dblclick()
    page.wait_for_function(f"() => ![0, 1].some({ZOOMED})")
    page.keyboard.press("p")
    until(page, lambda: page.evaluate(LAST_POINT) > seen_s)


def test_the_name_of_a_mark_has_the_focus_before_the_console_answers(browser: Browser, trial: ServedConsole) -> None:
    page = open_page(browser, trial.address)
    runs(page)
    seen(page, "hang weight 1 of 3")
    assert focus_after(page, "click") == "name, then Enter"
    mark = page.get_by_text(re.compile(r"^mark \d+ at \d+\.\d s is in the recording$")).first
    last = int(mark.inner_text().split()[1]) + 3
    for key in ("m", "M", "ь"):
        assert focus_after(page, {"key": key, "code": "KeyM"}) == "name, then Enter"
    page.keyboard.type("slips")  # with an s: Stop
    seen(page, re.compile(rf"^mark {last} at \d+\.\d s is in the recording$"))
    expect(page.get_by_placeholder("name, then Enter")).to_have_value("slips")
    page.keyboard.press("Enter")
    seen(page, re.compile(rf"^mark {last} at \d+\.\d s is in the recording: slips$"))
    runs(page)
    assert focus_after(page, {"key": "m", "code": "KeyM", "ctrlKey": True}) == "no field", "the browser's own"


def focus_after(page: Page, action: object) -> object:
    return page.wait_for_function(FOCUS_AFTER, arg=action).json_value()


def test_the_markers_are_rotated_by_the_mouse_and_reset(browser: Browser, trial: ServedConsole) -> None:
    page = open_page(browser, trial.address)
    page.evaluate("""() => {
        document.body.insertAdjacentHTML("beforeend",
            "<canvas id=space style='position:fixed;left:0;top:0;width:400px;height:300px;z-index:99'></canvas>");
        const at = [[0, 0, 0], [200, 0, 0], [0, 150, 0], [50, 50, 120], [90, 50, 120], null];
        const roles = ["anchor", "anchor", "anchor", "cuff", "rope", "rope"];
        window.drawMarkers("space", at.map((point, i) => ({name: `m${i}`, role: roles[i], at: point})));
    }""")
    canvas = page.locator("#space")
    upright = canvas.evaluate("canvas => canvas.toDataURL()")
    blank = page.evaluate(
        "() => Object.assign(document.createElement('canvas'), {width: 400, height: 300}).toDataURL()"
    )
    assert upright != blank
    page.mouse.move(200, 150)
    page.mouse.down()
    page.mouse.move(290, 190, steps=4)
    page.mouse.up()
    turned = canvas.evaluate("canvas => canvas.toDataURL()")
    assert turned != upright
    page.mouse.dblclick(200, 150)
    assert canvas.evaluate("canvas => canvas.toDataURL()") == upright


def recorder_of(console: int) -> int:
    """The process id of the console's recorder."""
    for path in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            words = path.read_text().rpartition(")")[2].split()
            if int(words[1]) == console and b"station.session.trial_daemon" in (path.parent / "cmdline").read_bytes():
                return int(path.parent.name)
    raise AssertionError("no trial is recorded")
