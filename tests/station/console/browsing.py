"""A browser that looks at a console's page, for tests that see what an operator sees."""

import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Error, Page, expect, sync_playwright

from station.report.page import browser_path
from tests.timeout import scaled_timeout

CHROMIUM = browser_path()
PATIENCE_S = 120.0
CHECKS = 5
AXE = Path.home() / ".cache" / "cuffstation" / "axe" / "node_modules" / "axe-core" / "axe.min.js"
needs_axe = pytest.mark.skipif(not AXE.is_file(), reason="axe-core is not installed here; .ci/run installs it with npm")
SERIOUS = """
async () => {
    const isOld = () => document.body.classList.contains("old-data");
    let wasOld = isOld();
    const watch = new MutationObserver(() => { wasOld ||= isOld(); });
    watch.observe(document.body, { attributes: true });
    const { violations } = await axe.run(document, { resultTypes: ["violations"] });
    watch.disconnect();
    return wasOld ? null : violations.filter(({ impact }) => ["serious", "critical"].includes(impact))
        .flatMap(({ id, nodes }) => nodes.map(({ target, failureSummary }) => `${id}: ${target} ${failureSummary}`));
}
"""
"""Null while the page shows old data, which are faded: a busy machine may deliver none for seconds."""
PATIENT = """
(() => {
    const ask = window.fetch;
    window.fetch = (url, options) => url === "/beat" ? ask(url, {cache: "no-store"}) : ask(url, options);
    window.shownTexts = new Set();
    const note = () => [...document.querySelectorAll(".cue, .rec")].filter(line => line.checkVisibility())
        .forEach(line => shownTexts.add(line.textContent));
    new MutationObserver(note).observe(document, {subtree: true, childList: true, characterData: true});
})()
"""
"""No request for the console's heartbeat is given up, and the lines that change during a trial are kept."""
UNREADABLE = """
() => {
    if (document.body.classList.contains("old-data")) return null;
    const parts = colour => (colour.match(/[\\d.]+/g) || []).map(Number);
    const over = (top, below) => {
        const alpha = top.length > 3 ? top[3] : 1;
        return [0, 1, 2].map(i => alpha * top[i] + (1 - alpha) * below[i]);
    };
    const luminance = rgb => {
        const [r, g, b] = rgb.map(v => v / 255).map(v => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
        return 0.2126 * r + 0.7152 * g + 0.0722 * b;
    };
    const ancestors = element => element ? [...ancestors(element.parentElement), element] : [];
    const found = [];
    const words = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
    while (words.nextNode()) {
        const text = words.currentNode.textContent.trim(), element = words.currentNode.parentElement;
        const box = element.getBoundingClientRect();
        if (!text || !element.checkVisibility({visibilityProperty: true}) || box.width < 2 || box.height < 2) continue;
        if (element.closest("script, style, [disabled], .q-icon, .q-tooltip")) continue;
        let back = [255, 255, 255], opacity = 1;
        for (const each of ancestors(element)) {
            back = over(parts(getComputedStyle(each).backgroundColor), back);
            opacity *= Number(getComputedStyle(each).opacity);
        }
        const style = getComputedStyle(element), ink = parts(style.color);
        const shown = over([...ink.slice(0, 3), (ink[3] ?? 1) * opacity], back);
        const [dark, light] = [luminance(shown), luminance(back)].sort((a, b) => a - b);
        const contrast = (light + 0.05) / (dark + 0.05), size = parseFloat(style.fontSize);
        const isLarge = size >= 24 || (size >= 18.66 && Number(style.fontWeight) >= 700);
        if (contrast < (isLarge ? 3 : 4.5)) found.push(`${text}: ${contrast.toFixed(1)} at ${size} px`);
    }
    return found;
}
"""


def patience_ms(seconds: float = PATIENCE_S) -> float:
    return 1000 * scaled_timeout(seconds)


@contextmanager
def chromium(path: Path | str | None) -> Iterator[Browser]:
    expect.set_options(timeout=patience_ms())
    with sync_playwright() as playwright:
        # Chromium kills its process for graphics after seconds without an answer, and then ends itself.
        launched = playwright.chromium.launch(executable_path=path, args=["--no-sandbox", "--disable-gpu-watchdog"])
        yield launched
        launched.close()


def open_page(browser: Browser, address: str, width: int = 1280, height: int = 800) -> Page:
    """A page that waits for its console as long as a busy machine keeps the console from answering.

    Pages whose test is of a console that does not answer are opened without it.
    """
    page = browser.new_page(viewport={"width": width, "height": height})
    page.set_default_timeout(patience_ms())
    page.add_init_script(PATIENT)
    page.goto(address)
    return page


def begin(page: Page, first: str = "next: hand") -> None:
    page.get_by_label("Subject code").fill("P01")
    page.get_by_label("Operator").fill("ab")
    page.get_by_role("button", name="Begin").click()
    begun, anyway = page.get_by_text(first), page.get_by_role("button", name="Begin anyway")
    expect(begun.or_(anyway)).to_be_visible()
    if anyway.is_visible():  # on a busy machine, the simulated devices may answer the check too late
        anyway.click()
    expect(begun).to_be_visible()


