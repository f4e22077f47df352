"""Text of a figure of a cuff."""

from __future__ import annotations

from typing import TYPE_CHECKING

from fitting.cuffs.wearable_cuff import Cuff

if TYPE_CHECKING:
    from fitting.cuffs.cuff_fit import CuffFit  # the console uses this file, and starts without the fit


def of_cuff(fit: CuffFit | Cuff, quantity: str, text: str) -> str:
    """Add to the text of a stiffness, damping or migration that it is given by hand, or not identified."""
    if isinstance(fit, Cuff) and quantity in fit.given:
        return f"{text} (given by hand)"
    is_doubtful = quantity in fit.missing and getattr(fit, quantity) is not None
    return f"not identified: {text}" if is_doubtful else text
