"""Record one trial in a process of its own, started by TrialProcess.

The first message is a TrialRequest. Every further one is a command: {"stop": true} (the first ends the trial cleanly,
the second at once) or {"mark": true}. The recorder sends telemetry twenty times a second and, last, {"result": {…}} or
{"refused": "a sentence", "code": "…"}. If the console ends, freezes or stops receiving, the trial continues to the end
of its capture, its result is written to the session's journal, and the process ends.

Telemetry holds its time (at, Unix seconds), the state of the trial with its codes, the rate of every stream, the
position of every marker (points, mm, null if hidden, in the order of seen), the RMS of the last EMG (emg_uv,
microvolts), and force, displacement of the cuff or elevation of the wearer's arm, and events since the last one. If the
console does not receive, items are dropped and counted; the recording is not affected.
"""

from __future__ import annotations

import math
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Mapping
from contextlib import ExitStack, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel

from documents.interval import counted
from documents.message import join_sentences
from drivers.errors import DeviceError
from fitting.trial.analog_signals import VOLTS
from fitting.wearer.wearer_trial import elevation_from_markers
from recordings.manifest import BodyMarkers, BounceRig, CuffSite, EmgAmplifier, LoadCell
from recordings.samples import Event, Item, Loss, Samples
from recordings.topics import EMG
from station.bench.bench_clock import BenchClock
from station.bench.live_displacement import LiveDisplacement
from station.bench.session_folder import RESERVE_BYTES, bytes_free, check_folder
from station.bench.trial_recorder import TrialRecorder, TrialResult
from station.bench.view import BackgroundView, Snapshot, StreamTally, StreamTelemetry, TrialState, TrialTelemetry
from station.child import ProcessLink, exit_at_once
from station.clock import ArrivalClock, Clock, RealClock
from station.config import StationConfig
from station.errors import StationError
from station.journal import Recorded, write_recorded
from station.live.tap import live_views
from station.protocol import TrialSpec

RESULT_TIMEOUT_S = 10.0
"""Wall seconds for a console that does not receive to take the result: a busy computer holds it up for seconds."""
REFRESH_S = 0.05
RATE_REFRESHES = 60
BACKLOG = 2000
POINT_S = 0.025
"""Station seconds between two points of a curve."""
DISK_INTERVAL_S = 2.0
"""Wall seconds between two queries of the free disk space."""


class TrialRequest(BaseModel):
    """The first message: clock_port is that of a simulated bench's clock, None for a real bench; speed its pace."""

    config: StationConfig
    folder: Path
    spec: TrialSpec
    clock_port: int | None
    speed: float | None


def main(console: ProcessLink) -> NoReturn:
    request = console.receive()
    if request is not None:
        writer = threading.Thread(target=_send, args=(console, _outcome(console, request)), name="result", daemon=True)
        writer.start()
        writer.join(RESULT_TIMEOUT_S)
    exit_at_once(0)  # a frozen device, or a console that does not receive, would block a normal exit


def _outcome(console: ProcessLink, message: dict[str, Any]) -> dict[str, Any]:
    try:
        return {"result": asdict(_record(console, TrialRequest.model_validate(message)))}
    except Exception as error:  # every error must reach the operator
        sentence = " ".join(str(error).split()) or type(error).__name__
        return {"refused": sentence, "code": error.code if isinstance(error, StationError | DeviceError) else ""}


def _record(console: ProcessLink, request: TrialRequest) -> Recorded:
    config, spec, folder, port = request.config, request.spec, request.folder, request.clock_port
    with ExitStack() as stack:
        bench_clock = None if port is None else stack.enter_context(BenchClock(port, request.speed))
        clock: Clock = bench_clock or RealClock()
        emg = config.emg.amplifier() if config.emg is not None else None
        view = Telemetry(console.send, config.subject(spec), config.calibration(), folder, bench_clock, emg)
        telemetry = stack.enter_context(view)
        taps = [stack.enter_context(tap) for tap in live_views(config, folder, spec, clock)]
        recorder = TrialRecorder(config, clock, [telemetry, *taps], check_folder=check_folder)
        threading.Thread(target=_execute_commands, args=(console, recorder), name="commands", daemon=True).start()
        result = recorder.record(folder, spec)
    recorded = _recorded(spec, result)
    if result.path is not None:
        write_recorded(folder, recorded)
    return recorded


