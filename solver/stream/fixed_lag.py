"""Fixed-lag smoother of coordinates whose third derivative (jerk) is white noise; compiled.

Per coordinate the Kalman filter runs over the frames of the window, and the smoother of Bryson and Frazier back to its
first frame (Durbin, Koopman, Time Series Analysis by State Space Methods, 2012, ch. 4.3 and 4.4; for a fixed lag
Anderson, Moore, Optimal Filtering, 1979, ch. 7). Intervals between frames may differ.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from solver.compiled import compiled, compiled_for_python, compiled_with_allocation
from solver.stream.filter_state import START_SD, FilterState, Window

Array = NDArray[np.float64]


class _Filtered(NamedTuple):
    """A coordinate in every frame, before its observation: ahead (frames, 3), covariances (frames, 3, 3), and gains
    (frames, 3), errors (frames, 2) of the observation: observed less predicted, and its variance, 0 for none.
    """

    ahead: Array
    covariances: Array
    gains: Array
    errors: Array


@compiled_for_python
def smooth_window(window: Window, intensity: Array, state: FilterState, smoothed: Array, spread: Array) -> None:
    """Fill smoothed and spread (coordinates, 3), state and variances of the window's first frame given all its frames.

    intensity (coordinates,) of the jerk [rad²/s⁵ or m²/s⁵]. state is that before the window's first frame, and becomes
    that after it.
    """
    values, variances, steps, restarts = window
    frames, count = values.shape
    filtered = _Filtered(np.zeros((frames, 3)), np.zeros((frames, 3, 3)), np.zeros((frames, 3)), np.zeros((frames, 2)))
    ahead, covs, gains, errors = filtered
    step, drive, work = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3))
    mean, cov = np.zeros(3), np.zeros((3, 3))
    for k in range(count):
        mean[:], cov[:] = state.means[k], state.covariances[k]
        last = frames
        for i in range(frames):
            if restarts[i, k]:
                if i > 0:
                    last = i
                    break
                _restart(values[i, k], mean, cov)
            else:
                _fill_transition(steps[i], intensity[k], step, drive)
                _advance(step, drive, mean, cov, work)
            ahead[i], covs[i], errors[i] = mean, cov, 0.0
            if np.isfinite(values[i, k]):
                errors[i, 0], errors[i, 1] = values[i, k] - mean[0], cov[0, 0] + variances[i, k]
                _update(errors[i], mean, cov, gains[i], work)
            if i == 0:
                state.means[k], state.covariances[k] = mean, cov
        _smooth_first(filtered, steps, last, step, smoothed[k], spread[k])


@compiled
def _restart(value: float, mean: Array, cov: Array) -> None:
    cov[:] = 0.0
    mean[:] = 0.0
    for i in range(3):
        cov[i, i] = START_SD[i] ** 2
    if np.isfinite(value):
        mean[0] = value


@compiled
def _fill_transition(t: float, intensity: float, step: Array, drive: Array) -> None:
    """Transition and covariance of a step of t seconds."""
    step[0, 0] = step[1, 1] = step[2, 2] = 1.0
    step[0, 1] = step[1, 2] = t
    step[0, 2] = t * t / 2.0
    drive[0, 0] = intensity * t**5 / 20.0
    drive[0, 1] = drive[1, 0] = intensity * t**4 / 8.0
    drive[0, 2] = drive[2, 0] = intensity * t**3 / 6.0
    drive[1, 1] = intensity * t**3 / 3.0
    drive[1, 2] = drive[2, 1] = intensity * t**2 / 2.0
    drive[2, 2] = intensity * t


@compiled
def _advance(step: Array, drive: Array, mean: Array, cov: Array, work: Array) -> None:
    for i in range(3):
        for j in range(i + 1, 3):
            mean[i] += step[i, j] * mean[j]
    for i in range(3):
        for j in range(3):
            work[i, j] = 0.0
            for m in range(i, 3):
                work[i, j] += step[i, m] * cov[m, j]
    for i in range(3):
        for j in range(3):
            cov[i, j] = drive[i, j]
            for m in range(j, 3):
                cov[i, j] += work[i, m] * step[j, m]


@compiled_with_allocation
def _update(error: Array, mean: Array, cov: Array, gain: Array, work: Array) -> None:
    """Mean and covariance after an observation of q; error is (observed − predicted, its variance)."""
    for i in range(3):
        gain[i] = cov[i, 0] / error[1]
        mean[i] += gain[i] * error[0]
    work[:] = cov
    for i in range(3):
        for j in range(3):
            cov[i, j] = work[i, j] - 0.5 * (gain[i] * work[0, j] + gain[j] * work[0, i])


@compiled_with_allocation
def _smooth_first(filtered: _Filtered, steps: Array, last: int, step: Array, state: Array, spread: Array) -> None:
    """Backwards from the frame before `last` to the first: r and N gather what later observations add."""
    ahead, covs, gains, errors = filtered
    r, N, other = np.zeros(3), np.zeros((3, 3)), np.zeros((3, 3))
    for k in range(last - 1, -1, -1):
        if errors[k, 1] > 0.0:
            _observe(gains[k], errors[k], r, N, other)
        if k > 0:
            t = steps[k]
            step[0, 1] = step[1, 2] = t
            step[0, 2] = t * t / 2.0
            _return(step, r, N, other)
    for i in range(3):
        state[i], spread[i] = ahead[0, i], covs[0, i, i]
        for j in range(3):
            state[i] += covs[0, i, j] * r[j]
            for m in range(3):
                spread[i] -= covs[0, i, j] * N[j, m] * covs[0, m, i]


@compiled
def _observe(gain: Array, error: Array, r: Array, N: Array, other: Array) -> None:
    """r becomes Lᵀ r + e/S and N becomes Lᵀ N L + 1/S in the first entry, L = I − K (1 0 0)."""
    r[0] += error[0] / error[1] - (gain[0] * r[0] + gain[1] * r[1] + gain[2] * r[2])
    for i in range(3):
        other[0, i] = gain[0] * N[0, i] + gain[1] * N[1, i] + gain[2] * N[2, i]
    inner = other[0, 0] * gain[0] + other[0, 1] * gain[1] + other[0, 2] * gain[2]
    for i in range(3):
        N[0, i] -= other[0, i]
        N[i, 0] -= other[0, i]
    N[0, 0] += inner + 1.0 / error[1]


@compiled
def _return(step: Array, r: Array, N: Array, other: Array) -> None:
    """r becomes Φᵀ r and N becomes Φᵀ N Φ."""
    r[2] += step[1, 2] * r[1] + step[0, 2] * r[0]
    r[1] += step[0, 1] * r[0]
    for i in range(3):
        for j in range(3):
            other[i, j] = 0.0
            for m in range(i + 1):
                other[i, j] += step[m, i] * N[m, j]
    for i in range(3):
        for j in range(3):
            N[i, j] = 0.0
            for m in range(j + 1):
                N[i, j] += other[i, m] * step[m, j]
