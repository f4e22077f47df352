"""What ends `station record` from outside ends its trial cleanly, and its exit code says that the end is missing."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from station.bench.trial_recorder import TrialResult
from station.messages.codes import TrialCode
from station.messages.message import Message
from station.verbs.bench import _exit_code, _stop_on_signals

ENDINGS = [signal.SIGINT, signal.SIGTERM] + ([] if sys.platform == "win32" else [signal.SIGHUP])


class _CountsStops:
    stops = 0

    def stop(self) -> None:
        self.stops += 1


@pytest.fixture
def daemon() -> Iterator[_CountsStops]:
    before = {number: signal.getsignal(number) for number in ENDINGS}
    counts = _CountsStops()
    _stop_on_signals(counts)
    yield counts
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("number", ENDINGS)
def test_ctrl_c_a_kill_and_a_closed_terminal_stop_the_trial_and_not_the_process(
    daemon: _CountsStops, number: signal.Signals
) -> None:
    signal.raise_signal(number)
    assert daemon.stops == 1


@pytest.mark.parametrize(
    ("reason", "is_accepted", "lost", "exit_code"),
    [
        (TrialCode.CAPTURE_ENDED, True, 0, 0),
        (TrialCode.DURATION_REACHED, True, 0, 0),
        (TrialCode.OPERATOR_STOP, True, 0, 3),
        (TrialCode.CAPTURE_ENDED, True, 7, 3),
        (TrialCode.DEVICE_LOST, False, 0, 3),
    ],
)
def test_a_trial_that_the_operator_stops_is_accepted_and_incomplete(
    reason: TrialCode, is_accepted: bool, lost: int, exit_code: int
) -> None:
    assert _exit_code(TrialResult(Path("a.mcap"), lost, (Message(reason),), accepted=is_accepted)) == exit_code


def test_a_trial_that_is_cancelled_before_its_capture_has_failed() -> None:
    assert _exit_code(TrialResult(None, 0, (Message(TrialCode.CANCELLED),), accepted=False)) == 1
