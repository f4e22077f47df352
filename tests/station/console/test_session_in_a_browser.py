"""A whole session as an operator does it: in a browser, on simulated devices, to the report."""

import json
import re
from datetime import datetime
from functools import partial
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from recordings.contents import Contents, read_contents
from tests.station.console.browsing import (
    arm,
    begin,
    buttons_are_in_view,
    check_until_ready,
    drawn,
    fits_on_the_screen,
    open_page,
    patience_ms,
    picture_updates,
    says_simulated,
    seen,
    stop,
    unreadable,
    until,
    was_shown,
)
from tests.station.console.served import ServedConsole, write_config

pytestmark = pytest.mark.timeout(600)


def the_recording(folder: Path, file: str = "sub-P01_ses-1_task-static_acq-hand_run-1.mcap") -> Contents:
    return read_contents(folder / "sessions" / "simulated" / "sub-P01_ses-1" / file)


def assert_whole(contents: Contents) -> None:
    assert contents.complete and not contents.gaps
    assert contents.outcome is not None and contents.outcome.accepted


def test_a_session_from_set_up_to_report_with_a_trial_redone(browser: Browser, tmp_path: Path, pictures: Path) -> None:
    with ServedConsole(write_config(tmp_path, migration_m=0.03), "--simulated", "--speed", "3") as console:
        page = open_page(browser, console.address)
        requested: set[str] = set()
        page.on("request", lambda request: requested.add(request.url))
        page.reload()
        set_up(page, pictures)
        record_with_a_mark(page, pictures)
        redo_as_advised(page, pictures)
        keep_both_trials(page)
        correct_in_the_list(page)
        finish(page, pictures)
        assert requested and all(url.startswith((console.address, "data:", "blob:")) for url in requested)
        report = page.request.get(f"{console.address}report", timeout=patience_ms())
        assert report.ok and "hand" in report.text() and "Simulated data" in report.text()
    assert_stored(tmp_path / "sessions" / "simulated" / "sub-P01_ses-1")


def set_up(page: Page, pictures: Path) -> None:
    """A name as the subject is warned of, the bench is checked, and the session begins."""
    page.get_by_label("Subject code").fill("Maria")
    seen(page, "this looks like a name")
    says_simulated(page)
    page.get_by_role("button", name="Check the bench").click()
    page.get_by_text("checks passed").click()
    seen(page, "NI Dev1: answers")
    seen(page, "the device is SIMULATED")
    seen(page, "disk:")
    page.get_by_label("Subject code").fill("P01")
    page.screenshot(path=pictures / "console-set-up.png")
    begin(page)


def record_with_a_mark(page: Page, pictures: Path) -> None:
    arm(page)
    was_shown(page, r"^REC \d")
    seen(page, "hand, static, repeat 1 of 1")
    seen(page, "trial 1 of 2 · subject P01 · session 1")
    before = drawn(page)
    page.keyboard.press("m")
    page.keyboard.type("coughed")  # at once: the text is the name of the mark, and no key
    page.keyboard.press("Enter")
    seen(page, re.compile(r"^mark 1 at \d+\.\d s is in the recording: coughed$"))
    until(page, partial(fits_on_the_screen, page))
    until(page, lambda: drawn(page) != before)
    says_simulated(page)
    was_shown(page, "hang weight 2 of 3")
    page.screenshot(path=pictures / "console-trial.png")  # four more loads are held: the trial still runs
    was_shown(page, r"take weight \d off")


def redo_as_advised(page: Page, pictures: Path) -> None:
    """The cuff slipped in the first static trial: to keep its migration measurable, it is donned anew."""
    seen(page, "the cuff slipped by 30 mm in this trial")
    says_simulated(page)
    page.screenshot(path=pictures / "console-redo.png")
    assert unreadable(page) == []
    seen(page, "The hand cuff may have migrated in this trial")
    expect(page.get_by_label("Name of mark 1")).to_have_value("coughed")
    page.keyboard.press("r")
    seen(page, "Don the hand cuff")


def keep_both_trials(page: Page) -> None:
    for test in ("static", "dynamic"):
        seen(page, f"next: hand, {test}, repeat 1")
        arm(page)
        seen(page, "Keep (k)")
        page.get_by_label("Reason (needed to redo)").fill("this cuff always slips so far")
        page.get_by_role("button", name="Keep").click()


