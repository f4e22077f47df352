"""A person raises one arm several times: the share of a full raise over time, and the posture at a share.

The girdle follows the arm by straight lines over the share of the raise (a rhythm of our own); the clavicle and one
coordinate of the scapula close the acromioclavicular joint.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.simulators.settings import RaiseSettings
from drivers.simulators.shoulder import Shoulder

Floats = NDArray[np.float64]

RHYTHM_DEG = {
    "clav_prot": (-24.0, -34.0),
    "clav_elev": (-6.0, 8.0),
    "scapula_abduction": (-17.0, -6.0),
    "scapula_elevation": (-5.0, -6.0),
    "scapula_upward_rot": (10.0, 48.0),
    "scapula_winging": (6.0, -4.0),
    "plane_elv": (40.0, 40.0),
    "shoulder_elv": (15.0, 100.0),
    "axial_rot": (-10.0, -25.0),
}
"""Degrees with the arm at rest and raised; three of the girdle's then change until its joint is closed."""
CLOSING = ("clav_prot", "clav_elev", "scapula_elevation")
KNOTS = 41


class RaisedPosture:
    """Coordinates (n, 15) at shares (n,) of a full raise from 0 to 1, the thorax upright in ground."""

    def __init__(self, shoulder: Shoulder) -> None:
        from scipy.interpolate import CubicSpline  # a fifth of the start of a bench, most of which have no wearer

        share = np.linspace(0.0, 1.0, KNOTS)
        coordinates = np.zeros((KNOTS, len(shoulder.coordinate_names)))
        for name, (low, high) in RHYTHM_DEG.items():
            coordinates[:, shoulder.index(name)] = np.radians(low + (high - low) * share)
        self._spline = CubicSpline(share, shoulder.closed(coordinates, CLOSING))

    def __call__(self, share: Floats) -> Floats:
        return np.asarray(self._spline(share))


@dataclass(frozen=True)
class Raises:
    """Cycles of up, hold, down, rest, each realised with its own chance; seconds from the start of the capture.

    starts (cycles,); up, hold, down (cycles,) [s]; heights (cycles,): the share that is reached
    """

    starts: Floats
    up: Floats
    hold: Floats
    down: Floats
    heights: Floats
    duration: float

    def share(self, t: Floats) -> Floats:
        """(n,) of a full raise at t (n,), by minimum-jerk curves; 0 outside the cycles."""
        since = t[:, None] - self.starts
        rise = _eased(since / self.up)
        fall = _eased((since - self.up - self.hold) / self.down)
        return np.asarray(((rise - fall) * self.heights).sum(axis=1))


def realised_raises(settings: RaiseSettings, rng: np.random.Generator) -> Raises:
    """One trial's cycles."""
    count = settings.cycles
    pace = 1.0 + rng.normal(0.0, settings.duration_jitter, (4, count))
    planned = np.array([settings.up_s, settings.hold_s, settings.down_s, settings.rest_s])
    up, hold, down, rest = planned[:, None] * np.clip(pace, 0.5, 2.0)
    lengths = up + hold + down + rest
    starts = settings.lead_in_s + np.concatenate(([0.0], np.cumsum(lengths)[:-1]))
    heights = np.clip(1.0 - np.abs(rng.normal(0.0, settings.height_jitter, count)), 0.5, 1.0)
    return Raises(starts, up, hold, down, heights, float(starts[-1] + lengths[-1] + settings.lead_out_s))


def no_raises(duration: float) -> Raises:
    """A pose that is held."""
    none = np.ones(0)
    return Raises(none, none, none, none, none, duration)


def _eased(progress: Floats) -> Floats:
    p = np.clip(progress, 0.0, 1.0)
    return np.asarray(p**3 * (10 - 15 * p + 6 * p * p))