def _recorded(spec: TrialSpec, result: TrialResult) -> Recorded:
    return Recorded(
        result.path.name if result.path else "",
        spec.cuff,
        spec.test,
        spec.repeat,
        spec.donning,
        result.accepted,
        result.lost_samples,
        result.sentence,
        result.messages,
        result.origin,
        spec.condition,
    )


def _execute_commands(console: ProcessLink, recorder: TrialRecorder) -> None:
    for command in console:
        if command.get("stop"):
            recorder.stop()
        elif command.get("mark"):
            recorder.mark()


def _send(console: ProcessLink, result: dict[str, Any]) -> None:
    with suppress(OSError):  # the console has ended; the journal has the result
        console.send(result)


class Telemetry(BackgroundView):
    """A view of one trial. Times are station seconds since the view's first sample.

    bench_clock is that of a simulated bench; a bench that is slower than its set pace is reported.
    """

    def __init__(
        self,
        send: Callable[[dict[str, Any]], None],
        markers: CuffSite | BounceRig | BodyMarkers,
        load_cell: LoadCell,
        folder: Path,
        bench_clock: BenchClock | None = None,
        emg: EmgAmplifier | None = None,
    ) -> None:
        super().__init__("telemetry", REFRESH_S, BACKLOG)
        self._send, self._load_cell = send, load_cell
        self._pulled = None if isinstance(markers, BodyMarkers) else markers
        self._body = markers if isinstance(markers, BodyMarkers) else None
        self._disk = _DiskTime(folder)
        self._bench_clock, self._emg = bench_clock, emg
        self._snapshot = Snapshot(TrialState.IDLE)
        self._tallies: dict[str, StreamTally] = {}
        self._new = TrialTelemetry()  # curves and events since the last message
        self._first_host_ns: int | None = None
        self._clocks: defaultdict[str, ArrivalClock] = defaultdict(ArrivalClock)  # by stream
        self._now_s = 0.0
        self._displacement: LiveDisplacement | None = None
        self._seen: dict[str, bool] = {}
        self._points: list[list[float] | None] = []
        self._sync_v: float | None = None
        self._emg_uv: dict[str, float] = {}

    def show(self, snapshot: Snapshot) -> None:
        self._snapshot = snapshot

    def _refresh(self) -> None:
        super()._refresh()
        message = self._message()
        self._new = TrialTelemetry()
        with suppress(OSError):  # the console has ended; the trial continues
            self._send(message.model_dump(mode="json"))

    def _message(self) -> TrialTelemetry:
        snapshot, nominal = self._snapshot, {stream.name: stream.rate_hz for stream in self._snapshot.streams}
        return TrialTelemetry(
            at=time.time(),
            state=snapshot.state.value,
            codes=tuple(code for message in snapshot.messages for code in message.codes),
            sentence=snapshot.sentence,
            problems=join_sentences(snapshot.messages[1:]),
            sync_v=self._sync_v if snapshot.sync_level_v is None else snapshot.sync_level_v,
            waited_s=snapshot.waited_s,
            left_s=snapshot.left_s,
            recorded_s=snapshot.recorded_s,
            edge_s=self._edge_s(),
            lost_samples=snapshot.lost_samples,
            marks=snapshot.marks,
            dropped=self.dropped,
            slow_rate=self._bench_clock.slow_rate if self._bench_clock is not None else None,
            disk_left_s=self._disk.left_s(self._now_s),
            streams={
                name: StreamTelemetry(
                    rate_hz=tally.rate(self._now_s), nominal_hz=nominal.get(name, 0.0), samples=tally.total
                )
                for name, tally in self._tallies.items()
            },
            force=self._new.force,
            displacement=self._new.displacement,
            elevation=self._new.elevation,
            emg_uv=self._emg_uv,
            seen=self._seen,
            points=self._points,
            events=self._new.events,
        )

    def _edge_s(self) -> float | None:
        """Time of the sync edge; None before it."""
        edge_ns = self._snapshot.edge_device_ns
        if edge_ns is None or "/sync" not in self._clocks or self._first_host_ns is None:
            return None
        return (edge_ns + self._clocks["/sync"].offset_ns - self._first_host_ns) * 1e-9

    def _handle(self, item: Item) -> None:
        if isinstance(item, Event):
            self._new.events.append(item.text)
        elif isinstance(item, Loss):
            self._new.events.append(f"lost {counted(item.count, 'sample')} of {item.stream}: {item.cause}")
        elif len(item.values):
            self._tallies.setdefault(item.stream, StreamTally(RATE_REFRESHES)).add(item)
            self._disk.bytes_received += item.values.nbytes + item.device_time_ns.nbytes
            self._handle_samples(item, self._times(item))

    def _handle_samples(self, samples: Samples, times: NDArray[np.float64]) -> None:
        self._now_s = max(self._now_s, float(times[-1]))
        if samples.stream == "/force":
            newtons = samples.values[:, 0] * self._load_cell.newtons_per_unit * self._load_cell.polarity
            self._new.force += _decimated(times, newtons)
        elif samples.stream == "/sync":
            self._sync_v = float(samples.values[-1, 0])
        elif samples.stream == "/markers":
            self._handle_markers(samples, times)
        elif samples.stream == EMG:
            self._handle_emg(samples)

    def _handle_emg(self, samples: Samples) -> None:
        """RMS about the mean of the block, in microvolts at the electrodes."""
        stream = next((stream for stream in self._snapshot.streams if stream.name == EMG), None)
        if stream is None or self._emg is None or stream.unit not in VOLTS:
            return
        rms = 1e6 * VOLTS[stream.unit] * np.std(samples.values, axis=0)
        pairs = zip(stream.labels, rms, strict=False)
        self._emg_uv = {label: round(float(value) / self._emg.gains.get(label, 1.0), 1) for label, value in pairs}

    def _handle_markers(self, samples: Samples, times: NDArray[np.float64]) -> None:
        labels: Mapping[str, tuple[str, ...]] = {stream.name: stream.labels for stream in self._snapshot.streams}
        names = labels.get("/markers", ())
        if len(names) != samples.values.shape[1]:
            return
        last = samples.values[-1, :, :3].astype(np.float64)
        self._points = [point.round(1).tolist() if np.isfinite(point).all() else None for point in last]
        self._seen = {name: point is not None for name, point in zip(names, self._points, strict=True)}
        if self._pulled is not None:
            if self._displacement is None:
                self._displacement = LiveDisplacement(self._pulled, names)
            self._new.displacement += _decimated(times, self._displacement.update(samples.values))
        elif self._body is not None:
            places = samples.values[..., :3].astype(np.float64)
            angle = elevation_from_markers(places, names, self._body.arm, self._body.trunk)
            self._new.elevation += [] if angle is None else _decimated(times, np.degrees(angle))

    def _times(self, samples: Samples) -> NDArray[np.float64]:
        """Seconds on the host's clock since the first block arrived."""
        if self._first_host_ns is None:
            self._first_host_ns = samples.host_time_ns
        return np.asarray((self._clocks[samples.stream].update(samples) - self._first_host_ns) * 1e-9)


