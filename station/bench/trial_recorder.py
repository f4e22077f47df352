"""Records one trial: opens the devices, hands what they deliver to the trial and the views, closes everything."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from queue import SimpleQueue
from typing import Protocol

from drivers.device import Device
from drivers.errors import DeviceLost, DeviceUnavailable
from recordings.errors import RecordingError
from recordings.manifest import BounceRig, CuffSite, DataOrigin, Manifest, TrialOutcome
from recordings.samples import DeviceIdentity, Item
from recordings.writer import RecordingWriter
from station.bench.devices import devices_for
from station.bench.disk import DiskWatch, bytes_free, bytes_needed
from station.bench.feed import Delivered, Feeds, Gone, Opened
from station.bench.session_folder import why_mixed
from station.bench.snapshot import Snapshot, TrialState
from station.bench.stepped_feed import SteppedFeeds
from station.bench.trial_order import start_after_all_in
from station.bench.trial_rules import POST_ROLL_S, TrialRules
from station.bench.trial_state_machine import TrialStateMachine
from station.checksums import write_checksums
from station.clock import Clock, SteppedClock
from station.config import StationConfig
from station.errors import StationError
from station.file_lock import locked
from station.protocol import TrialSpec
from station.versions import installed_versions
from station.windows_names import why_path_too_long

OPEN_TIMEOUT_S = 15.0
"""Wall seconds for all devices to open; they should take less than 4, a driver that hangs must not hold us for ever."""
CLOSE_TIMEOUT_S = 2.0
LOCK = ".recording.lock"
"""In the session's folder, from its first trial on."""


class TrialRefused(StationError):
    """The trial cannot begin: another one runs, or there is no room for it. One sentence."""


class View(Protocol):
    """Looks on. Must return at once and never raise; may drop what it has no time for, and says how much."""

    def offer(self, item: Item) -> None: ...

    def show(self, snapshot: Snapshot) -> None: ...


@dataclass(frozen=True)
class TrialResult:
    """What became of one trial; path is None when nothing was recorded."""

    path: Path | None
    accepted: bool = field(kw_only=True)
    lost_samples: int
    sentence: str
    origin: DataOrigin = DataOrigin.UNKNOWN


WhyNotHere = Callable[[Path, Sequence[DeviceIdentity]], str]
"""Session's folder and what its devices say of themselves → why they may not be recorded into it, or ""."""
MakeDevices = Callable[[StationConfig, CuffSite | BounceRig | None, Clock, Path], list[Device]]


