"""Plausibility of force and displacement of a pull: stuck values, frozen markers, wrong unit, wrong sign."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fitting.errors import UnusableTrial
from fitting.pull.plateaus import Plateau
from fitting.results.codes import RejectionCode
from fitting.trial.calibration import code_width

STUCK = 1.0
MOST_CREEP = 0.2
"""Part of the range of displacement by which the cuff may creep or slip while the load is held."""
QUIET_PERCENTILE, LEAST_PROBABILITY = 10, 1e-9
"""Percentile of the noise over the seconds of a record, and the probability below which a stuck value is reported."""
MOST_DISPLACEMENT, LEAST_DISPLACEMENT = 1.0, 1e-6


def require_live_force(
    force_time: NDArray[np.float64],
    force: NDArray[np.float64],
    marker_time: NDArray[np.float64],
    displacement: NDArray[np.float64],
) -> None:
    """Raise UnusableTrial if force (n,) [N] keeps one value for a second although it should change.

    A held load may stay at one code. It is stuck if the cuff (frames,) [m] moves meanwhile, or if the noise of the
    quietest seconds of the force makes one code for so long improbable.
    """
    bounds = np.concatenate(([0], np.flatnonzero(np.diff(force)) + 1, [len(force)]))
    runs = np.column_stack((bounds[:-1], bounds[1:]))
    travel = float(np.nanpercentile(displacement, 99.5) - np.nanpercentile(displacement, 0.5))
    for first, last in runs[force_time[runs[:, 1] - 1] - force_time[runs[:, 0]] > STUCK]:
        start, end = float(force_time[first]), float(force_time[last - 1])
        here = displacement[(marker_time >= start) & (marker_time <= end)]
        here = here[np.isfinite(here)]
        moves = len(here) > 20 and np.percentile(here, 97.5) - np.percentile(here, 2.5) > MOST_CREEP * travel
        elsewhere = np.concatenate((force[:first], force[last:]))
        noise = _quietest_noise(elsewhere, max(5, round((last - first) / (end - start))))
        if moves or _probability_of_one_code(elsewhere, noise, last - first) < LEAST_PROBABILITY:
            figures = {"force_n": float(force[first]), "duration_s": end - start, "start_s": start}
            if moves:
                raise UnusableTrial(RejectionCode.FORCE_STUCK_MOVING, figures)
            raise UnusableTrial(RejectionCode.FORCE_STUCK_QUIET, {**figures, "noise_n": noise})


def require_live_markers(
    marker_time: NDArray[np.float64],
    markers: NDArray[np.float64],
    force_time: NDArray[np.float64],
    force: NDArray[np.float64],
) -> None:
    """Raise UnusableTrial if markers (frames, labels, 3) are constant for a second while force (n,) [N] changes.

    Under a constant force they may, because a simulator may have no noise.
    """
    same = (np.diff(markers, axis=0) == 0) | np.isnan(markers[1:]) & np.isnan(markers[:-1])
    still = same.all(axis=(1, 2)) & np.isfinite(markers[1:]).any(axis=(1, 2))
    bounds = np.flatnonzero(np.diff(np.concatenate(([False], still, [False]))))
    travel = _spread(force)
    for first, last in zip(bounds[::2], bounds[1::2], strict=True):
        start, end = float(marker_time[first]), float(marker_time[last])
        meanwhile = force[(force_time >= start) & (force_time <= end)]
        if end - start > STUCK and len(meanwhile) > 1 and _spread(meanwhile) > travel / 2:
            raise UnusableTrial(RejectionCode.MARKERS_FROZEN, {"duration_s": end - start, "start_s": start})


def require_plausible_displacement(displacement: NDArray[np.float64]) -> None:
    """Raise UnusableTrial if displacement (frames,) [m] is impossible for a cuff, which indicates a wrong unit."""
    scatter = float(np.nanstd(displacement))
    if scatter > MOST_DISPLACEMENT or scatter < LEAST_DISPLACEMENT:
        figures = {"rms_m": scatter, "least_m": LEAST_DISPLACEMENT, "most_m": MOST_DISPLACEMENT}
        raise UnusableTrial(RejectionCode.DISPLACEMENT_UNIT, figures)


def require_positive_loads(plateaus: Sequence[Plateau]) -> None:
    """Raise UnusableTrial if the force falls when weights are added: the sign of the load cell is wrong."""
    if not plateaus:
        return
    start = plateaus[0].force
    largest = max(plateaus, key=lambda plateau: abs(plateau.force - start))
    if largest.force < start - 5 * max(largest.force_sd, 0.1) and largest.force < 0:
        raise UnusableTrial(RejectionCode.FORCE_POLARITY, {"before_n": start, "after_n": largest.force})


def _quietest_noise(force: NDArray[np.float64], second: int) -> float:
    """Standard deviation [N] of force (n,) in its quieter seconds; second is the number of samples in one.

    It is computed from third differences, which amplify white noise by √20 and contain little of a 1 Hz swing.
    """
    seconds = force[: len(force) // second * second].reshape(-1, second)
    noise = np.std(np.diff(seconds, 3, axis=1), axis=1) / math.sqrt(20)
    return float(np.percentile(noise, QUIET_PERCENTILE)) if len(seconds) else 0.0


def _probability_of_one_code(force: NDArray[np.float64], noise: float, count: int) -> float:
    """Probability that `count` samples at the centre of a code all have this code, for normal noise [N]."""
    step = code_width(force)
    dithering = math.sqrt(max(0.0, noise**2 - step**2 / 12))  # Sheppard's correction: noise of the quantisation
    if dithering == 0:
        return 1.0
    return math.erf(step / 2 / dithering / math.sqrt(2)) ** count


def _spread(force: NDArray[np.float64]) -> float:
    """Newtons between the 0.5 and 99.5 percentiles."""
    low, high = np.percentile(force, [0.5, 99.5])
    return float(high - low)
