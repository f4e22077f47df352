"""The fixed-lag smoother and the smoother of whole records, beside all states conditioned at once."""

from dataclasses import replace

import numpy as np
import pytest
import scipy

from solver.inverse_kinematics.smoother import START_SD, Array, smooth_scalar, transition
from solver.inverse_kinematics.solve import PostureOutcome
from solver.stream.lag_window import JERK_INTENSITY, FramePosture, LagWindow

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
    """The same for the first frames at once, from the first value."""
    step, unit = transition(3, INTERVAL)
    unseen = [at for at in gap if at < frames]
    drive = JERK_INTENSITY * (SD / NOISE) ** 2 * unit
    means, spread = np.zeros((2, frames, 3, 2))
    for k in range(2):
        values = observed()[:frames, k].copy()
        first = values[0]
        values[unseen] = np.nan
        means[..., k], spread[..., k] = conditioned(values - first, step, drive)
        means[:, 0, k] += first
    return means, np.sqrt(spread)


def conditioned(values: Array, step: Array, drive: Array) -> tuple[Array, Array]:
    """Means and variances (frames, order) of all states at once, given values (frames,) of standard deviation SD."""
    frames, order = len(values), len(step)
    powers = [np.linalg.matrix_power(step, k) for k in range(frames)]
    passed = np.block([[powers[max(k - j, 0)] * (k >= j) for j in range(frames)] for k in range(frames)])
    added = scipy.linalg.block_diag(np.diag(np.square(START_SD[:order])), *[drive] * (frames - 1))
    prior = passed @ added @ passed.T
    seen = np.flatnonzero(np.isfinite(values))
    among, along = prior[np.ix_(order * seen, order * seen)] + SD**2 * np.eye(len(seen)), prior[:, order * seen]
    gain = np.linalg.solve(among, along.T).T
    variances = np.diag(prior) - (gain * along).sum(axis=1)
    return (gain @ values[seen]).reshape(frames, order), variances.reshape(frames, order)


@pytest.mark.parametrize("order", [3, 4])
def test_the_smoother_of_whole_records_conditions_all_states_on_all_values(order: int) -> None:
    step, unit = transition(order, 0.1)
    values = observed()[:12, 0].copy()
    values[5:8] = np.nan
    means, spread = np.zeros((2, len(values), order))
    smooth_scalar(values, np.full(12, SD**2), step, 3.0 * unit, np.diag(np.square(START_SD[:order])), means, spread)
    expected, variances = conditioned(values, step, 3.0 * unit)
    np.testing.assert_allclose(means, expected, rtol=1e-6, atol=2e-6)
    np.testing.assert_allclose(spread, variances, rtol=1e-6)


@pytest.mark.parametrize(("order", "interval"), [(3, 0.1), (4, 0.02)])
def test_a_step_is_that_of_a_white_derivative(order: int, interval: float) -> None:
    """Van Loan, IEEE Trans. Autom. Control 23:395, 1978."""
    both = np.zeros((2 * order, 2 * order))
    both[:order, :order], both[order:, order:] = -np.eye(order, k=1), np.eye(order, k=1).T
    both[order - 1, -1] = 1.0
    found = scipy.linalg.expm(both * interval)
    step, unit = transition(order, interval)
    np.testing.assert_allclose(step, found[order:, order:].T, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(unit, found[order:, order:].T @ found[:order, order:], rtol=1e-9)


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
