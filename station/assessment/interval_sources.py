"""What the intervals of an assessment contain, as text for the terminal, the findings and the report."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from solver.suit.uncertainty import DrawnSource

TEXT = {DrawnSource.CUFFS: "the cuffs' fit", DrawnSource.MOTIONS: "the wearer's posture"}


def sources_text(sources: Iterable[DrawnSource]) -> str:
    """Sources of the draws: "the cuffs' fit and the wearer's posture"."""
    return " and ".join(TEXT[source] for source in sources)


def sources_of(assessment: Mapping[str, Any]) -> tuple[DrawnSource, ...]:
    """Sources of the draws behind the intervals in assessment.json; empty without intervals.

    A file of an older station does not name them: it drew cuffs and, for a wearer, motions.
    """
    uncertainty = assessment.get("uncertainty")
    if not uncertainty:
        return ()
    otherwise = [DrawnSource.CUFFS, *([DrawnSource.MOTIONS] if assessment.get("subject") else [])]
    return tuple(DrawnSource(source) for source in uncertainty.get("sources", otherwise))
