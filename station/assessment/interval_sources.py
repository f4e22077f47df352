"""What the intervals of an assessment contain, as text for the terminal, the findings and the report."""

from __future__ import annotations

from collections.abc import Sequence

TEXT = {
    "fit": "the fit of the cuffs",
    "donning": "their donning",
    "body": "body",
    "muscles": "muscles",
    "motion": "motion",
}
"""Group of sources → what it is called in a list that begins with the cuffs."""


def sources_text(sources: Sequence[str]) -> str:
    """Groups of sources: "the fit of the cuffs, their donning, body, muscles and motion"."""
    *others, last = (TEXT[source] for source in sources)
    return f"{', '.join(others)} and {last}" if others else last
