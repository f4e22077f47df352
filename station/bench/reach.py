"""How far a stream has come: the moment, on the host's clock, at which its last sample was taken."""

from __future__ import annotations

from recordings.samples import Samples


class Reach:
    """Follows one stream block by block.

    The device's clock is laid on the host's by the block that came with the least delay, so a backlog shows as a reach
    that lies behind, although blocks arrive all the time.
    """

    def __init__(self) -> None:
        self._least_delay_ns: int | None = None
        self._last_device_ns = 0

    def feed(self, samples: Samples) -> None:
        """Takes a block that holds at least one sample."""
        self._last_device_ns = int(samples.device_time_ns[-1])
        delay_ns = samples.host_time_ns - self._last_device_ns
        self._least_delay_ns = delay_ns if self._least_delay_ns is None else min(self._least_delay_ns, delay_ns)

    @property
    def host_ns(self) -> int:
        """UTC [ns] of the last sample; 0 before the first."""
        return 0 if self._least_delay_ns is None else self._last_device_ns + self._least_delay_ns
