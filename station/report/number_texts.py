"""Numbers of the report with their source and their text: filters of its templates."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from documents.interval import bracketed, digits_of
from fitting.cuffs.cuff_fit import CuffFit
from fitting.cuffs.wearable_cuff import Cuff
from fitting.results.standing import Standing
from fitting.uncertainty import Estimate
from station.cuff_text import of_cuff
from station.report.located import Derivation, LocatedFloat, LocatedList
from station.report.sourced_number import Form, SourcedNumber, sourced

Shown = SourcedNumber | str
UNKNOWN, NOT_IDENTIFIED = "–", "not identified"


def estimate_text(estimate: Estimate | None, scale: float = 1.0) -> str:
    """Value and 95 % interval of a fit, for the titles of charts."""
    return NOT_IDENTIFIED if estimate is None else bracketed(estimate.value, estimate.ci95, scale)


def estimated(entry: Mapping[str, Any] | None, scale: float = 1.0) -> Shown:
    """Value and 95 % interval of an entry of cuffs.json."""
    return NOT_IDENTIFIED if _is_unknown(entry) else sourced(entry, Form.INTERVAL, scale)


def of_this_cuff(number: Shown, fit: CuffFit | Cuff, quantity: str) -> Shown:
    """The number with a remark if it is given by hand, or not identified."""
    if isinstance(number, str):
        return of_cuff(fit, quantity, number)
    return number.surrounded(of_cuff(fit, quantity, number.rendering.around))


def true_number(true: LocatedFloat, estimate: Estimate | None, scale: float = 1.0) -> SourcedNumber:
    """What is known exactly, with as many digits as the estimate above it."""
    return sourced(true, Form.FIXED, scale, digits_of(estimate.ci95 if estimate else None, scale))


def entry_number(entry: Mapping[str, Any] | None, scale: float = 1.0, digits: int = 3) -> Shown:
    """An entry {"value", "ci95"} of assessment.json; a dash where it is unknown.

    It has at most `digits` decimals: the interval of the fit alone would give it more than the total uncertainty bears.
    """
    return UNKNOWN if _is_unknown(entry) else sourced(entry, Form.LIMITED_INTERVAL, scale, digits)


def worn_number(entry: Mapping[str, Any] | None, scale: float = 1.0, digits: int = 3) -> Shown:
    """A parameter of a worn cuff, with its source where that is not the fit."""
    if entry is None or _is_unknown(entry):
        return UNKNOWN
    number = sourced(entry, Form.INTERVAL, scale, digits)
    return number.surrounded("{} (given by hand)") if entry.get("source") == Standing.BY_HAND else number


def saving(effort: Mapping[str, Any]) -> Shown:
    """`9.4 % less effort (2.1 to 15.2)` from an effort relative to that with a slack cord; `more` above 1."""
    return "effort not known" if _is_unknown(effort) else sourced(effort, Form.SAVING)


def fixed(number: Any, scale: float = 1.0, digits: int = 0) -> SourcedNumber:
    """A located number, or a vector, with `digits` decimals."""
    return sourced(number, Form.FIXED, scale, digits)


def length(found: LocatedList) -> SourcedNumber:
    """The number of entries of a located list."""
    return sourced(found, Form.GENERAL, derivation=Derivation.LENGTH)


def _is_unknown(entry: Mapping[str, Any] | None) -> bool:
    return not entry or entry["value"] is None
