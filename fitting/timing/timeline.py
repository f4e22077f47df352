"""The streams of one recording on one clock: force in newtons and markers in metres over session time."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fitting import calibration, quality
from fitting.quality import UnusableTrial
from fitting.timing import clocks, sync_line
from fitting.timing.clock_fit import ClockFit, fit_clock
from fitting.timing.clocks import LagUncertainty, SyncEdges
from fitting.timing.stop_edge import stop_window
from fitting.timing.sync_notes import early_notes, stop_notes
from recordings.manifest import Manifest
from recordings.reader import Track
from recordings.samples import Stream

MILLIMETRE = 1e-3
SHORTEST = 1.0
"""Seconds of force and markers together in which anything could be held or swing."""


@dataclass(frozen=True)
class Timeline:
    """Both streams from the edge to the end of the shorter one. Session time 0 is the rising edge of /sync.

    force_time, force    (n,) s, N: without the samples that were lost; zero not removed
    force_step           N per converter code, 0 if not known
    marker_time          (frames,) s, a regular grid
    markers              (frames, labels, 3) m in the mocap frame; NaN where a marker was not seen or no frame came
    clock, lag           the DAQ's clock against the mocap system's, and what is not known of force time
    sync_fall            s, when the sync line fell again; None where that was not recorded
    force_gaps, frame_gaps  (start, end) s of samples that were numbered and not recorded
    notes                what a reader should know before believing it
    """

    force_time: NDArray[np.float64]
    force: NDArray[np.float64]
    force_step: float
    marker_time: NDArray[np.float64]
    markers: NDArray[np.float64]
    clock: ClockFit
    lag: LagUncertainty
    sync_fall: float | None
    force_gaps: tuple[tuple[float, float], ...]
    frame_gaps: tuple[tuple[float, float], ...]
    notes: tuple[str, ...]


def lay_out(manifest: Manifest, tracks: Mapping[str, Track], labels: tuple[str, ...]) -> Timeline:
    """The streams "/force", "/sync" and "/markers" with these labels. Raises UnusableTrial in one sentence."""
    force, frames = _counted(tracks, "/force"), _counted(tracks, "/markers")
    quality.require_labels(labels, frames.stream.labels)
    raw = force.values[:, 0].astype(np.float64)
    quality.require_sound_force(raw, _full_scale(manifest, force.stream), force.stream.unit)
    both = tie_by_edge(manifest, tracks) if manifest.begins_at_edge else _as_declared(manifest, force, frames)
    frames, first_frame, notes = both.frames, both.first_frame, both.notes
    grid = _regular(frames, labels)
    marker_time = first_frame + np.arange(len(grid)) / frames.stream.rate_hz
    lag = _declared_lag(manifest, both.edge_sd, both.drift)
    force_time = both.force_time + lag.value
    in_force, in_frames = _overlap(force_time, marker_time)
    newtons = calibration.to_newtons(raw, manifest.load_cell)
    end = min(force_time[-1], marker_time[-1])
    force_gaps = _gaps(force.numbers, force_time, end)
    frame_gaps = _gaps(frames.numbers, first_frame + frames.seconds - frames.seconds[0], end)
    return Timeline(
        force_time=force_time[in_force],
        force=newtons[in_force],
        force_step=calibration.code_width(newtons),
        marker_time=marker_time[in_frames],
        markers=MILLIMETRE * grid[in_frames],
        clock=both.clock,
        lag=lag,
        sync_fall=both.sync_fall,
        force_gaps=force_gaps,
        frame_gaps=frame_gaps,
        notes=notes + quality.loss_notes(force_gaps, frame_gaps),
    )


@dataclass(frozen=True)
class Counted:
    """A track with its numbers (n,) as signed integers and its host times (n,) in seconds since the first sample."""

    stream: Stream
    numbers: NDArray[np.int64]
    device_time: NDArray[np.float64]
    host_time: NDArray[np.float64]
    values: NDArray[Any]

    @property
    def seconds(self) -> NDArray[np.float64]:
        """(n,) s on the device's clock, counted: sample number over nominal rate."""
        return self.numbers / self.stream.rate_hz

    def cut(self, part: slice) -> Counted:
        return replace(
            self,
            numbers=self.numbers[part],
            device_time=self.device_time[part],
            host_time=self.host_time[part],
            values=self.values[part],
        )


