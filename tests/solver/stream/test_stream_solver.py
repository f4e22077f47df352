"""The stream solver gives every frame once, in order, the same to the bit, and survives what a bad day brings."""

from __future__ import annotations

import numpy as np
import pytest

from solver.model import ModelError
from solver.stream.stream_frame import StreamFrame, StreamOutcome
from tests.solver.stream.streams import INTERVAL, WORN, clean, seen, solver, stream

SHORT = 25


def bytes_of(frame: StreamFrame) -> tuple[object, ...]:
    muscles = [
        (name, suit.outcome, suit.activations.tobytes(), suit.glenohumeral_force_n.tobytes(), suit.cord_force_n)
        for name, suit in frame.suits.items()
    ]
    return frame.time_s, frame.outcome, frame.coordinates.tobytes(), frame.accelerations.tobytes(), muscles


def test_every_frame_is_given_out_once_in_order_when_its_lag_has_elapsed() -> None:
    live, given = solver({}, lag_s=0.05), []
    for k, positions in enumerate(seen()[:SHORT]):
        ready = live.push(k * INTERVAL, positions)
        assert len(ready) == (1 if k >= 5 else 0)
        given += ready
    given += live.finish()
    assert [round(frame.time_s / INTERVAL) for frame in given] == list(range(SHORT))


def test_the_same_input_gives_the_same_output_to_the_bit() -> None:
    one, other = (
        [bytes_of(frame) for frame in stream(seen()[:SHORT], solver({"slack": None, "worn": WORN}))] for _ in range(2)
    )
    assert one == other


def test_a_time_that_is_not_later_is_refused_and_the_stream_continues() -> None:
    live, given = solver({}), []
    for k, positions in enumerate(seen()[:SHORT]):
        given += live.push(k * INTERVAL, positions)
        if k == 10:
            for bad in (k * INTERVAL, 0.03, np.nan, np.inf):
                (refused,) = (frame for frame in live.push(bad, positions) if not frame.has_coordinates)
                assert refused.outcome is StreamOutcome.TIME_NOT_LATER
    given += live.finish()
    undisturbed = stream(seen()[:SHORT], solver({}))
    assert [bytes_of(frame) for frame in given] == [bytes_of(frame) for frame in undisturbed]


def test_a_frame_of_another_shape_is_a_wrong_call() -> None:
    with pytest.raises(ModelError) as caught:
        solver({}).push(0.0, np.zeros((2, 3)))
    assert caught.value.code == "model_unusable.wrong_shape"


def test_cameras_at_three_times_the_rate_give_the_same_muscles_where_they_are_solved() -> None:
    frames = np.arange(0, SHORT, 1 / 3)
    between = np.stack([np.interp(frames, np.arange(SHORT), column) for column in clean()[:SHORT].reshape(SHORT, -1).T])
    pushed = between.T.reshape(len(frames), *seen().shape[1:])
    live, fast = solver(), []
    for k, positions in enumerate(pushed):
        fast += live.push(k * INTERVAL / 3, positions, solve_muscles=k % 3 == 0)
    usual = {round(frame.time_s, 6): frame for frame in stream(clean()[:SHORT])}
    solved = [frame for frame in fast if frame.suits]
    assert len(solved) == pytest.approx(len(fast) / 3, abs=1)
    for frame in solved:
        other = usual[round(frame.time_s, 6)]
        assert np.abs(frame.coordinates - other.coordinates).max() < 1e-3
        assert np.abs(frame.suits["bare"].activations - other.suits["bare"].activations).mean() < 0.01


@pytest.mark.parametrize("seed", range(4))
def test_any_frames_at_any_times_give_one_result_each(seed: int) -> None:
    chance, live, pushed, given = np.random.default_rng(seed), solver(lag_s=0.05), 0, 0
    time = 0.0
    for positions in seen():
        time += chance.choice([0.01, 0.01, 0.01, 0.013, 0.0, -0.02, 0.3, 1e4, np.nan], p=[0.3, 0.3, 0.2, *[1 / 30] * 6])
        fault = chance.choice(["none", "hidden", "jump", "exchange", "huge"], p=[0.6, 0.1, 0.1, 0.1, 0.1])
        seen_now = positions.copy()
        if fault == "hidden":
            seen_now[chance.random(len(seen_now)) < 0.7] = np.nan
        elif fault == "jump":
            seen_now[chance.integers(len(seen_now))] += 1.0
        elif fault == "exchange":
            seen_now = chance.permutation(seen_now)
        elif fault == "huge":
            seen_now *= 1e9
        given += len(live.push(time, seen_now, solve_muscles=bool(chance.random() < 0.3)))
        pushed += 1
        time = 0.0 if np.isnan(time) else time
    given += len(live.finish())
    assert given == pushed
