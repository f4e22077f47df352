"""Every state of a trial against everything that can happen to it."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from drivers.errors import DeviceLost
from recordings.samples import Event
from station.bench.snapshot import TrialState
from station.bench.trial_state_machine import TrialStateMachine
from station.messages.codes import TrialCode
from station.messages.message import Message
from tests.station.bench_by_hand import Bench

IDLE, ARMED, RECORDING, CLOSING, CLOSED, FAILED = TrialState
FULL = Message(TrialCode.DISK_NEARLY_FULL, {"folder": "monday", "free_mb": 40.0, "reserve_mb": 50.0})


def _recording() -> Bench:
    bench = Bench().arm()
    bench.run(3.0)
    bench.start_capture()
    bench.run(1.0)
    return bench


def _closing() -> Bench:
    bench = _recording()
    bench.trial.stop()
    return bench


def _closed() -> Bench:
    bench = _closing()
    bench.trial.stop(at_once=True)
    return bench


def _failed() -> Bench:
    bench = _recording()
    bench.trial.fail(DeviceLost("the load cell is gone"), "NI Dev1")
    return bench


REACHED: dict[TrialState, Callable[[], Bench]] = {
    IDLE: Bench,
    ARMED: lambda: Bench().arm(),
    RECORDING: _recording,
    CLOSING: _closing,
    CLOSED: _closed,
    FAILED: _failed,
}
HAPPENINGS: dict[str, Callable[[TrialStateMachine], None]] = {
    "stop": lambda trial: trial.stop(),
    "stop at once": lambda trial: trial.stop(at_once=True),
    "a device is lost": lambda trial: trial.fail(DeviceLost("gone"), "QTM"),
    "the disk is full": lambda trial: trial.cut_short(FULL),
    "the capture ends": lambda trial: trial.handle(Event("capture_stopped", "", 0, "QTM")),
    "the capture is replaced": lambda trial: trial.handle(Event("capture_replaced", "another's", 0, "QTM")),
    "the writer fails": lambda trial: trial.abandon("the disk is gone"),
    "a mark": lambda trial: trial.mark(),
    "time": lambda trial: trial.tick(),
}
NEXT = {
    "stop": (FAILED, FAILED, CLOSING, CLOSING, CLOSED, FAILED),
    "stop at once": (FAILED, FAILED, CLOSED, CLOSED, CLOSED, FAILED),
    "a device is lost": (FAILED, FAILED, FAILED, CLOSING, CLOSED, FAILED),
    "the disk is full": (FAILED, FAILED, CLOSING, CLOSING, CLOSED, FAILED),
    "the capture ends": (IDLE, ARMED, CLOSING, CLOSING, CLOSED, FAILED),
    "the capture is replaced": (IDLE, ARMED, CLOSING, CLOSING, CLOSED, FAILED),
    "the writer fails": (FAILED,) * 6,
    "a mark": (IDLE, ARMED, RECORDING, CLOSING, CLOSED, FAILED),
    "time": (IDLE, ARMED, RECORDING, CLOSING, CLOSED, FAILED),
}


@pytest.mark.parametrize("happening", HAPPENINGS)
@pytest.mark.parametrize("state", TrialState)
def test_every_method_of_a_state_returns_a_state(state: TrialState, happening: str) -> None:
    bench = REACHED[state]()
    assert bench.trial.state is state
    HAPPENINGS[happening](bench.trial)
    assert bench.trial.state is NEXT[happening][list(TrialState).index(state)]


@pytest.mark.parametrize("state", [IDLE, CLOSED, FAILED])
def test_items_before_arming_and_after_the_end_are_not_recorded(state: TrialState) -> None:
    bench = REACHED[state]()
    recorded = len(bench.writer.items)
    bench.run(1.0)
    bench.trial.mark()
    assert (len(bench.writer.items), bench.trial.state) == (recorded, state)
