import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser

from tests.station.console.browsing import CHROMIUM, chromium
from tests.station.console.served import ServedConsole


@pytest.fixture(autouse=True, scope="session")
def served_by(request: pytest.FixtureRequest) -> None:
    if python := request.config.getoption("--served-by"):
        ServedConsole.python = str(Path(python).absolute())


@pytest.fixture(scope="session")
def anyio_backend() -> str:
    """Coroutines run in the event loop of the console's server."""
    return "asyncio"


def pytest_itemcollected(item: pytest.Item) -> None:
    """A test in a browser is slow, and skipped without Chromium."""
    if {"shared_browser", "polite_browser"} & set(getattr(item, "fixturenames", ())):
        item.add_marker(pytest.mark.slow)
        item.add_marker(pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine"))


@pytest.fixture(scope="module")
def shared_browser() -> Iterator[Browser]:
    """No longer than a module: asyncio does not run in the thread of Playwright."""
    with chromium(CHROMIUM) as launched:
        yield launched


@pytest.fixture
def browser(shared_browser: Browser) -> Iterator[Browser]:
    """Its pages are closed at the end of the test."""
    yield shared_browser
    for context in shared_browser.contexts:
        context.close()


@pytest.fixture
def polite_browser(tmp_path: Path) -> Iterator[Browser]:
    """At a low priority: a real bench's devices do not share a processor with the pages, and simulated ones do.

    Chromium that root runs raises its pages above everything else on the machine, unless it is not allowed to.
    """
    is_mighty = shutil.which("setpriv") is not None and os.geteuid() == 0
    humble = "setpriv --bounding-set=-sys_nice --inh-caps=-sys_nice" if is_mighty else ""
    polite = tmp_path / "chromium"
    polite.write_text(f'#!/bin/sh\nexec nice -n 19 {humble} {CHROMIUM} "$@"\n')
    polite.chmod(0o755)
    with chromium(polite) as launched:
        yield launched


@pytest.fixture
def pictures(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """Where screenshots go: the folder given by --pictures, or nowhere that lasts."""
    return Path(request.config.getoption("--pictures") or tmp_path)