def finish(page: Page, pictures: Path) -> None:
    page.get_by_role("button", name="Fit, assess and report (f)").click()
    page.get_by_role("link", name="Open the report").wait_for(timeout=patience_ms(400.0))
    says_simulated(page)
    page.screenshot(path=pictures / "console-end.png")
    assert unreadable(page) == []


def assert_stored(session: Path) -> None:
    """Every decision is in the journal, the fit finds the simulated stiffness, and no recording is lost."""
    lines = [json.loads(line) for line in (session / "session.jsonl").read_text().splitlines()]
    assert [line["kind"] for line in lines] == [
        *("setup", "recorded", "mark", "mark", "verdict", "donned", "recorded", "verdict", "recorded", "verdict"),
        *("undone", "verdict", "assigned", "assigned"),
    ]
    cuffs = json.loads((session / "cuffs.json").read_text())
    assert cuffs["cuffs"]["hand"]["stiffness_n_per_m"]["value"] == pytest.approx(8520, rel=0.02)
    assert cuffs["rejected"][0]["reason"].startswith("set aside by the operator: the cuff slipped")
    assert sorted(path.name for path in session.glob("*.mcap")) == [
        "sub-P01_ses-1_task-dynamic_acq-hand_run-1.mcap",
        "sub-P01_ses-1_task-static_acq-hand_run-1.mcap",
        "sub-P01_ses-1_task-static_acq-hand_run-2.mcap",
    ]


def correct_in_the_list(page: Page) -> None:
    """The last decision is undone and taken again; the dynamic trial is assigned to the static one, and back."""
    seen(page, "Every trial of the plan is accepted")
    page.keyboard.press("u")
    seen(page, "hand, dynamic, repeat 1:")
    page.keyboard.press("k")
    seen(page, "Every trial of the plan is accepted")
    for test, stands in (
        ("static", "next: hand, dynamic, repeat 1"),
        ("dynamic", "Every trial of the plan is accepted"),
    ):
        page.keyboard.press("t")
        row = page.get_by_role("dialog")
        row.get_by_role("combobox").nth(-2).click()
        page.get_by_role("option", name=test).click()
        row.get_by_role("button", name="Assign to this trial").last.click()
        seen(page, stands)
        row.wait_for(state="detached")  # a dialog takes keys until it has faded


def test_the_trial_of_a_killed_console_with_simulated_devices_is_not_lost(browser: Browser, tmp_path: Path) -> None:
    """The new console returns to the trial, or offers its session if the trial has ended meanwhile."""
    config, options = write_config(tmp_path, hold_s=3.0), ("--simulated", "--speed", "2")
    with ServedConsole(config, *options) as console:
        page = open_page(browser, console.address)
        begin(page)
        arm(page)
        was_shown(page, r"^REC \d")
        console.kill()
        page.close()
    with ServedConsole(config, *options) as console:
        page = open_page(browser, console.address)
        offered, kept = page.get_by_role("button", name="P01, session 1: hand"), page.get_by_role("button", name="Keep")
        returned = page.get_by_text("A trial of this session is being recorded")
        expect(offered.or_(kept).or_(returned)).to_be_visible()
        if offered.is_visible():
            offered.click()
        says_simulated(page)
        seen(page, "Keep (k)")
        page.keyboard.press("k")
        seen(page, "next: hand, dynamic, repeat 1")
    assert_whole(the_recording(tmp_path))


