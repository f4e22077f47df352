"""A letter is text in a field and a key elsewhere; what is typed survives the console."""

from pathlib import Path

import pytest
from playwright.sync_api import Browser, expect

from station.journal import Recorded, Setup, write_recorded, write_setup
from station.subject.subject_file import Cord, Subject, read_subject
from tests.station.console.browsing import open_page, seen
from tests.station.console.served import ServedConsole, write_config
from tests.station.console.test_wearer_in_a_browser import WEARER

pytestmark = pytest.mark.timeout(300)
MASS, NUMBER = "Body mass [kg]", "Session"


def test_a_letter_typed_in_a_field_is_text_and_no_button_shows_its_key(browser: Browser, tmp_path: Path) -> None:
    with ServedConsole(write_config(tmp_path)) as console:
        page = open_page(browser, console.address)
        subject, key = page.get_by_label("Subject code"), page.locator("footer .key").first
        subject.click()
        page.keyboard.type("P01b")
        expect(subject).to_have_value("P01b")
        expect(key).to_be_hidden()
        page.keyboard.press("Escape")
        expect(key).to_be_visible()
        seen(page, "New session")
    assert not (tmp_path / "sessions").exists()


def test_a_form_survives_a_new_console_and_describes_the_wearer_of_its_session(
    browser: Browser, tmp_path: Path
) -> None:
    config = write_config(tmp_path)
    config.write_text(config.read_text() + WEARER)
    with ServedConsole(config) as console:
        page = open_page(browser, console.address)
        page.get_by_label("Subject code").fill("P01")
        expect(page.get_by_label(NUMBER, exact=True)).to_have_value("1")
        page.get_by_label(NUMBER, exact=True).fill("4")
        page.get_by_label(MASS).fill("615")
        page.get_by_label("Rest length of the cord [m]").fill("0,73")
        page.get_by_text("files such as").wait_for()
        page.wait_for_function("station.keptForm('setup').rest === '0,73'")
    with ServedConsole(config, port=console.port):
        for label, value in (("Subject code", "P01"), (NUMBER, "4"), (MASS, "615")):
            expect(page.get_by_label(label, exact=True)).to_have_value(value)
        page.get_by_role("button", name="Begin").click()
        seen(page, "the body mass is '615', expected 20 to 300 kg")
        page.get_by_label(MASS).fill("61.5")
        page.get_by_role("button", name="Begin").click()
        page.get_by_role("button", name="Begin anyway").click()  # no device answers
        seen(page, "next: pose")
    expected = Subject(mass_kg=61.5, cord=Cord(rest_length_m=0.73))
    assert read_subject(tmp_path / "sessions" / "sub-P01_ses-4") == expected


def test_the_wearer_is_changed_in_an_open_session(browser: Browser, tmp_path: Path) -> None:
    config = write_config(tmp_path)
    config.write_text(config.read_text() + WEARER)
    with ServedConsole(config) as console:
        page = open_page(browser, console.address)
        page.get_by_label("Subject code").fill("P01")
        page.get_by_role("button", name="Begin").click()
        page.get_by_role("button", name="Begin anyway").click()
        page.get_by_role("button", name="Wearer (w)").click()
        dialog = page.get_by_role("dialog")
        dialog.get_by_label(MASS).fill("7")
        dialog.get_by_role("button", name="Save").click()
        seen(page, "the body mass is '7', expected 20 to 300 kg")
        dialog.get_by_label(MASS).fill("70")
        dialog.get_by_role("button", name="Save").click()
        dialog.wait_for(state="detached")
        page.get_by_role("button", name="Wearer (w)").click()
        expect(dialog.get_by_label(MASS)).to_have_value("70")
    assert read_subject(tmp_path / "sessions" / "sub-P01_ses-1").mass_kg == 70.0


def test_a_redrawn_view_keeps_the_focus_and_the_rest_of_a_word_is_no_command(browser: Browser, tmp_path: Path) -> None:
    folder = tmp_path / "sessions" / "sub-P01_ses-1"
    write_setup(folder, Setup("P01", "ab", ("hand",), 3, has_bounce=False))
    (folder / "a.mcap").write_text("no recording\n")
    write_recorded(folder, Recorded("a.mcap", "hand", "static", 1, "1", False, 0, "the mocap capture ended"))
    with ServedConsole(write_config(tmp_path)) as console:
        one, other = open_page(browser, console.address), open_page(browser, console.address)
        one.locator("button.session", has_text="P01, session 1").click()
        seen(other, "redo advised")
        one.clock.set_fixed_time(one.evaluate("Date.now()"))  # a word is typed, and a view redrawn, at one moment
        one.get_by_label("Note on this trial").focus()
        one.keyboard.type("sli")
        other.keyboard.press("k")
        seen(one, "next: hand, dynamic")
        one.keyboard.type("nnn")  # which skips three trials, where no word was begun
        one.get_by_text("next: hand, dynamic, repeat 1").click()  # ends the word
        skip = one.get_by_role("button", name="Skip this trial")
        skip.focus()
        for repeat in (2, 3):
            one.keyboard.press("Enter")
            seen(one, f"next: hand, static, repeat {repeat}" if repeat == 2 else "next: hand, dynamic, repeat 2")
            expect(skip).to_be_focused()
        one.keyboard.press("n")
        seen(one, "next: hand, static, repeat 3")
