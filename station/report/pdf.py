"""The report as PDF: the page as it is printed, by an installed Chromium, Chrome or Edge that Playwright drives."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import TYPE_CHECKING

from station.checksums import write_checksums, write_whole
from station.errors import StationError
from station.messages.message import Message
from station.messages.setup_messages import FolderCode

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Playwright

PDF_FILE = "report.pdf"
PROGRAMS = ("chromium", "chromium-browser", "google-chrome", "microsoft-edge")
"""On Linux by name; elsewhere Playwright finds the programs of CHANNELS."""
CHANNELS = ("chrome", "msedge")


class BrowserError(StationError):
    """No browser can print the page."""


def ensure_pdf() -> None:
    """Raises ModuleNotFoundError, before anything is fitted, without the extra `pdf`."""
    import playwright  # noqa: F401


def write_pdf(page: Path) -> Path:
    """Print report.html beside itself on A4 and return the path. Raises BrowserError without a browser."""
    from playwright.sync_api import Error, sync_playwright

    with sync_playwright() as playwright:
        browser = _launch(playwright, Error)
        try:
            tab = browser.new_page(java_script_enabled=False, offline=True)
            tab.goto(page.resolve().as_uri())
            tab.emulate_media(media="print", color_scheme="light")
            printed = tab.pdf(prefer_css_page_size=True, print_background=True, tagged=True, outline=True)
        finally:
            browser.close()
    path = page.with_name(PDF_FILE)
    write_whole(path, printed)
    write_checksums(path)
    return path


def _launch(playwright: Playwright, error: type[Exception]) -> Browser:
    """The first browser that starts: an installed one, then Playwright's own."""
    found = next(filter(None, map(shutil.which, PROGRAMS)), None)
    if found is not None:
        return playwright.chromium.launch(executable_path=found)
    reason = ""
    for channel in (*CHANNELS, None):
        try:
            return playwright.chromium.launch(channel=channel)
        except error as refused:
            reason = str(refused).splitlines()[0]
    raise BrowserError(Message(FolderCode.NO_BROWSER, {"reason": reason}))
