"""The stream solver gives every frame once, in order, the same to the bit, and survives what a bad day brings."""

from __future__ import annotations

import numpy as np
import pytest

from solver.model import ModelError
from solver.stream.stream_frame import StreamFrame, StreamOutcome
from tests.solver.stream.streams import INTERVAL, WORN, seen, solver, stream

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


def test_a_time_that_is_not_later_is_refused_and_the_stream_goes_on() -> None:
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
