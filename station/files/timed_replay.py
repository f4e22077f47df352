"""Replay a recording through recorder, views and writer, as if its devices delivered it now.

Events of the station (armed, edge, closing) are left out, because they are generated again; so a replay tests the whole
chain, and the fit of the new recording equals that of the original bit for bit.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from documents.message import Message
from recordings.manifest import DataOrigin
from recordings.reader import Recording, open_recording
from recordings.samples import DeviceIdentity, Event, Item, Loss, Stream
from station.bench.bench_clock import BLOCK_S
from station.bench.trial_recorder import TrialRecorder, TrialResult, View
from station.bench.view import Snapshot
from station.clock import ManualClock
from station.config import parse_config
from station.errors import StationError
from station.messages.file_messages import ExportCode
from station.protocol import TrialSpec

CATCH_UP_S = 0.1
"""Wall seconds; a longer delay is not caught up."""


class ReplayRefused(StationError):
    """The recording cannot be replayed."""


class ReplayClock(ManualClock):
    """Station time starts at the first sample and advances in blocks, speed times as fast as wall time.

    It pauses once, after the last sample, so that a trial whose recording ends there can be stopped as by the operator.
    The wall time of the start is that of the recorded trial, because the fit uses the order of the trials.
    """

    def __init__(self, first_host_ns: int, begun_utc_ns: int, speed: float) -> None:
        super().__init__(first_host_ns, BLOCK_S)
        self.is_over = self._has_paused = False
        self._begun_utc_ns, self._speed = begun_utc_ns, speed
        self._due_s = time.perf_counter()

    def step(self, ports: Sequence[int] = ()) -> Mapping[int, int | None]:
        if self.is_over and not self._has_paused:
            self._has_paused = True
            return {}
        self._due_s = max(self._due_s + self._step_s / self._speed, time.perf_counter() - CATCH_UP_S)
        time.sleep(max(0.0, self._due_s - time.perf_counter()))
        return super().step(ports)

    def wall_utc_ns(self) -> int:
        return self._begun_utc_ns

    def wall_s(self) -> float:
        return time.perf_counter()


class RecordedDevice:
    """Delivers the items of a recording at their times of arrival.

    Not imitated: the opening of devices, and devices that end a capture without a message.
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
        """The identity that the recorded devices reported."""
        manifest = self._recording.manifest
        is_simulated = {DataOrigin.SIMULATED: True, DataOrigin.MEASURED: False, DataOrigin.UNKNOWN: None}
        texts = "; ".join(f"{device.name}: {device.text}" for device in manifest.devices)
        return DeviceIdentity(self.name, f"replayed, {texts}", is_simulated[manifest.origin])

    def open(self) -> None:
        self._items = _delivered(self._recording)
        self._next = next(self._items, None)

    def read(self, timeout_s: float) -> Sequence[Item]:  # noqa: ARG002  (no time passes during a read)
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
class _StopAtEnd:
    """A view that stops the trial at the end of the recording if its capture has not ended, as the operator did."""

    device: RecordedDevice
    recorder: TrialRecorder | None = None
    has_stopped: bool = False

    def offer(self, item: Item) -> None: ...

    def show(self, snapshot: Snapshot) -> None:  # noqa: ARG002  (the device detects the end)
        if self.device.is_over and self.recorder is not None and not self.has_stopped:
            self.has_stopped = True
            self.recorder.stop()


def replay(path: Path, folder: Path, speed: float, views: Sequence[View] = ()) -> TrialResult:
    """Replay a recording into a session folder. Raises ReplayRefused for one without samples or sync edge."""
    recording = open_recording(path)
    first = next(_delivered(recording), None)
    if first is None:
        raise ReplayRefused(Message(ExportCode.NO_SAMPLES, {"path": str(path)}))
    manifest = recording.manifest
    if not manifest.begins_at_edge:
        raise ReplayRefused(Message(ExportCode.NO_SYNC_EDGE, {"path": str(path)}))
    clock = ReplayClock(first.host_time_ns, manifest.start_utc_ns, speed)
    device = RecordedDevice(recording, clock)
    ending = _StopAtEnd(device)
    config = parse_config(manifest.effective_config, str(path))
    recorder = TrialRecorder(config, clock, [*views, ending], make_devices=lambda *_: [device], post_roll_s=math.inf)
    ending.recorder = recorder
    return recorder.record(folder, TrialSpec.of_recording(manifest))


def _delivered(recording: Recording) -> Iterator[Item]:
    """The items that the devices delivered, without events of the station and losses that it detected as silence."""
    for item in recording.items():
        if isinstance(item, Stream) or (isinstance(item, Event) and item.source == "station"):
            continue
        if isinstance(item, Loss) and item.cause == "silent":
            continue
        yield item
