"""A cuff that turns or bends under load: its markers go different ways, and their middle is not the rope's place."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

TURN_NOTE = 0.5e-3
"""Metres by which the cuff's markers part under the trial's load, from which a reader should know."""


def turn_notes(turn: NDArray[np.float64], force: NDArray[np.float64]) -> tuple[str, ...]:
    """A note where the cuff's markers part with the load, from their rms (frames,) [m] and the force (frames,) [N]."""
    seen = np.isfinite(turn)
    if not seen.any() or np.ptp(force[seen]) == 0:
        return ()
    load = force[seen] - force[seen].mean()
    parted = float(load @ turn[seen] / (load @ load)) * float(np.ptp(force[seen]))
    if parted <= TURN_NOTE:
        return ()
    return (
        f"the cuff turns or bends with the load: its markers part by {1e3 * parted:.1f} mm, and displacement is "
        "that of their middle; put them around the place where the rope pulls",
    )
