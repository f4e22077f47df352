"""Record one trial: open the devices, pass their items to the trial and the views, close everything.

The trials of a session keep their order, also if the system's clock is set back between two of them. Repeated events
are written once and with a count; samples are also counted for a check of the fit.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from queue import SimpleQueue
from typing import Any, Protocol

from documents.message import Message, because, join_sentences
from documents.regular_file import locked
from drivers.device import Device
from drivers.errors import DeviceCode, DeviceLost, DeviceUnavailable
from fitting.errors import UnusableTrial
from fitting.trial.decimation import Decimator
from recordings.errors import RecordingError
from recordings.manifest import DataOrigin, Manifest, TrialOutcome, TrialSubject
from recordings.reader import read_manifest
from recordings.samples import DeviceIdentity, Event, Item, Stream
from recordings.writer import RecordingWriter
from station.bench.devices import devices_for
from station.bench.feed import DeviceFailed, DeviceOpened, Feeds, ItemsReceived, SteppedFeeds
from station.bench.session_folder import DiskMonitor, bytes_free, bytes_needed, check_origin
from station.bench.trial_context import POST_ROLL_S, TrialRules
from station.bench.trial_state_machine import TrialStateMachine
from station.bench.view import Snapshot, TrialState
from station.checksums import write_checksums
from station.clock import Clock, SteppedClock
from station.config import StationConfig
from station.errors import StationError
from station.messages.bench_messages import RefusalCode, TrialCode
from station.protocol import TrialSpec, check_path_length
from station.trial_manifest import make_manifest

OPEN_TIMEOUT_S = 60.0
"""Wall seconds for all devices to open; usually less than 4, more than 15 on a busy computer that reads the vendors'
libraries from its disk for the first time. A driver that hangs must not block the recorder."""
CLOSE_TIMEOUT_S = 2.0
LOCK = ".recording.lock"
"""File in the session's folder, from its first trial on."""
CheckFolder = Callable[[Path, Sequence[DeviceIdentity]], Message[RefusalCode] | None]
"""Session's folder and identities of the devices → reason why they may not be recorded into it, or None."""
MakeDevices = Callable[[StationConfig, TrialSubject | None, Clock, Path], list[Device]]
AHEAD_S = 1.0
"""Wall seconds by which the time of a file may be ahead of the clock: file systems round."""
READ_ONE_BY_ONE = ("mark", "capture", "connection", "sync_edge")
"""Beginnings of the kinds of events whose times a reader of the recording uses."""


class TrialRefused(StationError):
    """The trial cannot begin."""


class View(Protocol):
    """Shows a running trial. Must return at once and never raise; may drop items if it counts them."""

    def offer(self, item: Item) -> None: ...

    def show(self, snapshot: Snapshot) -> None: ...


@dataclass(frozen=True)
class TrialResult:
    """Outcome of one trial; path is None when nothing was recorded, messages give the reason of its end."""

    path: Path | None
    accepted: bool = field(kw_only=True)
    lost_samples: int
    messages: tuple[Message[TrialCode], ...]
    origin: DataOrigin = DataOrigin.UNKNOWN

    @property
    def sentence(self) -> str:
        return join_sentences(self.messages)

    def to_json(self) -> dict[str, Any]:
        return {
            "path": None if self.path is None else str(self.path),
            "accepted": self.accepted,
            "lost_samples": self.lost_samples,
            "sentence": self.sentence,
            "codes": [asdict(message) for message in self.messages],
            "origin": self.origin.value,
        }


