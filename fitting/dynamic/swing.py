"""Cut the swing out of a pull: the data of the dynamic fits."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fitting.errors import UnusableTrial
from fitting.pull.pull import Pull
from fitting.results.codes import RejectionCode
from fitting.trial.oscillation import Oscillation

FIT_RATE = 250.0
"""Rate [Hz] to which force is averaged. This attenuates a swing of 3 Hz by 0.005 % and makes the fit 4 times faster."""


@dataclass(frozen=True)
class Swing:
    """force (n,) [N] at force_time [s], displacement (frames,) [m] at marker_time [s], finite; mass [kg] of the cuff.

    lag_sd is the prior standard deviation [s] of the lag in a fit; 0: the lag is known.
    """

    force_time: NDArray[np.float64]
    force: NDArray[np.float64]
    marker_time: NDArray[np.float64]
    displacement: NDArray[np.float64]
    mass: float
    lag_sd: float

    def delayed(self, lag: float) -> Swing:
        """The swing with every force sample `lag` [s] later."""
        return replace(self, force_time=self.force_time + lag)


def cut_swing(pull: Pull, oscillation: Oscillation, lag_sd: float) -> Swing:
    """The visible frames of the oscillation, and the force averaged to FIT_RATE. Raises UnusableTrial."""
    in_force = (pull.force_time >= oscillation.start) & (pull.force_time <= oscillation.end)
    seen = (pull.marker_time >= oscillation.start) & (pull.marker_time <= oscillation.end)
    seen &= np.isfinite(pull.displacement)
    expected = (oscillation.end - oscillation.start) / float(np.median(np.diff(pull.marker_time)))
    if np.count_nonzero(seen) < 0.5 * expected:
        raise UnusableTrial(RejectionCode.SWING_HIDDEN)
    time, force = _averaged(pull.force_time[in_force], pull.force[in_force])
    return Swing(time, force, pull.marker_time[seen], pull.displacement[seen], pull.trial.cuff_mass, lag_sd)


def _averaged(time: NDArray[np.float64], force: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Block means with a rate of at least FIT_RATE."""
    per_block = max(1, int(1 / float(np.median(np.diff(time))) / FIT_RATE + 1e-6))
    whole = len(time) // per_block * per_block
    return time[:whole].reshape(-1, per_block).mean(axis=1), force[:whole].reshape(-1, per_block).mean(axis=1)