def _counted(tracks: Mapping[str, Track], name: str) -> Counted:
    if name not in tracks or not len(tracks[name].sample_numbers):
        raise UnusableTrial(
            f"the recording holds no samples of {name}; see with `station check` whether its device answers"
        )
    track = tracks[name]
    numbers = track.sample_numbers.astype(np.int64)
    steps = np.diff(numbers)
    if name != "/markers" and np.any(steps <= 0):  # QTM numbers its frames anew where a capture begins
        raise UnusableTrial(
            f"the sample numbers of {name} go back or repeat at sample {int(numbers[np.argmax(steps <= 0)])}, expected "
            "increasing numbers; record the trial again"
        )
    device_time, host_time = (1e-9 * ns.astype(np.float64) for ns in (track.device_time_ns, track.host_time_ns))
    return Counted(track.stream, numbers, device_time, host_time, track.values)


@dataclass(frozen=True)
class OneTime:
    """Force and markers on session time, before what is known of the lag between them.

    force_time (n,) s; frames without live preview, the first at first_frame [s]
    edge_sd, drift  standard uncertainty of that lag, of this trial [s] and of all trials [s/s]
    sync_fall       s, when the sync line fell again; None where that was not recorded
    sync_findings   irregularities of the sync line; empty for a trial without one
    stop_contradiction  s by which the line's fall contradicts the number of frames; already in edge_sd
    """

    force_time: NDArray[np.float64]
    frames: Counted
    first_frame: float
    clock: ClockFit
    edge_sd: float = 0.0
    drift: float = 0.0
    sync_fall: float | None = None
    notes: tuple[str, ...] = ()
    sync_findings: tuple[str, ...] = ()
    stop_contradiction: float = 0.0


def _as_declared(manifest: Manifest, force: Counted, frames: Counted) -> OneTime:
    """Both device clocks read origin_s at session time 0; from there two of them drift apart."""
    clock = ClockFit(manifest.origin_s, 1.0, np.zeros((2, 2)), has_both_edges=False)
    first_frame = float(frames.device_time[0]) - manifest.origin_s
    drift = 0.0 if manifest.start == "one_clock" else clocks.DRIFT_PRIOR_SD
    return OneTime(clock.session_time(force.device_time), frames, first_frame, clock, drift=drift)


def tie_by_edge(manifest: Manifest, tracks: Mapping[str, Track]) -> OneTime:
    """The sync edge is the origin; frame 1 is exposed at it. Tracks may be decimated. Raises UnusableTrial."""
    force, frames = _counted(tracks, "/force"), _counted(tracks, "/markers")
    edges, edge_clock = _edges(manifest, tracks)
    frames = _captured(frames, edge_clock, edges)
    frame = 1 / frames.stream.rate_hz
    capture, window = float(frames.numbers[-1]) * frame, stop_window(manifest.timing, frame)
    clock = fit_clock(edges, capture, window)
    late = _late_by_arrival(frames, edge_clock, edges)
    first_frame, frames_sd, late_start = _first_frame_time(frames, late)
    middle = (first_frame + (frames.numbers[-1] - frames.numbers[0]) * frame) / 2
    force_time, edge_sd, drift = _force_time(manifest, force, edge_clock, clock, float(middle))
    early = 0.0 if late_start else clocks.early_edge(edges, capture, frame, late)
    contradiction = early or clocks.stop_contradiction(edges, capture, window)
    stop = early_notes(early) or stop_notes(edges.falling, clock, contradiction)
    findings = edges.findings + late_start + stop
    return OneTime(
        force_time,
        frames,
        first_frame,
        clock,
        float(np.linalg.norm((edge_sd, frames_sd, contradiction))),
        drift,
        None if edges.falling is None else (edges.falling - clock.start) / clock.ratio,
        findings,
        findings,
        contradiction,
    )


def _edges(manifest: Manifest, tracks: Mapping[str, Track]) -> tuple[SyncEdges, Counted]:
    """The sync edges, and the track on whose clock they are."""
    if manifest.start == "pfi0":  # the hardware starts sample 0 at the edge
        if "/sync" not in tracks:
            return SyncEdges(0.0, 0.0, None), _counted(tracks, "/force")
        sync = _counted(tracks, "/sync")
        return sync_line.find_fall(sync.seconds, sync.values[:, 0], manifest.sync_threshold_v), sync
    sync = _counted(tracks, "/sync")
    return sync_line.find_edges(sync.seconds, sync.values[:, 0], manifest.sync_threshold_v), sync


def _edge_on_host(edge_clock: Counted, edge: float) -> float:
    """When the edge at `edge` [s] of the DAQ's clock was, on the host's clock [s]."""
    return edge + clocks.arrival_offset(edge_clock.host_time, edge_clock.seconds)


def _captured(frames: Counted, edge_clock: Counted, edges: SyncEdges) -> Counted:
    """The frames without live preview."""
    edge_host, rate = _edge_on_host(edge_clock, edges.rising), frames.stream.rate_hz
    return frames.cut(clocks.capture_frames(frames.numbers, frames.device_time, frames.host_time, rate, edge_host))


