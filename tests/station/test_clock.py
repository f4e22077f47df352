"""Host time of the samples of a stream, by the block with the least delay so far."""

import sys

import numpy as np
import pytest

from recordings.samples import Samples
from station.clock import ArrivalClock

PERIOD_NS = 10_000_000
OFFSET_NS = 1_700_000_000_000_000_000
"""Host time less device time of a sample that arrives at once."""


def _block(first: int, delay_ns: int) -> Samples:
    """Five samples at 100 Hz, the last of which arrives after the delay."""
    numbers = np.arange(first, first + 5, dtype=np.uint64)
    times_ns = numbers.astype(np.int64) * PERIOD_NS
    return Samples("/force", numbers, times_ns, int(times_ns[-1]) + OFFSET_NS + delay_ns, np.zeros((5, 1)))


@pytest.mark.parametrize(
    ("delays_ms", "least_ms"),
    [((8,), 8), ((8, 3), 3), ((3, 8), 3), ((8, 3, 9, 2000), 3)],
    ids=["first", "quicker", "slower", "backlog"],
)
def test_host_time_has_the_least_delay_so_far_and_a_backlog_lies_in_the_past(
    delays_ms: tuple[int, ...], least_ms: int
) -> None:
    clock = ArrivalClock()
    assert clock.offset_ns == sys.maxsize, "no block yet: later than any"
    for index, delay_ms in enumerate(delays_ms):
        block = _block(5 * index, delay_ms * 1_000_000)
        host_ns = clock.update(block)
    assert host_ns.dtype == np.int64
    assert (host_ns - block.device_time_ns - OFFSET_NS).tolist() == [least_ms * 1_000_000] * 5
    assert block.host_time_ns - host_ns[-1] == (delays_ms[-1] - least_ms) * 1_000_000
    assert clock.offset_ns == OFFSET_NS + least_ms * 1_000_000