class TrialRecorder:
    """Owns the devices' threads, the clock and the file. stop() may be called from a signal handler."""

    def __init__(
        self,
        config: StationConfig,
        clock: Clock,
        views: Sequence[View] = (),
        make_devices: MakeDevices = devices_for,
        post_roll_s: float = POST_ROLL_S,
        check_folder: CheckFolder = check_origin,
    ) -> None:
        self._config, self._clock, self._views, self._make_devices = config, clock, views, make_devices
        self._post_roll_s, self._check_folder = post_roll_s, check_folder
        self._stops_requested = 0
        self._marks_requested: SimpleQueue[None] = SimpleQueue()
        self.abandoned: list[str] = []  # devices whose thread did not end
        self._path: Path | None = None
        self._origin = DataOrigin.UNKNOWN
        self._shown = TrialState.IDLE
        self._shown_events = RepeatedEvents()

    def stop(self) -> None:
        """End the trial: cleanly at the first call, at once at the second."""
        self._stops_requested += 1

    def mark(self) -> None:
        """Mark this moment in the running trial."""
        self._marks_requested.put(None)

    def record(self, folder: Path, spec: TrialSpec, duration_s: float | None = None) -> TrialResult:
        """Record one trial into the session folder and return its outcome.

        Without a duration it ends with the capture; a pose ends after the time that the configuration gives it.
        Raises ConfigError, DeviceError, TrialRefused or RecordingError if the trial cannot begin.
        """
        subject = self._config.subject(spec)
        if duration_s is None and spec.test == "pose":
            duration_s = self._config.measurement_protocol().pose_s
        if sys.platform == "win32" and (refusal := check_path_length(folder / spec.file_name(spec.repeat))):
            raise TrialRefused(refusal)
        _ensure_folder(folder)
        with _one_trial_at_a_time(folder):
            devices = self._make_devices(self._config, subject, self._clock, folder)
            feeds: Feeds | SteppedFeeds = (
                SteppedFeeds(devices, self._clock) if isinstance(self._clock, SteppedClock) else Feeds(devices)
            )
            try:
                feeds.start()
                return self._record(folder, spec, subject, duration_s, feeds, self._open(feeds))
            finally:
                self.abandoned += feeds.release(CLOSE_TIMEOUT_S * self._clock.timeout_scale)

    def _open(self, feeds: Feeds | SteppedFeeds) -> list[DeviceOpened]:
        """Wait until every device is open. Raises the first error of a device."""
        order = [feed.device.name for feed in feeds.feeds]
        waiting, opened = set(order), list[DeviceOpened]()
        timeout_s = OPEN_TIMEOUT_S * self._clock.timeout_scale
        deadline = time.perf_counter() + timeout_s
        while waiting:
            if self._stops_requested:
                raise TrialRefused(Message(RefusalCode.CANCELLED_OPENING))
            if time.perf_counter() > deadline:
                raise DeviceUnavailable(
                    f"{', '.join(sorted(waiting))} did not open within {timeout_s:g} s; check power, cables and "
                    "the network",
                    DeviceCode.NO_ANSWER,
                )
            for message in feeds.poll():
                if isinstance(message, DeviceFailed):
                    raise message.error
                if isinstance(message, DeviceOpened):
                    waiting.discard(message.device)
                    opened.append(message)
        return sorted(opened, key=lambda message: order.index(message.device))

    def _record(
        self,
        folder: Path,
        spec: TrialSpec,
        subject: TrialSubject,
        duration_s: float | None,
        feeds: Feeds | SteppedFeeds,
        opened: Sequence[DeviceOpened],
    ) -> TrialResult:
        streams = [stream for device in opened for stream in device.streams]
        device_by_stream = {stream.name: device.device for device in opened for stream in device.streams}
        devices = tuple(device.identity for device in opened)
        if refusal := self._check_folder(folder, devices):
            raise TrialRefused(refusal)
        _ensure_space(folder, bytes_needed(streams, self._config, folder, duration_s))
        run = spec.next_free_run(folder)
        self._path = path = folder / spec.file_name(run)
        start_utc_ns, set_back = start_time_after_all(folder, self._clock.wall_utc_ns())
        manifest = make_manifest(
            self._config,
            spec,
            run,
            subject,
            start_utc_ns,
            start=self._config.daq.start,
            load_cell=self._config.calibration(),
        )
        manifest = replace(manifest, devices=devices)
        self._origin = manifest.origin
        writer = RecordingWriter(path, manifest, streams)
        rules = TrialRules(
            self._config.daq.start,
            self._config.sync.threshold_v,
            self._config.sync.timeout_s,
            duration_s,
            self._post_roll_s,
            manifest.is_force_used,
        )
        items, disk = RecordedItems(writer, manifest, streams), DiskMonitor(path, self._clock)
        trial = TrialStateMachine(rules, items, self._clock)
        try:
            trial.arm(streams, device_by_stream)
            if set_back is not None:
                trial.note(set_back)
            self._run(trial, feeds, disk)
            if trial.state is TrialState.CLOSED and (fault := disk.moved() or items.misalignment()):
                trial.refuse(fault)
            if trial.has_edge:
                items.write_summary()
        except RecordingError as error:
            trial.abandon(error)
        self._show(trial)
        return _close(trial, writer, path, disk, manifest.origin)

    def _run(self, trial: TrialStateMachine, feeds: Feeds | SteppedFeeds, disk: DiskMonitor) -> None:
        is_in_control = self._config.mocap.control == "start"
        controllers = [feed for feed in feeds.feeds if feed.can_control_capture and is_in_control]
        is_capture_requested = False
        self._show(trial)
        while not trial.is_over:
            self._receive(trial, feeds)
            trial.tick()
            if warning := disk.poll():
                trial.cut_short(warning)
            while not self._marks_requested.empty():
                self._marks_requested.get()
                trial.mark()
            if self._stops_requested:
                trial.stop(at_once=self._stops_requested > 1)
            if trial.wants_capture_start and not is_capture_requested:
                is_capture_requested = True
                for feed in controllers:
                    feed.request_capture(start=True)
            self._show(trial)
        if is_capture_requested:
            for feed in controllers:
                feed.request_capture(start=False)
            feeds.finish_requests()

    def _receive(self, trial: TrialStateMachine, feeds: Feeds | SteppedFeeds) -> None:
        """Pass all items that have arrived to the trial and the views."""
        try:
            messages = feeds.receive()
        except DeviceLost as error:
            return trial.fail(error)
        for message in messages:
            if isinstance(message, DeviceFailed):
                trial.fail(message.error, message.device)
            elif isinstance(message, ItemsReceived):
                for item in message.items:
                    trial.handle(item)
                    if trial.state is not self._shown:  # a view knows the state in which an item was recorded
                        self._show(trial)
                    for view in () if self._shown_events.is_repeat(item) else self._views:
                        view.offer(item)
        return None

    def _show(self, trial: TrialStateMachine) -> None:
        self._shown = trial.state
        for view in self._views:
            view.show(replace(trial.snapshot(), recording=self._path, origin=self._origin))


