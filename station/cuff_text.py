"""Text of the figures of a cuff: stiffness k, damping c and migration."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from documents.interval import bracketed
from fitting.cuffs.wearable_cuff import Cuff
from fitting.uncertainty import Estimate

if TYPE_CHECKING:
    from fitting.cuffs.cuff_fit import CuffFit  # the console uses this file, and starts without the fit


@dataclass(frozen=True)
class ShownQuantity:
    """Symbol, unit with its scale from SI, and most decimals that the measurement bears."""

    symbol: str
    unit: str
    scale: float
    most_digits: int

    @property
    def heading(self) -> str:
        """Of a column."""
        return f"{self.symbol} [{self.unit}]"

    def text(self, estimate: Estimate | None, missing: str) -> str:
        """Value and 95 % interval in the unit."""
        if estimate is None:
            return missing
        return bracketed(estimate.value, estimate.ci95, self.scale, self.most_digits, is_limited=True)


SHOWN = {
    "stiffness": ShownQuantity("k", "N/m", 1.0, 0),
    "damping": ShownQuantity("c", "N s/m", 1.0, 1),
    "migration": ShownQuantity("migration", "mm", 1e3, 1),
}
"""By field of the fit."""


def of_cuff(fit: CuffFit | Cuff, quantity: str, text: str) -> str:
    """Add to the text of a stiffness, damping or migration that it is given by hand, or not identified."""
    if isinstance(fit, Cuff) and quantity in fit.given:
        return f"{text} (given by hand)"
    is_doubtful = quantity in fit.missing and getattr(fit, quantity) is not None
    return f"not identified: {text}" if is_doubtful else text
