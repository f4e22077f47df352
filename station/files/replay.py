"""A recording, played back as if its devices were delivering it now: through the daemon, its listeners and its writer.

What the station itself had written (armed, edge, closing) is left out, for it is said anew; so a replay tests the whole
way, and the fit of what comes out is the fit of what went in, bit for bit.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from recordings.errors import RecordingError
from recordings.manifest import DataOrigin, Manifest
from recordings.reader import Recording, open_recording
from recordings.samples import DeviceIdentity, Event, Item, Loss, Stream
from station.bench.bench_clock import BLOCK_S
from station.bench.snapshot import Snapshot
from station.bench.trial_recorder import TrialRecorder, TrialResult, View
from station.clock import ManualClock
from station.config import parse_config
from station.protocol import TrialSpec

CATCH_UP_S = 0.1
"""Wall seconds; a step that is later than this is not caught up."""


class ReplayClock(ManualClock):
    """Station time begins with the first sample and goes on in blocks, speed times as fast as the wall.

    It makes one pause, after the last sample, in which a trial that ended there is stopped as the operator stopped it.
    Begun on the wall is the trial when the recorded one was, for a fit goes by the order of the trials.
    """

    def __init__(self, first_host_ns: int, begun_utc_ns: int, speed: float) -> None:
        super().__init__(first_host_ns, BLOCK_S)
        self.is_over = self._has_paused = False
        self._begun_utc_ns, self._speed = begun_utc_ns, speed
        self._due_s = time.monotonic()

    def step(self, ports: Sequence[int] = ()) -> Mapping[int, int | None]:
        if self.is_over and not self._has_paused:
            self._has_paused = True
            return {}
        self._due_s = max(self._due_s + self._step_s / self._speed, time.monotonic() - CATCH_UP_S)
        time.sleep(max(0.0, self._due_s - time.monotonic()))
        return super().step(ports)

    def wall_utc_ns(self) -> int:
        return self._begun_utc_ns

    def wall_s(self) -> float:
        return time.monotonic()


class RecordedDevice:
    """Delivers the items of a recording when their time of arrival comes round again.

    Does not imitate: devices that have to be opened, or that end a capture without saying so.
    """

    def __init__(self, recording: Recording, clock: ReplayClock) -> None:
        self._recording, self._clock = recording, clock
        self._items: Iterator[Item] = iter(())
        self._next: Item | None = None

    @property
    def is_over(self) -> bool:
        return self._clock.is_over

    @property
    def name(self) -> str:
        return self._recording.path.name

    @property
    def streams(self) -> tuple[Stream, ...]:
        return self._recording.streams

    @property
    def identity(self) -> DeviceIdentity:
        """What the recorded devices said of themselves."""
        manifest = self._recording.manifest
        is_simulated = {DataOrigin.SIMULATED: True, DataOrigin.MEASURED: False, DataOrigin.UNKNOWN: None}
        texts = "; ".join(f"{device.name}: {device.text}" for device in manifest.devices)
        return DeviceIdentity(self.name, f"replayed, {texts}", is_simulated[manifest.origin])

    def open(self) -> None:
        self._items = _delivered(self._recording)
        self._next = next(self._items, None)

    def read(self, timeout_s: float) -> Sequence[Item]:  # noqa: ARG002  (time stands still while it is read)
        due: list[Item] = []
        now_ns = self._clock.utc_ns()
        while self._next is not None and self._next.host_time_ns <= now_ns:
            due.append(self._next)
            self._next = next(self._items, None)
        self._clock.is_over = self._next is None
        return due

    def close(self) -> None:
        self._items, self._next = iter(()), None


@dataclass
class _StopsAtTheEnd:
    """A view that ends the trial where the recording ends before its capture does, as an operator had then."""

    device: RecordedDevice
    daemon: TrialRecorder | None = None
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
    daemon = TrialRecorder(config, clock, [*views, ending], make_devices=lambda *_: [device], post_roll_s=math.inf)
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
