"""A number and its 95 % interval in words: the one place where their digits are chosen."""

from __future__ import annotations

import math
from collections.abc import Sequence

from fitting.result import CuffFit
from fitting.wearable_cuff import WearableCuff

SIGNIFICANT = 2
"""Digits of the half width that are told: with fewer nobody sees how wide an interval is, more are noise."""
NO_WIDTH = 1e-12
"""Widths below this part of the number are rounding, not uncertainty."""

UNBROKEN = "\u00a0"  # a line may end before an interval, not within it

Ends = Sequence[float] | None


def bracketed(value: float, ci95: Ends, scale: float = 1.0, digits: int = 0) -> str:
    """`12.34 (12.21 to 12.47)`; scale × the number, alone and to `digits` decimals where there is no interval."""
    if ci95 is None or not has_width(ci95):
        return rounded(scale * value, digits)
    ends = between(ci95, scale, digits).replace(" ", UNBROKEN)
    return f"{rounded(scale * value, digits_of(ci95, scale, digits))} ({ends})"


def between(ci95: Sequence[float], scale: float = 1.0, digits: int = 0) -> str:
    """`12.21 to 12.47`."""
    digits = digits_of(ci95, scale, digits)
    low, high = sorted(scale * end for end in ci95)
    return f"{rounded(low, digits)} to {rounded(high, digits)}"


def plus_minus(value: float, ci95: Ends, scale: float = 1.0, digits: int = 0) -> str:
    """`12.34 ± 0.13`, which is half of the interval."""
    if ci95 is None or not has_width(ci95):
        return rounded(scale * value, digits)
    digits = digits_of(ci95, scale, digits)
    return f"{rounded(scale * value, digits)} ± {rounded(_half(ci95, scale), digits)}"


def of_cuff(fit: CuffFit | WearableCuff, quantity: str, words: str) -> str:
    """The words for a cuff's stiffness, damping or migration; a figure that nobody should wear is told as such."""
    if isinstance(fit, WearableCuff) and quantity in fit.given:
        return f"{words} (given by hand)"
    is_doubtful = quantity in fit.missing and getattr(fit, quantity) is not None
    return f"not identified: {words}" if is_doubtful else words


def digits_of(ci95: Ends, scale: float = 1.0, otherwise: int = 0) -> int:
    """Decimals that show two figures of the interval's half width; `otherwise` where there is none."""
    if ci95 is None or not has_width(ci95):
        return otherwise
    half = _half(ci95, scale)
    if not math.isfinite(half):
        return otherwise
    exponent = int(f"{half:.{SIGNIFICANT - 1}e}".partition("e")[2])  # of what is rounded: 0.0996 is 0.10
    return max(0, SIGNIFICANT - 1 - exponent)


def has_width(ci95: Sequence[float]) -> bool:
    """Whether there is any uncertainty in it; where there is none, none is told."""
    return abs(ci95[1] - ci95[0]) > NO_WIDTH * abs(ci95[0])


def rounded(number: float, digits: int) -> str:
    """Never "-0.00"."""
    return f"{number:z.{digits}f}"


def _half(ci95: Sequence[float], scale: float) -> float:
    return abs(scale * (ci95[1] - ci95[0])) / 2