def _close(
    trial: TrialStateMachine, writer: RecordingWriter, path: Path, disk: DiskMonitor, origin: DataOrigin
) -> TrialResult:
    """Close the file of a trial that is over; a trial without a sync edge leaves none."""
    if not trial.has_edge:
        writer.discard()
        return TrialResult(None, 0, trial.messages, origin, accepted=False)
    accepted = trial.state is TrialState.CLOSED
    codes = tuple(message.code.value for message in trial.messages)
    try:
        writer.close(TrialOutcome(accepted, trial.state.value, trial.sentence, codes=codes))
    except RecordingError as error:
        place = disk.moved()
        failed = place or Message(TrialCode.WRITE_FAILED, because(error))
        return TrialResult(None if place else path, trial.lost_samples, (failed,), origin, accepted=False)
    with suppress(OSError):  # the recording is complete; a reader reports that it has no checksum
        write_checksums(path)
    return TrialResult(path, trial.lost_samples, trial.messages, origin, accepted=accepted)


def _ensure_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise _refused(RefusalCode.FOLDER_NOT_MADE, folder=str(folder), reason=str(error.strerror)) from error
    if not os.access(folder, os.W_OK):
        raise _refused(RefusalCode.FOLDER_READ_ONLY, folder=str(folder))


def _ensure_space(folder: Path, needed: float) -> None:
    free = bytes_free(folder)
    if free < needed:
        raise _refused(RefusalCode.DISK_FULL, folder=str(folder), free_mb=free / 1e6, needed_mb=needed / 1e6)


