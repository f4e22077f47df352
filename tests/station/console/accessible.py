"""Faults of a page that keep people from using it, as axe-core finds them (Deque's rules for WCAG)."""

from __future__ import annotations

from pathlib import Path

import pytest
from playwright.sync_api import Page

AXE = Path.home() / ".cache" / "cuffstation" / "axe" / "node_modules" / "axe-core" / "axe.min.js"
needs_axe = pytest.mark.skipif(not AXE.is_file(), reason="axe-core is not installed here; .ci/run installs it with npm")

SERIOUS = """
async () => (await axe.run(document, { resultTypes: ["violations"] })).violations
    .filter(({ impact }) => ["serious", "critical"].includes(impact))
    .flatMap(({ id, nodes }) => nodes.map(({ target, failureSummary }) => `${id}: ${target} ${failureSummary}`))
"""


def serious_faults(page: Page) -> list[str]:
    """Serious and critical violations on the page as it is now."""
    if not page.evaluate("'axe' in window"):
        page.add_script_tag(path=AXE)
    return list(page.evaluate(SERIOUS))
