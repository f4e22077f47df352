"""A mark's name is typed at once: its letters are never commands, however slow the console is."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from playwright.sync_api import Browser, expect

from tests.station.console.browsing import CHROMIUM, begin, open_page, runs, seen, stop
from tests.station.console.served import ServedConsole, write_config

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine"),
    pytest.mark.timeout(400),
]

FOCUS_AFTER = """action => {
    document.activeElement.blur();
    action === "click"
        ? document.querySelector(".mark-button").click()
        : document.body.dispatchEvent(new KeyboardEvent("keydown", {...action, bubbles: true, cancelable: true}));
    return document.activeElement.placeholder;
}"""
"""Within one task of the browser: the console cannot answer before it returns."""


def test_the_name_of_a_mark_has_the_focus_before_the_console_answers(browser: Browser, tmp_path: Path) -> None:
    with ServedConsole(write_config(tmp_path, hold_s=600.0), "--simulated") as console:
        page = open_page(browser, console.address)
        begin(page)
        page.keyboard.press("a")
        runs(page)
        seen(page, "hang weight 1 of 3")
        for action in ("click", *({"key": key, "code": "KeyM"} for key in ("m", "M", "ь"))):
            assert page.evaluate(FOCUS_AFTER, action) == "name, then Enter"
        page.keyboard.type("slips")  # with an s: Stop
        seen(page, re.compile(r"^mark 4 at \d+\.\d s is in the recording$"))
        expect(page.get_by_placeholder("name, then Enter")).to_have_value("slips")
        page.keyboard.press("Enter")
        seen(page, re.compile(r"^mark 4 at \d+\.\d s is in the recording: slips$"))
        runs(page)
        assert page.evaluate(FOCUS_AFTER, {"key": "m", "code": "KeyM", "ctrlKey": True}) is None, "the browser's own"
        stop(page)
        seen(page, "Keep (k)")
