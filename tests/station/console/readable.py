"""Whether every word on a page can be read: its contrast, as the W3C's guidelines define it (WCAG 2.2, 1.4.3)."""

from __future__ import annotations

from typing import Any

from playwright.sync_api import Page

UNREADABLE = """
() => {
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


def unreadable(page: Page) -> list[str]:
    """The words with less than 4.5 : 1 (large ones 3 : 1) on a light page, and on a dark one."""
    found: list[Any] = []
    page.add_style_tag(content="* { transition: none !important; }")  # colours that fade are neither one nor the other
    for scheme in ("light", "dark"):
        page.emulate_media(color_scheme=scheme)  # type: ignore[arg-type]
        page.wait_for_function("dark => document.body.classList.contains('body--dark') === dark", arg=scheme == "dark")
        found += [f"{scheme}: {words}" for words in page.evaluate(UNREADABLE)]
    page.emulate_media(color_scheme="light")
    return found
