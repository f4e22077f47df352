"""Units in which a study is shown, and its numbers with as many digits as their intervals bear."""

from __future__ import annotations

from documents.interval import between, bracketed, shown
from station.study.study_document import EffectEntry, StudyFigure

SHOWN = {"stiffness": (1.0, "N/m"), "damping": (1.0, "N s/m"), "migration": (1e3, "mm")}
"""Quantity → factor from SI, unit."""
OPEN = "not estimated"


def shown_effect(effect: EffectEntry | None, quantity: str) -> str:
    """Value and 95 % interval in the shown unit."""
    return OPEN if effect is None else bracketed(effect.value, effect.ci95, SHOWN[quantity][0])


def shown_figure(figure: StudyFigure, scale: float, digits: int = 0) -> str:
    """Value and 95 % interval; an upper end that is not found is open."""
    if figure.value is None:
        return OPEN
    if figure.ci95 is None or None in figure.ci95:
        low = figure.ci95[0] if figure.ci95 else None
        above = "" if low is None else f" (above {shown(scale * low, digits)})"
        return shown(scale * figure.value, digits) + above
    ends = (figure.ci95[0] or 0.0, figure.ci95[1] or 0.0)
    return bracketed(figure.value, ends, scale, digits)


def shown_range(ends: tuple[float, float], quantity: str) -> str:
    """Both ends with as many digits as two figures of half their distance."""
    return between(ends, SHOWN[quantity][0])