class _DiskTime:
    """Remaining recording time on the disk at the mean data rate so far, uncompressed."""

    def __init__(self, folder: Path) -> None:
        self.bytes_received = 0
        self._folder = folder
        self._free: int | None = None
        self._next_query_s = -math.inf

    def left_s(self, passed_s: float) -> float | None:
        """Seconds until only the reserve is left; None before the first sample, or if the disk does not answer."""
        if time.perf_counter() >= self._next_query_s:
            self._next_query_s = time.perf_counter() + DISK_INTERVAL_S
            try:
                self._free = bytes_free(self._folder)
            except OSError:
                self._free = None
        if self._free is None or not self.bytes_received or passed_s <= 0:
            return None
        return max(0.0, self._free - RESERVE_BYTES) * passed_s / self.bytes_received


def _decimated(times: NDArray[np.float64], values: NDArray[np.floating]) -> list[tuple[float, float]]:
    """Evenly spaced points of a block, without NaN."""
    count = min(len(times), 1 + math.ceil((times[-1] - times[0]) / POINT_S))
    chosen = np.unique(np.linspace(0, len(times) - 1, count).round().astype(int))
    points = [(round(float(times[i]), 4), round(float(values[i]), 4)) for i in chosen]
    return [point for point in points if np.isfinite(point[1])]