def test_a_rehearsal_by_keyboard_is_readable_on_a_tablet_in_light_and_dark(browser: Browser, tmp_path: Path) -> None:
    config = write_config(tmp_path, hold_s=300.0)  # the operator ends the trial
    config.write_text(config.read_text() + "[safety]\nforce_ceiling_n = 10\n")
    with ServedConsole(config, "--simulated", "--speed", "2") as console:
        page = open_page(browser, console.address, width=1024, height=768)
        updates = picture_updates(page)
        expect(page.get_by_label("Subject code")).to_be_focused()
        page.keyboard.type("P02")
        assert unreadable(page) == [], "a field that is being filled in"
        page.keyboard.press("Escape")  # leaves the field: from here on keys act
        page.keyboard.press("c")
        check_until_ready(page)
        assert unreadable(page) == []
        press_tab_until(page, "Rehearse (r)")
        page.keyboard.press("Enter")
        seen(page, "REHEARSAL")
        assert unreadable(page) == []
        page.get_by_role("switch").focus()  # keys act wherever the focus is
        arm(page)
        seen(page, "STOP: ")
        page.wait_for_function("window.stationAudio !== undefined")
        until(page, partial(fits_on_the_screen, page))  # an alarm, too
        page.keyboard.press("i")
        expect(page.get_by_role("button", name="Silence the alarm")).to_be_hidden()
        assert unreadable(page) == []
        until(page, partial(fits_on_the_screen, page))
        page.keyboard.press("Control+s")  # the browser's own
        page.get_by_role("button", name="Mark (m)").click()
        page.keyboard.type("saw")
        page.keyboard.press("Escape")  # leaves the note
        page.keyboard.press("e")
        seen(page, "End this trial now and skip to the report of the trials so far?")
        page.keyboard.press("n")
        so_far = len(updates)
        until(page, lambda: len(updates) >= so_far + 5)
        stop(page)
        seen(page, "stopped by the operator")
        seen(page, "Keep (k)")
        assert unreadable(page) == []
        page.get_by_label("Reason (needed to redo)").fill("")
        page.keyboard.press("Escape")
        page.keyboard.press("r")
        seen(page, "to be repeated without a reason")
        for width, height in ((1024, 768), (1366, 768)):
            page.set_viewport_size({"width": width, "height": height})
            until(page, partial(buttons_are_in_view, page))  # a refusal covers none
        page.keyboard.press("k")
        seen(page, "next: hand, dynamic")
        press_tab_until(page, "Session list (l)")
        page.keyboard.press("Enter")
        seen(page, "New session")
    assert not (tmp_path / "sessions").exists()


def test_two_operators_share_a_session_that_is_ended_during_a_trial_and_resumed(
    browser: Browser, tmp_path: Path
) -> None:
    config = write_config(tmp_path, hold_s=4.0, swing_s=3600.0)  # the operator ends the dynamic trial
    with ServedConsole(config, "--simulated", "--speed", "3") as console:
        page = record_with_two_operators(browser, console)
        arm(page)
        seen(page, "pull the spring")
        page.keyboard.press("e")
        seen(page, "End this trial now and skip to the report of the trials so far?")
        page.keyboard.press("y")
        seen(page, "1 of 2 trials of the plan are accepted")
        seen(page, "waits for a decision; the fit uses it unless it is redone")
        assert_whole(the_recording(tmp_path))
        assert len(list((tmp_path / "sessions").rglob("*.mcap"))) == 2, "two clicks on Arm began one static trial"
        page.keyboard.press("f")
        page.get_by_role("link", name="Open the report").wait_for(timeout=patience_ms(400.0))
        assert page.request.get(f"{console.address}report", timeout=patience_ms()).ok
        page.keyboard.press("b")
        seen(page, "hand, dynamic, repeat 1")
        page.keyboard.press("l")
        row = page.get_by_role("button", name="P01, session 1: hand")
        expect(row).to_contain_text("1 of 2 trials")
        expect(page.get_by_role("button", name="Resume P01, session 1")).to_be_visible()  # above the list
        expect(row).to_contain_text(f"{datetime.now().astimezone():%Y}")


def record_with_two_operators(browser: Browser, console: ServedConsole) -> Page:
    """Both see the same, only one trial runs, and it is recorded although the page that began it is closed."""
    one, other = open_page(browser, console.address), open_page(browser, console.address)
    begin(one)
    seen(other, "next: hand, static, repeat 1")
    buttons = [page.get_by_role("button", name="Arm (a)") for page in (one, other)]
    for button in buttons:  # without waiting: the second click may come before the page has changed
        button.dispatch_event("click")
    for page in (one, other):
        was_shown(page, r"^REC \d")
    other.keyboard.press("m")
    one.close()
    again = open_page(browser, console.address, 1366, 768)
    stop_or_keep = again.get_by_role("button", name="Stop (s)").or_(again.get_by_role("button", name="Keep (k)"))
    expect(stop_or_keep).to_be_visible()
    for page in (again, other):
        seen(page, "Keep (k)")
    again.keyboard.press("k")
    seen(other, "next: hand, dynamic, repeat 1")
    other.close()
    seen(again, "next: hand, dynamic")
    return again


def press_tab_until(page: Page, button: str) -> None:
    for _ in range(200):  # a view that is drawn anew meanwhile takes the focus back to its start
        if page.evaluate("document.activeElement.innerText") == button:
            return
        page.keyboard.press("Tab")
    raise AssertionError(f"no Tab leads to {button}")
