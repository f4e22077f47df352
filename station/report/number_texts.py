"""Numbers and sentences of the report as text: filters of its templates."""

from __future__ import annotations

import re
from collections.abc import Mapping
from html import escape
from typing import Any

from jinja2.filters import do_mark_safe

from fitting.results.seal import Standing
from fitting.uncertainty import Estimate
from station.interval import bracketed, digits_of, rounded

_MIRRORED = {"low": "high", "high": "low"}
"""A bound of an effort is the other bound of what is saved."""


def estimate_text(estimate: Estimate | None, scale: float = 1.0) -> str:
    """Value and 95 % interval of a fit."""
    return "not identified" if estimate is None else bracketed(estimate.value, estimate.ci95, scale)


def true_text(true: float, estimate: Estimate | None, scale: float = 1.0) -> str:
    """What is known exactly, with as many digits as the estimate above it."""
    return rounded(scale * true, digits_of(estimate.ci95 if estimate else None, scale))


def entry_text(number: Mapping[str, Any] | None, scale: float = 1.0, digits: int = 3) -> str:
    """An entry {"value", "ci95"} of assessment.json; a dash where it is unknown.

    It has at most `digits` decimals: the interval of the fit alone would give it more than the total uncertainty bears.
    """
    if not number or number["value"] is None:
        return "–"
    censored = number.get("censored")
    return bracketed(number["value"], number.get("ci95"), scale, digits, censored, is_limited=True)


def worn_text(number: Mapping[str, Any] | None, scale: float = 1.0, digits: int = 3) -> str:
    """A parameter of a worn cuff, with its source where that is not the fit."""
    if not number or number["value"] is None:
        return "–"
    by_hand = number.get("source") == Standing.BY_HAND
    return f"{bracketed(number['value'], number.get('ci95'), scale, digits)}{' (given by hand)' if by_hand else ''}"


def saving_text(effort: Mapping[str, Any]) -> str:
    """`9.4 % less effort (2.1 to 15.2)` from an effort relative to that with a slack cord; `more` above 1."""
    if effort["value"] is None:
        return "effort not known"
    is_less = effort["value"] <= 1.0
    sign = -1.0 if is_less else 1.0
    ends = [sign * (end - 1.0) for end in effort.get("ci95") or ()]
    censored = effort.get("censored")
    text = bracketed(
        sign * (effort["value"] - 1.0),
        sorted(ends) or None,
        100.0,
        1,
        _MIRRORED.get(str(censored), censored) if is_less else censored,
        is_limited=True,
    )
    number, _, brackets = text.partition(" (")
    return f"{number} % {'less' if is_less else 'more'} effort" + (f" ({brackets}" if brackets else "")


def counted(count: int, noun: str) -> str:
    """`1 cuff`, `2 cuffs`."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def with_commands(sentence: object) -> str:
    """A sentence as HTML, its `commands` as code."""
    return do_mark_safe(re.sub(r"`([^`]+)`", r"<code>\1</code>", escape(str(sentence))))