def check_until_ready(page: Page) -> None:
    """The bench is ready; on a busy machine, the simulated devices may answer the first checks too late."""
    ready, not_ready = (page.get_by_text(re.compile(verdict)) for verdict in ("^Ready", "^Not ready"))
    for _ in range(CHECKS):
        expect(ready.or_(not_ready)).to_be_visible()
        if ready.is_visible():
            return
        verdict = not_ready.element_handle()
        page.get_by_role("button", name="Check the bench").click()
        verdict.wait_for_element_state("hidden")
    raise AssertionError(f"not ready in {CHECKS} checks")


def arm(page: Page) -> None:
    """Begin the trial that is next; was_shown() is of this one."""
    page.evaluate("shownTexts.clear()")
    page.keyboard.press("a")


def stop(page: Page) -> None:
    """End the recording that runs, and confirm."""
    page.keyboard.press("s")
    seen(page, "End this recording now?")
    page.keyboard.press("y")


def fits_on_the_screen(page: Page) -> bool:
    """Whether nothing has to be scrolled, and every button is in view and covered by nothing."""
    return bool(
        page.evaluate("""() => {
            const middle = document.querySelector(".nicegui-content");
            return document.documentElement.scrollHeight <= innerHeight && middle.scrollHeight <= middle.clientHeight;
        }""")
    ) and buttons_are_in_view(page)


def buttons_are_in_view(page: Page) -> bool:
    return bool(
        page.evaluate("""() => [...document.querySelectorAll("footer button")]
            .filter((button) => button.checkVisibility()).every((button) => {
                const box = button.getBoundingClientRect();
                const top = document.elementFromPoint(box.x + box.width / 2, box.y + box.height / 2);
                return box.bottom <= innerHeight && box.right <= innerWidth && button.contains(top);
            })""")
    )


def drawn(page: Page) -> str:
    """The first curve's picture as it is now."""
    return str(page.locator("canvas").first.evaluate("canvas => canvas.toDataURL()"))


def says_simulated(page: Page) -> None:
    expect(page.get_by_text("SIMULATED DATA", exact=True)).to_be_visible()


def seen(page: Page, words: str | re.Pattern[str]) -> None:
    expect(page.get_by_text(words).first).to_be_visible()


def runs(page: Page) -> None:
    """Of a trial without an end; was_shown() is for others, which may end before a busy machine has looked."""
    seen(page, re.compile(r"^REC \d"))


def was_shown(page: Page, words: str) -> None:
    """A recording, or an instruction: they change every few seconds, less than a busy machine needs to look.

    They are those since arm(), or since the page was opened. words is a regular expression of JavaScript.
    """
    page.wait_for_function("words => [...shownTexts].some(text => new RegExp(words).test(text))", arg=words)


def pause_clock(page: Page) -> None:
    """Stop the page's own clock, when its console has just answered and no further request is on its way.

    A time in the past is refused, but the clock then stands: the second attempt cannot be late.
    """
    soon_s = "Date.now() / 1000 + 0.01"
    with suppress(Error):
        page.clock.pause_at(page.evaluate(soon_s))
    page.clock.pause_at(page.evaluate(soon_s))
    page.evaluate("fetch('/beat').then(answer => answer.json())")
    expect(page.get_by_text("The console does not answer")).to_be_hidden()


def picture_updates(page: Page) -> list[float]:
    """Wall time at which each update of a trial's curves reached the page [s], from its next loading on."""
    sent: list[float] = []

    def take(frame: bytes | str) -> None:
        if "station.draw" in str(frame):
            sent.append(time.perf_counter())

    page.on("websocket", lambda socket: socket.on("framereceived", take))
    page.reload()
    return sent


def until(page: Page, is_met: Callable[[], bool]) -> None:
    """Returns once it holds; meanwhile the browser's events are taken."""
    give_up_s = time.perf_counter() + patience_ms() / 1000
    while not is_met():
        assert time.perf_counter() < give_up_s, "waited in vain"
        page.wait_for_timeout(50)


# Faults of a page that keep people from using it, as axe-core finds them (Deque's rules for WCAG).


def serious_faults(page: Page) -> list[str]:
    """Serious and critical violations on the page as it is now."""
    if not page.evaluate("'axe' in window"):
        page.add_script_tag(path=AXE)
    faults = None
    while faults is None:
        page.wait_for_function("!document.body.classList.contains('old-data')")
        faults = page.evaluate(SERIOUS)
    return list(faults)


# Whether every word on a page can be read: its contrast, as the W3C's guidelines define it (WCAG 2.2, 1.4.3).


def unreadable(page: Page) -> list[str]:
    """The words with less than 4.5 : 1 (large ones 3 : 1) on a light page, and on a dark one."""
    found: list[Any] = []
    page.add_style_tag(content="* { transition: none !important; }")  # colours that fade are neither one nor the other
    for scheme in ("light", "dark"):
        page.emulate_media(color_scheme=scheme)  # type: ignore[arg-type]
        page.wait_for_function("dark => document.body.classList.contains('body--dark') === dark", arg=scheme == "dark")
        found += [f"{scheme}: {words}" for words in page.wait_for_function(UNREADABLE).json_value()]
    page.emulate_media(color_scheme="light")
    return found
