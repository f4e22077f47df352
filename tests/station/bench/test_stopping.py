"""What ends `station record` from outside ends its trial cleanly."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator

import pytest

from station.verbs.bench import _stop_on_signals

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