class TrialRecorder:
    """Owns the devices' threads, the clock and the file. stop() may be called from a signal handler."""

    def __init__(
        self,
        config: StationConfig,
        clock: Clock,
        views: Sequence[View] = (),
        make_devices: MakeDevices = devices_for,
        post_roll_s: float = POST_ROLL_S,
        why_not_here: WhyNotHere = why_mixed,
    ) -> None:
        self._config, self._clock, self._views, self._make_devices = config, clock, views, make_devices
        self._post_roll_s, self._why_not_here = post_roll_s, why_not_here
        self._stops_asked = 0
        self._marks_asked: SimpleQueue[None] = SimpleQueue()
        self.left_behind: list[str] = []  # devices whose thread never came back

    def stop(self) -> None:
        """Once: ends the trial cleanly. Twice: at once."""
        self._stops_asked += 1

    def mark(self) -> None:
        """Marks this moment in the trial that is being recorded."""
        self._marks_asked.put(None)

    def record(self, folder: Path, spec: TrialSpec, duration_s: float | None = None) -> TrialResult:
        """Records one trial into the session folder and returns what became of it.

        Raises ConfigError, DeviceError, TrialRefused or RecordingError, each one sentence, when it cannot begin.
        """
        subject = self._config.subject(spec.cuff)
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
                self.left_behind += feeds.release(CLOSE_TIMEOUT_S * self._clock.timeout_scale)

    def _open(self, feeds: Feeds | SteppedFeeds) -> list[Opened]:
        """Waits until every device is open. Raises the first error that a device reports."""
        waiting = {feed.device.name for feed in feeds.feeds}
        opened: list[Opened] = []
        timeout_s = OPEN_TIMEOUT_S * self._clock.timeout_scale
        deadline = time.monotonic() + timeout_s
        while waiting:
            if self._stops_asked:
                raise TrialRefused("cancelled by the operator while the devices were opening; nothing was recorded")
            if time.monotonic() > deadline:
                raise DeviceUnavailable(
                    f"{', '.join(sorted(waiting))} did not open within {timeout_s:g} s; check power, cables and "
                    "the network"
                )
            for message in feeds.poll():
                if isinstance(message, Gone):
                    raise message.error
                if isinstance(message, Opened):
                    waiting.discard(message.device)
                    opened.append(message)
        return sorted(opened, key=lambda one: [feed.device.name for feed in feeds.feeds].index(one.device))

    def _record(
        self,
        folder: Path,
        spec: TrialSpec,
        subject: CuffSite | BounceRig,
        duration_s: float | None,
        feeds: Feeds | SteppedFeeds,
        opened: Sequence[Opened],
    ) -> TrialResult:
        streams = [stream for one in opened for stream in one.streams]
        device_by_stream = {stream.name: one.device for one in opened for stream in one.streams}
        devices = tuple(one.identity for one in opened)
        if why_not := self._why_not_here(folder, devices):
            raise TrialRefused(why_not)
        _ensure_room(folder, bytes_needed(streams, self._config, folder, duration_s))
        run = spec.next_free_run(folder)
        path = folder / spec.file_name(run)
        if sys.platform == "win32" and (why := why_path_too_long(path)):
            raise TrialRefused(why)
        start_utc_ns, set_back = start_after_all_in(folder, self._clock.wall_utc_ns())
        manifest = self._manifest(spec, run, subject, devices, start_utc_ns)
        writer = RecordingWriter(path, manifest, streams)
        rules = TrialRules(
            self._config.daq.start,
            self._config.sync.threshold_v,
            self._config.sync.timeout_s,
            duration_s,
            self._post_roll_s,
        )
        trial = TrialStateMachine(rules, writer, self._clock)
        try:
            trial.arm(streams, device_by_stream)
            if set_back:
                trial.note("clock_set_back", set_back)
            self._run(trial, feeds, DiskWatch(folder, self._clock))
        except RecordingError as error:
            trial.abandon(str(error))
        self._show(trial)
        if not trial.has_edge:
            writer.discard()
            return TrialResult(None, 0, trial.sentence, manifest.origin, accepted=False)
        accepted = trial.state is TrialState.CLOSED
        try:
            writer.close(TrialOutcome(accepted, trial.state.value, trial.sentence))
        except RecordingError as error:
            return TrialResult(path, trial.lost_samples, str(error), manifest.origin, accepted=False)
        with suppress(OSError):  # the trial is whole; that nobody can tell whether it stays so is told by every reader
            write_checksums(path)
        return TrialResult(path, trial.lost_samples, trial.sentence, manifest.origin, accepted=accepted)

    def _run(self, trial: TrialStateMachine, feeds: Feeds | SteppedFeeds, disk: DiskWatch) -> None:
        is_in_control = self._config.mocap.control == "start"
        controllers = [feed for feed in feeds.feeds if feed.can_control_capture and is_in_control]
        capture_asked = False
        self._show(trial)
        while not trial.is_over:
            self._take(trial, feeds)
            trial.tick()
            if warning := disk.warning():
                trial.cut_short("disk_nearly_full", warning)
            while not self._marks_asked.empty():
                self._marks_asked.get()
                trial.mark()
            if self._stops_asked:
                trial.stop(at_once=self._stops_asked > 1)
            if trial.wants_capture_start and not capture_asked:
                capture_asked = True
                for feed in controllers:
                    feed.request_capture(start=True)
            self._show(trial)
        if capture_asked:
            for feed in controllers:
                feed.request_capture(start=False)
            feeds.finish_requests()

    def _take(self, trial: TrialStateMachine, feeds: Feeds | SteppedFeeds) -> None:
        """Hands everything that has come to the trial and the views."""
        try:
            messages = feeds.take()
        except DeviceLost as error:
            return trial.fail(str(error))
        for message in messages:
            if isinstance(message, Gone):
                trial.fail(str(message.error), message.device)
            elif isinstance(message, Delivered):
                for item in message.items:
                    trial.handle(item)
                    for view in self._views:
                        view.offer(item)
        return None

    def _show(self, trial: TrialStateMachine) -> None:
        for view in self._views:
            view.show(trial.snapshot())

    def _manifest(
        self,
        spec: TrialSpec,
        run: int,
        subject: CuffSite | BounceRig,
        devices: tuple[DeviceIdentity, ...],
        start_utc_ns: int,
    ) -> Manifest:
        return Manifest(
            cuff=subject if isinstance(subject, CuffSite) else None,
            bounce=subject if isinstance(subject, BounceRig) else None,
            test=spec.test,
            repeat=spec.repeat,
            run=run,
            donning=spec.donning,
            start=self._config.daq.start,
            sync_threshold_v=self._config.sync.threshold_v,
            load_cell=self._config.calibration(),
            start_utc_ns=start_utc_ns,
            timing=self._config.timing(),
            protocol=self._config.measurement_protocol(),
            effective_config=self._config.model_dump(mode="json"),
            versions=installed_versions(),
            devices=devices,
        )


def _ensure_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise TrialRefused(
            f"the session's folder {folder} cannot be made ({error.strerror}); give --session a folder that can"
        ) from error
    if not os.access(folder, os.W_OK):
        raise TrialRefused(f"the session's folder {folder} cannot be written into; give another --session")


def _ensure_room(folder: Path, needed: float) -> None:
    free = bytes_free(folder)
    if free < needed:
        raise TrialRefused(
            f"the disk of {folder} has {free / 1e6:.0f} MB free, expected at least {needed / 1e6:.0f} MB "
            "for the trials that are planned; free some room"
        )


@contextmanager
def _one_trial_at_a_time(folder: Path) -> Iterator[None]:
    with ExitStack() as held:
        try:
            held.enter_context(locked(folder / LOCK, wait_s=0))
        except TimeoutError as error:
            raise TrialRefused(f"another trial is being recorded into {folder}; wait for it to end") from error
        except OSError as error:
            why = error.strerror or error
            raise TrialRefused(
                f"{folder} lets no file be locked ({why}); record onto a disk of this machine"
            ) from error
        yield
