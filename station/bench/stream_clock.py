"""Map the clock of a stream's device to the clock of the host."""

from __future__ import annotations

from recordings.samples import Samples


class StreamClock:
    """Time of the last sample of one stream on the host's clock.

    The offset between the two clocks is that of the block with the least delay. With a backlog, the last sample
    therefore lies in the past although blocks keep arriving.
    """

    def __init__(self) -> None:
        self._least_delay_ns: int | None = None
        self._last_device_ns = 0

    def update(self, samples: Samples) -> None:
        """Add a block of at least one sample."""
        self._last_device_ns = int(samples.device_time_ns[-1])
        delay_ns = samples.host_time_ns - self._last_device_ns
        self._least_delay_ns = delay_ns if self._least_delay_ns is None else min(self._least_delay_ns, delay_ns)

    @property
    def host_ns(self) -> int:
        """UTC [ns] of the last sample; 0 before the first."""
        return 0 if self._least_delay_ns is None else self._last_device_ns + self._least_delay_ns
