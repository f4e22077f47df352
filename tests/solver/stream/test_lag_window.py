"""The fixed-lag smoother beside the smoother of whole records, which runs over all frames at once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from solver.inverse_kinematics.smoother import START_SD, smooth_scalar, transition
from solver.inverse_kinematics.solve import PostureOutcome
from solver.stream.lag_window import JERK_INTENSITY, FramePosture, LagWindow

Array = NDArray[np.float64]
INTERVAL, FRAMES, SD, NOISE = 0.01, 60, 0.002, 4e-4
TIME = INTERVAL * np.arange(FRAMES)


def observed() -> Array:
    """(frames, 2) two coordinates with noise; the second has gaps."""
    truth = np.stack([0.4 + 0.3 * np.sin(4 * TIME), TIME**2], axis=1)
    return truth + SD * np.random.default_rng(1).standard_normal(truth.shape)


def posture(values: Array) -> FramePosture:
    is_held = np.ones(len(values), dtype=np.bool_)
    nothing = np.zeros((0, 3))
    covariance = SD**2 * np.eye(len(values))
    return FramePosture(PostureOutcome.SOLVED, values, nothing, covariance, covariance, is_held)


def hidden() -> FramePosture:
    nothing = np.full((2, 2), np.nan)
    is_held = np.zeros(2, dtype=np.bool_)
    return FramePosture(PostureOutcome.NO_MARKERS, nothing[0], np.zeros((0, 3)), nothing, nothing, is_held)


def smoothed(lag: float, gap: range = range(0)) -> tuple[Array, Array]:
    """State and standard deviations (frames, 3, coordinates) with a lag [s]."""
    window, found = LagWindow(2), []
    for k, values in enumerate(observed()):
        window.add(TIME[k], hidden() if k in gap else posture(values), NOISE)
        while window.is_ready(lag):
            found.append(window.pop())
    found += [window.pop() for _ in range(FRAMES - len(found))]
    given = [state for state in found if state is not None]
    assert len(given) == FRAMES
    return np.array([s.state for s in given]), np.array([s.standard_deviations for s in given])


def over_all_frames(frames: int, gap: range = range(0)) -> tuple[Array, Array]:
    """The same from smooth_scalar on the first frames, started at the first value."""
    step, unit = transition(3, INTERVAL)
    means, spread = np.zeros((2, frames, 3, 2))
    drive = JERK_INTENSITY * (SD / NOISE) ** 2 * unit
    for k in range(2):
        values = observed()[:frames, k].copy()
        values[[at for at in gap if at < frames]] = np.nan
        first = values[0]
        results = np.zeros((2, frames, 3))
        variances = np.full(frames, SD**2)
        smooth_scalar(values - first, variances, step, drive, np.diag(np.square(START_SD[:3])), *results)
        means[..., k], spread[..., k] = results
        means[:, 0, k] += first
    return means, np.sqrt(spread)


@pytest.mark.parametrize("gap", [range(0), range(20, 28)])
def test_with_all_frames_in_the_window_it_is_the_smoother_of_the_whole_record(gap: range) -> None:
    (state, deviations), (means, spread) = smoothed(FRAMES * INTERVAL, gap), over_all_frames(FRAMES, gap)
    np.testing.assert_allclose(state, means, rtol=0, atol=1e-7)
    np.testing.assert_allclose(deviations, spread, rtol=1e-6)


@pytest.mark.parametrize("lag", [0, 5, 15])
def test_with_a_lag_every_frame_uses_the_record_up_to_the_lag(lag: int) -> None:
    state, deviations = smoothed(lag * INTERVAL)
    for frame in (10, 25, 40):
        means, spread = over_all_frames(frame + lag + 1)
        np.testing.assert_allclose(state[frame], means[frame], rtol=0, atol=1e-7)
        np.testing.assert_allclose(deviations[frame], spread[frame], rtol=1e-6)


def test_a_coordinate_without_hold_keeps_its_value_and_is_not_determined() -> None:
    window, found = LagWindow(2), []
    for k, values in enumerate(observed()):
        one = posture(np.array([values[0], 0.7]))
        unheld = replace(one, is_held=np.array([True, False]))
        assert not window.add(TIME[k], unheld, NOISE).any()
        found += [window.pop()] if window.is_ready(0.1) else []
    states = np.array([state.state for state in found if state])
    np.testing.assert_allclose(states[:, :, 1], np.broadcast_to([0.7, 0.0, 0.0], states[:, :, 1].shape), atol=1e-9)
    assert all(np.isinf(state.standard_deviations[0, 1]) for state in found if state)