def _force_time(
    manifest: Manifest, force: Counted, edge_clock: Counted, clock: ClockFit, middle: float
) -> tuple[NDArray[np.float64], float, float]:
    """Session time (n,) [s] of the force samples; its standard uncertainty in this trial [s] and in all trials [s/s].

    Two edges measure the clock ratio. Its uncertainty is this trial's own, taken at the middle of the trial [s], except
    for the position of the stop edge in the last frame, which may be the same in all trials.
    """
    if manifest.load_cell.source != "daq":
        offset = clocks.arrival_offset(force.host_time, force.device_time)
        time = force.device_time + offset - _edge_on_host(edge_clock, clock.start)
        return time, clocks.HOST_ALIGNMENT_SD, clocks.DRIFT_PRIOR_SD
    time = clock.session_time(force.seconds)
    if clock.has_both_edges:
        own = max(0.0, clock.time_sd(middle) ** 2 - (clock.common_drift * middle) ** 2)
        return time, math.sqrt(own), clock.common_drift
    return time, clock.time_sd(0.0), clocks.DRIFT_PRIOR_SD


def _declared_lag(manifest: Manifest, edge_sd: float, drift: float) -> LagUncertainty:
    return LagUncertainty(edge_sd, manifest.timing.lag_sd_s, drift, value=manifest.timing.lag_s)


def _late_by_arrival(frames: Counted, edge_clock: Counted, edges: SyncEdges) -> float:
    """Seconds from the edge to frame 1, as the host saw them arrive."""
    frame_one_host = clocks.arrival_offset(frames.host_time, (frames.numbers - 1) / frames.stream.rate_hz)
    return frame_one_host - _edge_on_host(edge_clock, edges.rising)


def _first_frame_time(frames: Counted, late: float) -> tuple[float, float, tuple[str, ...]]:
    """Session time [s] of the first recorded frame of the capture, its uncertainty [s], and a note.

    Frame 1 is exposed at the edge. If what the host saw contradicts that by far (late [s]), the numbers did not start
    with the capture, and arrival times are the better guess: good enough for plateaus, not for damping.
    """
    counted = float(frames.numbers[0] - 1) / frames.stream.rate_hz
    if abs(late) <= clocks.HOST_TOLERANCE:
        return counted, 0.0, ()
    note = (
        f"frame numbers put the capture's start {late:+.2f} s from the sync edge by the host's clock; markers are "
        f"aligned by arrival time (± {1e3 * clocks.HOST_ALIGNMENT_SD:.0f} ms), too coarse for damping of a stiff cuff"
    )
    return counted + late, clocks.HOST_ALIGNMENT_SD, (note,)


def _regular(frames: Counted, labels: tuple[str, ...]) -> NDArray[np.float64]:
    """Marker positions (frames, markers, 3) [mm] on the grid of frame numbers, NaN where none came."""
    index = frames.numbers - frames.numbers[0]
    columns = [frames.stream.labels.index(label) for label in labels]
    grid = np.full((int(index[-1]) + 1, len(labels), 3), np.nan)
    grid[index] = frames.values[:, columns, :3]
    return grid


def _overlap(
    force_time: NDArray[np.float64], marker_time: NDArray[np.float64]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which samples lie in the time from the edge to the end of the shorter stream."""
    start, end = max(0.0, force_time[0], marker_time[0]), min(force_time[-1], marker_time[-1])
    in_force = (force_time >= 0) & (force_time <= end)
    in_frames = (marker_time >= -1e-9) & (marker_time <= end)
    samples, frames = np.count_nonzero(in_force), np.count_nonzero(in_frames)
    if end - start < SHORTEST or min(samples, frames) < 2:
        raise UnusableTrial(
            f"force ends {force_time[-1]:.2f} s and markers end {marker_time[-1]:.2f} s after the sync edge, with "
            f"{samples} samples and {frames} frames in {max(0.0, end - start):.2f} s of both, expected at least "
            f"{SHORTEST:g} s; record the trial again"
        )
    return in_force, in_frames


def _gaps(numbers: NDArray[np.int64], time: NDArray[np.float64], end: float) -> tuple[tuple[float, float], ...]:
    """(start, end) s of every jump of the numbers between the edge and the trial's end."""
    jumps = np.flatnonzero(np.diff(numbers) > 1)
    return tuple((float(time[i]), float(time[i + 1])) for i in jumps if time[i + 1] > 0 and time[i] < end)


def _full_scale(manifest: Manifest, stream: Stream) -> float:
    range_v = manifest.load_cell.range_v if stream.unit == "V" else math.inf
    return calibration.full_scale(manifest.load_cell, range_v)
