"""Align the streams of one recording: force in newtons and markers in metres over session time."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fitting.errors import UnusableTrial
from fitting.results.codes import RejectionCode, TrialNoteCode
from fitting.results.rendering import Figures, Note
from fitting.trial.calibration import code_width, full_scale, to_newtons
from fitting.trial.clock_fit import (
    ClockFit,
    early_edge,
    early_notes,
    fit_clock,
    stop_contradiction,
    stop_notes,
    stop_window,
)
from fitting.trial.clocks import (
    DRIFT_PRIOR_SD,
    HOST_ALIGNMENT_SD,
    HOST_TOLERANCE,
    LagUncertainty,
    SyncEdges,
    arrival_offset,
    capture_frames,
)
from fitting.trial.force_quality import loss_notes, require_labels, require_sound_force
from fitting.trial.sync_line import find_edges, find_fall
from recordings.manifest import Manifest
from recordings.reader import Track
from recordings.samples import Stream

MILLIMETRE = 1e-3
SHORTEST = 1.0
"""Least duration [s] of force and markers together."""


@dataclass(frozen=True)
class Timeline:
    """Both streams from the edge to the end of the shorter one. Session time 0 is the rising edge of /sync.

    force_time, force    (n,) s, N: without lost samples; zero not removed
    force_step           N per converter code, 0 if unknown
    marker_time          (frames,) s, a regular grid
    markers              (frames, labels, 3) m in the mocap frame; NaN for a hidden marker and for a lost frame
    clock, lag           the DAQ's clock relative to the mocap system's, and lag of force with its uncertainty
    sync_fall            s, falling edge of the sync line; None if it was not recorded
    force_gaps, frame_gaps  (start, end) s of lost samples
    notes                remarks on the alignment
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
    notes: tuple[Note, ...]


def build_timeline(manifest: Manifest, tracks: Mapping[str, Track], labels: tuple[str, ...]) -> Timeline:
    """Align "/force", "/sync" and the markers with these labels. Raises UnusableTrial."""
    force, frames = _numbered_track(tracks, "/force"), _numbered_track(tracks, "/markers")
    require_labels(labels, frames.stream.labels)
    raw = force.values[:, 0].astype(np.float64)
    if manifest.body is None or manifest.body.is_cord_measured:  # otherwise the load cell is not in use
        require_sound_force(raw, _full_scale(manifest, force.stream), force.stream.unit)
    aligned = (
        align_by_sync_edge(manifest, tracks) if manifest.begins_at_edge else _align_as_declared(manifest, force, frames)
    )
    frames, first_frame, notes = aligned.frames, aligned.first_frame, aligned.notes
    grid = _on_frame_grid(frames, labels)
    marker_time = first_frame + np.arange(len(grid)) / frames.stream.rate_hz
    lag = _declared_lag(manifest, aligned.edge_sd, aligned.drift)
    force_time = aligned.force_time + lag.value
    in_force, in_frames = _overlap(force_time, marker_time)
    newtons = to_newtons(raw, manifest.load_cell)
    end = min(force_time[-1], marker_time[-1])
    force_gaps = _gaps(force.numbers, force_time, end)
    frame_gaps = _gaps(frames.numbers, first_frame + frames.seconds - frames.seconds[0], end)
    return Timeline(
        force_time=force_time[in_force],
        force=newtons[in_force],
        force_step=code_width(newtons),
        marker_time=marker_time[in_frames],
        markers=MILLIMETRE * grid[in_frames],
        clock=aligned.clock,
        lag=lag,
        sync_fall=aligned.sync_fall,
        force_gaps=force_gaps,
        frame_gaps=frame_gaps,
        notes=notes + loss_notes(force_gaps, frame_gaps),
    )


@dataclass(frozen=True)
class NumberedTrack:
    """A track with sample numbers (n,) as signed integers, and device and host times (n,) in seconds."""

    stream: Stream
    numbers: NDArray[np.int64]
    device_time: NDArray[np.float64]
    host_time: NDArray[np.float64]
    values: NDArray[Any]

    @property
    def seconds(self) -> NDArray[np.float64]:
        """Nominal time (n,) [s] on the device's clock: sample number over rate."""
        return self.numbers / self.stream.rate_hz

    def cut(self, part: slice) -> NumberedTrack:
        return replace(
            self,
            numbers=self.numbers[part],
            device_time=self.device_time[part],
            host_time=self.host_time[part],
            values=self.values[part],
        )


