"""A number of the report with its source and the rule by which it became text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

from documents.interval import Ends, between, bracketed, plus_minus, rounded
from station.report.located import Derivation, Source

_MIRRORED = {"low": "high", "high": "low"}
"""A bound of an effort is the other bound of what is saved."""


class Form(StrEnum):
    """Rule that makes a text of a number."""

    INTERVAL = "interval"
    """Value and 95 % interval, with two digits of its half width; `digits` decimals without an interval."""
    LIMITED_INTERVAL = "limited_interval"
    """As interval, with at most `digits` decimals, and without an interval that they do not show."""
    RANGE = "range"
    """Both ends of an interval, with two digits of its half width."""
    PLUS_MINUS = "plus_minus"
    """Value ± half width, with two digits of it."""
    SAVING = "saving"
    """An effort relative to that with a slack cord, as per cent less or more."""
    FIXED = "fixed"
    """`digits` decimals."""
    GENERAL = "general"
    """Up to six digits, without trailing zeros."""
    TEXT = "text"
    """A sentence of the source, as it is."""
    BUSHING = "bushing"
    """An element of OpenSim with the stiffness and damping of the cuff at the source."""


@dataclass(frozen=True)
class Rendering:
    """Form of a text; it shows scale × value. around is the text around the number, whose place is in its braces."""

    form: Form
    scale: float = 1.0
    digits: int = 0
    around: str = "{}"


Value = float | str | tuple[float, ...]


@dataclass(frozen=True)
class SourcedNumber:
    """A number of the report; str() is its text. A sentence with numbers is one, too, and so is a vector.

    recordings  on which it rests, None for those that the result of its source was computed from
    """

    value: Value
    source: Source
    rendering: Rendering
    ci95: tuple[float, float] | None = None
    censored: str | None = None
    recordings: tuple[str, ...] | None = None

    def __str__(self) -> str:
        return self.rendering.around.replace("{}", _text(self))

    def surrounded(self, around: str) -> SourcedNumber:
        """The number with more text around it."""
        return replace(self, rendering=replace(self.rendering, around=around))


def sourced(
    number: Any,
    form: Form,
    scale: float = 1.0,
    digits: int = 0,
    derivation: Derivation = Derivation.VALUE,
    ci95: Sequence[float] | None = None,
) -> SourcedNumber:
    """The number of a located entry {"value", "ci95"}, or of a located number, list or text.

    ci95: interval of a number alone, which is beside it under its key with `_ci95`

    Raises AttributeError for a value without a place (station/report/located.py).
    """
    is_entry = isinstance(number, Mapping) and derivation is Derivation.VALUE
    entry = number if is_entry else {"value": reduced(number, derivation)}
    found = entry["value"]
    ci95 = entry.get("ci95") or ci95
    return SourcedNumber(
        tuple(found) if isinstance(found, list) else str(found) if isinstance(found, str) else found,
        replace(number.source, derivation=derivation),
        Rendering(form, scale, digits),
        (ci95[0], ci95[1]) if ci95 else None,
        entry.get("censored"),
    )


def reduced(found: Any, derivation: Derivation) -> Any:
    """The number that follows from what a pointer gives."""
    if derivation is Derivation.LENGTH:
        return len(found)
    return sum(found) if derivation is Derivation.SUM else found


def _text(number: SourcedNumber) -> str:
    value = number.value
    return value if isinstance(value, str) else _number_text(value, number).replace("-", "−")


def _number_text(value: float | tuple[float, ...], number: SourcedNumber) -> str:
    form = number.rendering.form
    scale, digits = number.rendering.scale, number.rendering.digits
    if isinstance(value, tuple):
        is_range = form is Form.RANGE
        return between(value, scale) if is_range else ", ".join(_single(one, form, scale, digits) for one in value)
    if form in (Form.INTERVAL, Form.LIMITED_INTERVAL):
        is_limited = form is Form.LIMITED_INTERVAL
        return bracketed(value, number.ci95, scale, digits, number.censored, is_limited=is_limited)
    if form is Form.PLUS_MINUS:
        return plus_minus(value, number.ci95, scale, digits)
    return _saving(value, number.ci95, number.censored) if form is Form.SAVING else _single(value, form, scale, digits)


def _single(value: float, form: Form, scale: float, digits: int) -> str:
    return f"{scale * value:g}" if form is Form.GENERAL else rounded(scale * value, digits)


def _saving(effort: float, ci95: Ends, censored: str | None) -> str:
    """`9.4 % less effort (2.1 to 15.2)` from an effort relative to that with a slack cord; `more` above 1."""
    is_less = effort <= 1.0
    sign = -1.0 if is_less else 1.0
    ends = sorted(sign * (end - 1.0) for end in ci95 or ())
    mirrored = _MIRRORED.get(str(censored), censored) if is_less else censored
    text = bracketed(sign * (effort - 1.0), ends or None, 100.0, 1, mirrored, is_limited=True)
    number, _, brackets = text.partition(" (")
    return f"{number} % {'less' if is_less else 'more'} effort" + (f" ({brackets}" if brackets else "")