def _refused(code: RefusalCode, **figures: float | str) -> TrialRefused:
    return TrialRefused(Message(code, figures))


@contextmanager
def _one_trial_at_a_time(folder: Path) -> Iterator[None]:
    with ExitStack() as stack:
        try:
            stack.enter_context(locked(folder / LOCK, wait_s=0))
        except TimeoutError as error:
            raise _refused(RefusalCode.FOLDER_IN_USE, folder=str(folder)) from error
        except OSError as error:
            reason = error.strerror or str(error)
            raise _refused(RefusalCode.NO_LOCKS, folder=str(folder), reason=reason) from error
        yield


def start_time_after_all(folder: Path, start_utc_ns: int) -> tuple[int, Message[TrialCode] | None]:
    """UTC [ns] for a trial that starts now, later than every trial in the folder; a message if the clock was set back.

    Migration and calibration depend on this order. The clock was set back if a file was written at a future time; the
    start time of a recording is no evidence, because a replay has a start time in the past.
    """
    paths = list(folder.glob("*.mcap"))
    written_s = max((path.stat().st_mtime for path in paths), default=0.0)
    if written_s < (now_s := time.time()) + AHEAD_S:
        return start_utc_ns, None
    latest_ns = max(map(_start_utc_ns, paths))
    message = Message(TrialCode.CLOCK_SET_BACK, {"now_utc": _utc(now_s), "last_utc": _utc(written_s)})
    return max(start_utc_ns, latest_ns + 1), message


def _start_utc_ns(path: Path) -> int:
    with suppress(RecordingError, OSError):
        return read_manifest(path).start_utc_ns
    return 0


def _utc(seconds: float) -> str:
    return f"{datetime.fromtimestamp(seconds, UTC):%Y-%m-%d %H:%M:%S} UTC"


class RepeatedEvents:
    """Passes the first event of a kind and source, and counts those that follow."""

    def __init__(self) -> None:
        self._counts: dict[tuple[str, str], int] = {}
        self._latest: dict[tuple[str, str], Event] = {}

    def is_repeat(self, item: Item) -> bool:
        """Count the item; whether it is an event of a kind and source that was passed before."""
        if not isinstance(item, Event) or item.kind.startswith(READ_ONE_BY_ONE):
            return False
        key = item.kind, item.source
        self._counts[key] = self._counts.get(key, 0) + 1
        self._latest[key] = item
        return self._counts[key] > 1

    def summary(self) -> list[Event]:
        """An event with the count of every kind and source that was repeated."""
        return [
            replace(event, text=f"{self._counts[key]} times in this trial, at last: {event.text}")
            for key, event in self._latest.items()
            if self._counts[key] > 1
        ]


class RecordedItems:
    """Writes the items of a trial, and judges at its end whether a fit can align its streams."""

    def __init__(self, writer: RecordingWriter, manifest: Manifest, streams: Iterable[Stream]) -> None:
        self._writer, self._manifest = writer, manifest
        self._decimator, self._repeated = Decimator(manifest, streams), RepeatedEvents()

    def write(self, item: Item) -> None:
        if not self._repeated.is_repeat(item):
            self._decimator.take(item)
            self._writer.write(item)

    def flush_if_due(self) -> None:
        self._writer.flush_if_due()

    def write_summary(self) -> None:
        """Write the counts of repeated events."""
        for event in self._repeated.summary():
            self._writer.write(event)

    def misalignment(self) -> Message[TrialCode] | None:
        """Reason why a fit could not align the streams; None if it can. Call once, after the last item."""
        from fitting.trial.timeline import align_by_sync_edge  # takes as long to import as a device to open

        if not self._manifest.begins_at_edge:
            return None
        try:
            align_by_sync_edge(self._manifest, self._decimator.tracks())
        except UnusableTrial as error:
            reason = error.reason
            return Message(TrialCode.NOT_ALIGNED, because(reason))
        return None