def _numbered_track(tracks: Mapping[str, Track], name: str) -> NumberedTrack:
    if name not in tracks or not len(tracks[name].sample_numbers):
        raise UnusableTrial(RejectionCode.NO_SAMPLES, {"stream": name})
    track = tracks[name]
    numbers = track.sample_numbers.astype(np.int64)
    steps = np.diff(numbers)
    if name != "/markers" and np.any(steps <= 0):  # QTM restarts its frame numbers when a capture begins
        figures: Figures = {"stream": name, "sample": int(numbers[np.argmax(steps <= 0)])}
        raise UnusableTrial(RejectionCode.NUMBERS_GO_BACK, figures)
    device_time, host_time = (1e-9 * ns.astype(np.float64) for ns in (track.device_time_ns, track.host_time_ns))
    return NumberedTrack(track.stream, numbers, device_time, host_time, track.values)


@dataclass(frozen=True)
class AlignedStreams:
    """Force and markers on session time, before the correction of the declared lag.

    force_time (n,) s; frames without live preview, the first at first_frame [s]
    edge_sd, drift  standard uncertainty of the alignment, of this trial [s] and common to all trials [s/s]
    sync_fall       s, falling edge of the sync line; None if it was not recorded
    sync_findings   irregularities of the sync line; empty without a sync line
    stop_contradiction  s by which the falling edge contradicts the number of frames; included in edge_sd
    """

    force_time: NDArray[np.float64]
    frames: NumberedTrack
    first_frame: float
    clock: ClockFit
    drift: float
    edge_sd: float = 0.0
    sync_fall: float | None = None
    notes: tuple[Note, ...] = ()
    sync_findings: tuple[Note, ...] = ()
    stop_contradiction: float = 0.0


def _align_as_declared(manifest: Manifest, force: NumberedTrack, frames: NumberedTrack) -> AlignedStreams:
    """Both device clocks show origin_s at session time 0; two separate clocks then drift apart."""
    clock = ClockFit(manifest.origin_s, 1.0, np.zeros((2, 2)), has_both_edges=False)
    first_frame = float(frames.device_time[0]) - manifest.origin_s
    drift = 0.0 if manifest.start == "one_clock" else DRIFT_PRIOR_SD
    return AlignedStreams(clock.session_time(force.device_time), frames, first_frame, clock, drift)


def align_by_sync_edge(manifest: Manifest, tracks: Mapping[str, Track]) -> AlignedStreams:
    """Align by the sync edge, at which frame 1 is exposed. Tracks may be decimated. Raises UnusableTrial."""
    force, frames = _numbered_track(tracks, "/force"), _numbered_track(tracks, "/markers")
    edges, edge_clock = _edges(manifest, tracks)
    frames = _without_preview(frames, edge_clock, edges)
    frame = 1 / frames.stream.rate_hz
    capture, window = float(frames.numbers[-1]) * frame, stop_window(manifest.timing, frame)
    clock = fit_clock(edges, capture, window)
    late = _arrival_delay(frames, edge_clock, edges)
    first_frame, frames_sd, late_start = _first_frame_time(frames, late)
    middle = (first_frame + (frames.numbers[-1] - frames.numbers[0]) * frame) / 2
    force_time, edge_sd, drift = _force_time(manifest, force, edge_clock, clock, float(middle))
    early = 0.0 if late_start else early_edge(edges, capture, frame, late)
    contradiction = early or stop_contradiction(edges, capture, window)
    stop = early_notes(early) or stop_notes(edges.falling, clock, contradiction)
    findings = edges.findings + late_start + stop
    return AlignedStreams(
        force_time,
        frames,
        first_frame,
        clock,
        drift,
        float(np.linalg.norm((edge_sd, frames_sd, contradiction))),
        None if edges.falling is None else (edges.falling - clock.start) / clock.ratio,
        findings,
        findings,
        contradiction,
    )


def _edges(manifest: Manifest, tracks: Mapping[str, Track]) -> tuple[SyncEdges, NumberedTrack]:
    """The sync edges, and the track that defines their clock."""
    if manifest.start == "pfi0":  # the hardware starts sample 0 at the edge
        if "/sync" not in tracks:
            return SyncEdges(0.0, 0.0, None), _numbered_track(tracks, "/force")
        sync = _numbered_track(tracks, "/sync")
        return find_fall(sync.seconds, sync.values[:, 0], manifest.sync_threshold_v), sync
    sync = _numbered_track(tracks, "/sync")
    return find_edges(sync.seconds, sync.values[:, 0], manifest.sync_threshold_v), sync


def _edge_on_host(edge_clock: NumberedTrack, edge: float) -> float:
    """Time `edge` [s] of the DAQ's clock on the host's clock [s]."""
    return edge + arrival_offset(edge_clock.host_time, edge_clock.seconds)


def _without_preview(frames: NumberedTrack, edge_clock: NumberedTrack, edges: SyncEdges) -> NumberedTrack:
    """The frames without live preview."""
    edge_host, rate = _edge_on_host(edge_clock, edges.rising), frames.stream.rate_hz
    return frames.cut(capture_frames(frames.numbers, frames.device_time, frames.host_time, rate, edge_host))


