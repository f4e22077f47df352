"""Text of a number with its 95 % interval, where the number of digits is chosen, or with its noun."""

from __future__ import annotations

import math
from collections.abc import Sequence
from string import Formatter
from typing import Any

SIGNIFICANT = 2
"""Significant digits of the half width."""
NO_WIDTH = 1e-12
"""Width relative to the number below which it is rounding, not uncertainty."""

UNBROKEN = "\u00a0"  # a line may end before an interval, not within it

Ends = Sequence[float] | None


def bracketed(
    value: float,
    ci95: Ends,
    scale: float = 1.0,
    digits: int = 0,
    censored: str | None = None,
    *,
    is_limited: bool = False,
) -> str:
    """`12.34 (12.21 to 12.47)`; without an interval, scale × value with `digits` decimals. An end that is only a bound
    (`censored`: low, high or both) is left out: `12.34 (up to 12.47)`, `12.34 (12.21 or more)`.

    is_limited: at most `digits` decimals, without an interval that they do not show
    """
    if ci95 is None or not has_width(ci95):
        return shown(scale * value, digits)
    decimals = significant_decimals(ci95, scale, digits)
    if is_limited:
        decimals = min(decimals, digits)
    low, high = (shown(end, decimals) for end in sorted(scale * end for end in ci95))
    if low == high:
        return shown(scale * value, decimals)
    texts = {"low": f"up to {high}", "high": f"{low} or more", "both": "interval open"}
    ends = texts.get(str(censored), f"{low} to {high}").replace(" ", UNBROKEN)
    return f"{shown(scale * value, decimals)} ({ends})"


def between(ci95: Sequence[float], scale: float = 1.0, digits: int = 0) -> str:
    """`12.21 to 12.47`."""
    digits = significant_decimals(ci95, scale, digits)
    low, high = sorted(scale * end for end in ci95)
    return f"{shown(low, digits)} to {shown(high, digits)}"


def plus_minus(value: float, ci95: Ends, scale: float = 1.0, digits: int = 0) -> str:
    """`12.34 ± 0.13`, with the half width of the interval; bracketed where its halves differ in these digits."""
    if ci95 is None or not has_width(ci95):
        return shown(scale * value, digits)
    decimals = significant_decimals(ci95, scale, digits)
    if abs(scale * (ci95[0] + ci95[1] - 2.0 * value)) > 10.0**-decimals:
        return bracketed(value, ci95, scale, digits)
    return f"{shown(scale * value, decimals)} ± {rounded(_half(ci95, scale), decimals)}"


def with_error(value: float, error: float) -> str:
    """`8515 ± 30`, with SIGNIFICANT digits of the standard error; six digits of the number without one."""
    ends = (value - error, value + error)
    if not has_width(ends):
        return f"{value:.6g}"
    digits = significant_decimals(ends)
    return f"{rounded(value, digits)} ± {rounded(error, digits)}"


def significant_decimals(ci95: Ends, scale: float = 1.0, otherwise: int = 0) -> int:
    """Decimals for SIGNIFICANT digits of the half width; `otherwise` without an interval."""
    if ci95 is None or not has_width(ci95):
        return otherwise
    half = _half(ci95, scale)
    if not math.isfinite(half):
        return otherwise
    exponent = int(f"{half:.{SIGNIFICANT - 1}e}".partition("e")[2])  # after rounding: 0.0996 is 0.10
    return max(0, SIGNIFICANT - 1 - exponent)


def has_width(ci95: Sequence[float]) -> bool:
    """Whether the interval shows an uncertainty."""
    return abs(ci95[1] - ci95[0]) > NO_WIDTH * abs(ci95[0])


def rounded(number: float, digits: int) -> str:
    """The number with `digits` decimals, without a negative zero."""
    return f"{number:z.{digits}f}"


def shown(number: float, digits: int) -> str:
    """The same with a minus sign instead of a hyphen: for people, not for programs."""
    return rounded(number, digits).replace("-", "−")


def counted(number: float, noun: str) -> str:
    """`1 frame`, `51 frames`."""
    return f"{number:.0f} {noun}{'' if round(number) == 1 else 's'}"


class CountingFormatter(Formatter):
    """Formats templates in which a figure may have its noun: `{count:frame}` is `1 frame` or `51 frames`."""

    def format_field(self, value: Any, format_spec: str) -> str:
        if format_spec[-2:-1].isalpha():  # a word, no presentation type
            return counted(float(value), format_spec)
        return str(super().format_field(value, format_spec))


def _half(ci95: Sequence[float], scale: float) -> float:
    return abs(scale * (ci95[1] - ci95[0])) / 2
