"""A recording, played back as if its devices were delivering it now: through the daemon, its listeners and its writer.

What the station itself had written (armed, edge, closing) is left out, for it is said anew; so a replay tests the whole
way, and the fit of what comes out is the fit of what went in, bit for bit.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from recordings.errors import RecordingError
from recordings.manifest import Manifest
from recordings.reader import Recording, open_recording
from recordings.samples import Event, Item, Loss, Stream
from station.bench.daemon import Daemon, TrialResult, View
from station.bench.session import Snapshot
from station.clock import RealClock
from station.config import parse_config
from station.protocol import TrialSpec

PATIENCE_S = 0.02


class ReplayClock(RealClock):
    """Station time begins with the first sample; begun on the wall is the trial when the recorded one was, for a fit
    goes by the order of the trials."""

    def __init__(self, first_host_ns: int, begun_utc_ns: int, speed: float) -> None:
        super().__init__(speed)
        self._start_utc_ns, self._begun_utc_ns = first_host_ns, begun_utc_ns

    def wall_utc_ns(self) -> int:
        return self._begun_utc_ns


class RecordedDevice:
    """Delivers the items of a recording when their time of arrival comes round again.

    Does not imitate: devices that have to be opened, or that end a capture without saying so.
    """

    def __init__(self, recording: Recording, clock: RealClock) -> None:
        self._recording, self._clock = recording, clock
        self._items: Iterator[Item] = iter(())
        self._next: Item | None = None
        self.is_over = False

    @property
    def name(self) -> str:
        return self._recording.path.name

    @property
    def streams(self) -> tuple[Stream, ...]:
        return self._recording.streams

    def open(self) -> None:
        self._items = _delivered(self._recording)
        self._next = next(self._items, None)

    def read(self, timeout_s: float) -> Sequence[Item]:
        due: list[Item] = []
        deadline = self._clock.wall_s() + timeout_s
        while not due and self._next is not None and self._clock.wall_s() < deadline:
            now_ns = self._clock.utc_ns()
            while self._next is not None and self._next.host_time_ns <= now_ns:
                due.append(self._next)
                self._next = next(self._items, None)
            if not due:
                time.sleep(PATIENCE_S / self._clock.speed)
        if self._next is None and not due:
            self.is_over = True
            time.sleep(timeout_s)
        return due

    def close(self) -> None:
        self._items, self._next = iter(()), None


@dataclass
class _StopsAtTheEnd:
    """A view that ends the trial where the recording ends before its capture does, as an operator had then."""

    device: RecordedDevice
    daemon: Daemon | None = None
    has_stopped: bool = False

    def offer(self, item: Item) -> None: ...

    def show(self, snapshot: Snapshot) -> None:  # noqa: ARG002  (the device knows better when it is over)
        if self.device.is_over and self.daemon is not None and not self.has_stopped:
            self.has_stopped = True
            self.daemon.stop()


def replay(path: Path, folder: Path, speed: float, views: Sequence[View] = ()) -> TrialResult:
    """Records the recording anew into a session's folder. Raises RecordingError where it holds nothing to play."""
    recording = open_recording(path)
    first = next(_delivered(recording), None)
    if first is None:
        raise RecordingError(f"{path} holds no samples; there is nothing to play back")
    manifest = recording.manifest
    if not manifest.begins_at_edge:
        raise RecordingError(
            f"{path} was imported without a sync line, expected the edge that begins a trial; it can be fitted and "
            "exported, not played back"
        )
    clock = ReplayClock(first.host_time_ns, manifest.start_utc_ns, speed)
    device = RecordedDevice(recording, clock)
    ending = _StopsAtTheEnd(device)
    config = parse_config(manifest.effective_config, str(path))
    daemon = Daemon(config, clock, [*views, ending], make_devices=lambda *_: [device], post_roll_s=math.inf)
    ending.daemon = daemon
    return daemon.record(folder, _spec(manifest))


def _spec(manifest: Manifest) -> TrialSpec:
    return TrialSpec(manifest.cuff.name if manifest.cuff else None, manifest.test, manifest.repeat, manifest.donning)


def _delivered(recording: Recording) -> Iterator[Item]:
    """What the devices had sent: all but the station's own events and the silences that it noted."""
    for item in recording.items():
        if isinstance(item, Stream) or (isinstance(item, Event) and item.source == "station"):
            continue
        if isinstance(item, Loss) and item.cause == "silent":
            continue
        yield item