def _force_time(
    manifest: Manifest, force: NumberedTrack, edge_clock: NumberedTrack, clock: ClockFit, middle: float
) -> tuple[NDArray[np.float64], float, float]:
    """Session time (n,) [s] of the force samples; its standard uncertainty in this trial [s] and in all trials [s/s].

    Two edges determine the clock ratio. Its uncertainty, at the middle of the trial [s], is independent in every trial,
    except for the position of the stop edge in the last frame, which may be common to all trials.
    """
    if manifest.load_cell.source != "daq":
        offset = arrival_offset(force.host_time, force.device_time)
        time = force.device_time + offset - _edge_on_host(edge_clock, clock.start)
        return time, HOST_ALIGNMENT_SD, DRIFT_PRIOR_SD
    time = clock.session_time(force.seconds)
    if clock.has_both_edges:
        own = max(0.0, clock.time_sd(middle) ** 2 - (clock.common_drift * middle) ** 2)
        return time, math.sqrt(own), clock.common_drift
    return time, clock.time_sd(0.0), DRIFT_PRIOR_SD


def _declared_lag(manifest: Manifest, edge_sd: float, drift: float) -> LagUncertainty:
    return LagUncertainty(edge_sd, manifest.timing.lag_sd_s, drift, value=manifest.timing.lag_s)


def _arrival_delay(frames: NumberedTrack, edge_clock: NumberedTrack, edges: SyncEdges) -> float:
    """Seconds from the edge to frame 1 by arrival at the host."""
    frame_one_host = arrival_offset(frames.host_time, (frames.numbers - 1) / frames.stream.rate_hz)
    return frame_one_host - _edge_on_host(edge_clock, edges.rising)


def _first_frame_time(frames: NumberedTrack, late: float) -> tuple[float, float, tuple[Note, ...]]:
    """Session time [s] of the first recorded frame of the capture, its uncertainty [s], and a note.

    Frame 1 is exposed at the edge. If the arrival at the host contradicts this (late [s] above HOST_TOLERANCE), the
    numbers did not start with the capture, and arrival times are used: precise enough for plateaus, not for damping.
    """
    counted = float(frames.numbers[0] - 1) / frames.stream.rate_hz
    if abs(late) <= HOST_TOLERANCE:
        return counted, 0.0, ()
    note = Note(TrialNoteCode.SYNC_ARRIVAL, {"late_s": late, "standard_error_s": HOST_ALIGNMENT_SD})
    return counted + late, HOST_ALIGNMENT_SD, (note,)


def _on_frame_grid(frames: NumberedTrack, labels: tuple[str, ...]) -> NDArray[np.float64]:
    """Marker positions (frames, markers, 3) [mm] on the grid of frame numbers, NaN for lost frames."""
    index = frames.numbers - frames.numbers[0]
    columns = [frames.stream.labels.index(label) for label in labels]
    grid = np.full((int(index[-1]) + 1, len(labels), 3), np.nan)
    grid[index] = frames.values[:, columns, :3]
    return grid


def _overlap(
    force_time: NDArray[np.float64], marker_time: NDArray[np.float64]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Masks of force samples and frames between the edge and the end of the shorter stream."""
    start, end = max(0.0, force_time[0], marker_time[0]), min(force_time[-1], marker_time[-1])
    in_force = (force_time >= 0) & (force_time <= end)
    in_frames = (marker_time >= -1e-9) & (marker_time <= end)
    samples, frames = np.count_nonzero(in_force), np.count_nonzero(in_frames)
    if end - start < SHORTEST or min(samples, frames) < 2:
        figures = {
            "force_end_s": float(force_time[-1]),
            "marker_end_s": float(marker_time[-1]),
            "samples": int(samples),
            "frames": int(frames),
            "both_s": max(0.0, float(end - start)),
            "expected_s": SHORTEST,
        }
        raise UnusableTrial(RejectionCode.NO_OVERLAP, figures)
    return in_force, in_frames


def _gaps(numbers: NDArray[np.int64], time: NDArray[np.float64], end: float) -> tuple[tuple[float, float], ...]:
    """(start, end) s of every gap in the numbers between the edge and the trial's end."""
    jumps = np.flatnonzero(np.diff(numbers) > 1)
    return tuple((float(time[i]), float(time[i + 1])) for i in jumps if time[i + 1] > 0 and time[i] < end)


def _full_scale(manifest: Manifest, stream: Stream) -> float:
    range_v = manifest.load_cell.range_v if stream.unit == "V" else math.inf
    return full_scale(manifest.load_cell, range_v)
