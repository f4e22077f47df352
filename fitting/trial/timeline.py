"""Align the streams of one recording: force in newtons and markers in metres over session time.

With the quality of the force (invalid and lost samples, drift of the zero) and the uncertainty of the common time:
offset and ratio of the clocks, and the resulting errors in N and m."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from documents.message import Figures
from fitting.errors import UnusableTrial
from fitting.results.sentences import Note
from fitting.results.trial_codes import RejectionCode, TrialNoteCode
from fitting.trial.calibration import code_width, find_spikes, full_scale, require_sound_force, spike_notes, to_newtons
from fitting.trial.clocks import (
    DRIFT_PRIOR_SD,
    HOST_ALIGNMENT_SD,
    HOST_TOLERANCE,
    ClockFit,
    LagUncertainty,
    SyncEdges,
    SyncErrors,
    arrival_offset,
    capture_frames,
    early_edge,
    early_notes,
    find_edges,
    find_fall,
    fit_clock,
    stop_contradiction,
    stop_notes,
    stop_window,
)
from fitting.trial.decimation import highest_rate, marker_motion
from recordings.manifest import Manifest
from recordings.reader import Track
from recordings.samples import Stream

REST = 1.0
"""Seconds at both ends of a trial in which the force may be at rest."""
ZERO_DRIFT, ZERO_DRIFT_PART = 0.5, 0.02
"""Drift of the zero without a note: the larger of newtons and part of the trial's range."""


def damage_figures(damage: tuple[str, ...]) -> Figures:
    """Figures of the codes DAMAGED. Damage is the only note on a damaged file, or the only reason to reject it."""
    more: Figures = {"more": len(damage) - 1} if len(damage) > 1 else {}
    return {"damage": damage[0], **more}


def require_labels(wanted: tuple[str, ...], present: tuple[str, ...]) -> None:
    """Raise UnusableTrial with the names of the wanted markers that the recording lacks."""
    missing = [label for label in wanted if label not in present]
    if missing:
        figures = {"missing": ", ".join(missing), "present": ", ".join(present) or "none"}
        raise UnusableTrial(RejectionCode.MISSING_MARKERS, figures)


def loss_notes(
    force_gaps: tuple[tuple[float, float], ...], frame_gaps: tuple[tuple[float, float], ...]
) -> tuple[Note, ...]:
    """A note for each stream that lost samples: gaps are (start, end) [s]."""
    notes = []
    for code, gaps in ((TrialNoteCode.FORCE_LOST, force_gaps), (TrialNoteCode.FRAMES_LOST, frame_gaps)):
        if gaps:
            lost = [end - start for start, end in gaps]
            notes.append(Note(code, {"count": len(gaps), "total_s": sum(lost), "longest_s": max(lost)}))
    return tuple(notes)


def zero_drift(time: NDArray[np.float64], force: NDArray[np.float64]) -> float | None:
    """Force (n,) [N] at rest at the end of a trial minus that at its start; None without unloaded rest at both.

    The force is at rest if the halves of a second differ by less than 2 % of its range, in the lowest quarter of it.
    """
    ends = [force[time < time[0] + REST], force[time > time[-1] - REST]]
    halves = [[float(np.mean(half)) for half in np.array_split(end, 2)] for end in ends if len(end) >= 2]
    low, high = float(force.min()), float(force.max())
    is_rest = [max(pair) < low + (high - low) / 4 and abs(pair[1] - pair[0]) < (high - low) / 50 for pair in halves]
    if len(is_rest) < 2 or not all(is_rest):
        return None
    return sum(halves[1]) / 2 - sum(halves[0]) / 2


def require_steady_zero(drift: float | None, limit: float) -> None:
    """Raise UnusableTrial if the drift of the zero [N] exceeds the limit [N]."""
    if drift is not None and abs(drift) > limit:
        raise UnusableTrial(RejectionCode.ZERO_DRIFT, {"drift_n": drift, "limit_n": limit})


def zero_notes(drift: float | None, span: float) -> tuple[Note, ...]:
    """A note if the drift of the zero [N] is large for a force with this range [N]."""
    limit = max(ZERO_DRIFT, ZERO_DRIFT_PART * span)
    if drift is None or abs(drift) <= limit:
        return ()
    return (Note(TrialNoteCode.ZERO_DRIFT, {"drift_n": drift, "limit_n": limit}),)


MILLIMETRE = 1e-3
SHORTEST = 1.0
"""Least duration [s] of force and markers together."""


@dataclass(frozen=True)
class Timeline:
    """Both streams from the edge to the end of the shorter one. Session time 0 is the rising edge of /sync.

    force_time, force    (n,) s, N: without lost samples and spikes; zero not removed
    force_step           N per converter code, 0 if unknown
    marker_time          (frames,) s, a regular grid
    markers              (frames, labels, 3) m in the mocap frame; NaN for a hidden marker and for a lost frame
    clock, lag           the DAQ's clock relative to the mocap system's, and lag of force with its uncertainty
    sync_fall            s, falling edge of the sync line; None if it was not recorded
    capture_end          s, the same, or else the end of the longer stream; None for imports
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
    capture_end: float | None
    force_gaps: tuple[tuple[float, float], ...]
    frame_gaps: tuple[tuple[float, float], ...]
    notes: tuple[Note, ...]


def build_timeline(manifest: Manifest, tracks: Mapping[str, Track], labels: tuple[str, ...]) -> Timeline:
    """Align "/force", if it is used, "/sync" and the markers with these labels. Raises UnusableTrial."""
    force, frames = _force_track(manifest, tracks), _numbered_track(tracks, "/markers")
    require_labels(labels, frames.stream.labels)
    raw = np.empty(0) if force is None else force.values[:, 0].astype(np.float64)
    newtons = to_newtons(raw, manifest.load_cell)
    spikes = np.zeros(len(raw))
    if force is not None and manifest.is_force_used:
        require_sound_force(raw, _full_scale(manifest, force.stream), force.stream.unit)
        spikes = find_spikes(newtons, force.stream.rate_hz)
    aligned = (
        align_by_sync_edge(manifest, tracks) if manifest.begins_at_edge else _align_as_declared(manifest, force, frames)
    )
    frames, first_frame, notes = aligned.frames, aligned.first_frame, aligned.notes
    grid = _on_frame_grid(frames, labels)
    marker_time = first_frame + np.arange(len(grid)) / frames.stream.rate_hz
    lag = _declared_lag(manifest, aligned.edge_sd, aligned.drift)
    force_time = aligned.force_time + lag.value
    in_frames, end = _overlap(force_time if manifest.is_force_used else marker_time, marker_time)
    in_force = (force_time >= 0) & (force_time <= end)
    is_kept = in_force & (spikes == 0)
    force_gaps = _gaps(force.numbers, force_time, end) if force is not None and manifest.is_force_used else ()
    frame_gaps = _gaps(frames.numbers, first_frame + frames.seconds - frames.seconds[0], end)
    return Timeline(
        force_time=force_time[is_kept],
        force=newtons[is_kept],
        force_step=code_width(newtons),
        marker_time=marker_time[in_frames],
        markers=MILLIMETRE * grid[in_frames],
        clock=aligned.clock,
        lag=lag,
        sync_fall=aligned.sync_fall,
        capture_end=_capture_end(manifest, aligned.sync_fall, marker_time, force_time),
        force_gaps=force_gaps,
        frame_gaps=frame_gaps,
        notes=notes + loss_notes(force_gaps, frame_gaps) + spike_notes(spikes[in_force]),
    )


def _capture_end(
    manifest: Manifest, sync_fall: float | None, marker_time: NDArray[np.float64], force_time: NDArray[np.float64]
) -> float | None:
    """End of the mocap capture [s], from streams that start with it; files from elsewhere may be of any length."""
    if sync_fall is not None or not manifest.begins_at_edge:
        return sync_fall
    return float(np.concatenate((marker_time, force_time)).max())


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


def _force_track(manifest: Manifest, tracks: Mapping[str, Track]) -> NumberedTrack | None:
    """None without samples of a force that the trial does not need."""
    track = tracks.get("/force")
    is_empty = track is None or not len(track.sample_numbers)
    return None if is_empty and not manifest.is_force_used else _numbered_track(tracks, "/force")


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


def _align_as_declared(manifest: Manifest, force: NumberedTrack | None, frames: NumberedTrack) -> AlignedStreams:
    """Both device clocks show origin_s at session time 0; two separate clocks then drift apart."""
    clock = ClockFit(manifest.origin_s, 1.0, np.zeros((2, 2)), has_both_edges=False)
    first_frame = float(frames.device_time[0]) - manifest.origin_s
    drift = 0.0 if manifest.start == "one_clock" else DRIFT_PRIOR_SD
    device_time = np.empty(0) if force is None else force.device_time
    return AlignedStreams(clock.session_time(device_time), frames, first_frame, clock, drift)


def align_by_sync_edge(manifest: Manifest, tracks: Mapping[str, Track]) -> AlignedStreams:
    """Align by the sync edge, at which frame 1 is exposed. Tracks may be decimated. Raises UnusableTrial."""
    force, frames = _force_track(manifest, tracks), _numbered_track(tracks, "/markers")
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
    manifest: Manifest, force: NumberedTrack | None, edge_clock: NumberedTrack, clock: ClockFit, middle: float
) -> tuple[NDArray[np.float64], float, float]:
    """Session time (n,) [s] of the force samples; its standard uncertainty in this trial [s] and in all trials [s/s].

    Two edges determine the clock ratio. Its uncertainty, at the middle of the trial [s], is independent in every trial,
    except for the position of the stop edge in the last frame, which may be common to all trials.
    """
    if force is None:
        return np.empty(0), clock.time_sd(0.0), DRIFT_PRIOR_SD
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


def _overlap(force_time: NDArray[np.float64], marker_time: NDArray[np.float64]) -> tuple[NDArray[np.bool_], float]:
    """Mask of the frames between the edge and the end of the shorter stream, and that end [s]."""
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
    return in_frames, float(end)


def _gaps(numbers: NDArray[np.int64], time: NDArray[np.float64], end: float) -> tuple[tuple[float, float], ...]:
    """(start, end) s of every gap in the numbers between the edge and the trial's end."""
    jumps = np.flatnonzero(np.diff(numbers) > 1)
    return tuple((float(time[i]), float(time[i + 1])) for i in jumps if time[i + 1] > 0 and time[i] < end)


def _full_scale(manifest: Manifest, stream: Stream) -> float:
    range_v = manifest.load_cell.range_v if stream.unit == "V" else math.inf
    return full_scale(manifest.load_cell, range_v)


@dataclass(frozen=True)
class SyncCertificate:
    """Uncertainty of the time from the recorded sync line. Standard uncertainties unless stated otherwise.

    offset, offset_sd  [s] of the DAQ's clock when the capture began
    drift, drift_sd    DAQ seconds per mocap second, minus 1; assumed if there is only one edge
    drift_ci95         its 95 % interval; None with only one edge
    is_identified      whether the edges alone determine the drift
    has_both_edges     whether the stop edge was used
    contradiction      [s] by which the stop edge contradicts the number of frames; included in the lag's uncertainty
    force_rate, speed  [N/s], [m/s] highest rates of the trial
    errors             largest error of the time, and errors of force and displacement at these rates
    findings           irregularities of the line
    """

    offset: float
    offset_sd: float
    drift: float
    drift_sd: float
    drift_ci95: tuple[float, float] | None
    is_identified: bool
    has_both_edges: bool
    contradiction: float
    force_rate: float
    speed: float
    errors: SyncErrors
    findings: tuple[Note, ...] = ()

    @property
    def summary(self) -> Note:
        """Offset, clock ratio and their uncertainty; its text is one line."""
        figures = {
            "offset_of_both_edges_s" if self.has_both_edges else "offset_of_start_edge_s": self.offset,
            "offset_sd_s": self.offset_sd,
            "time_sd_s": self.errors.time,
            "force_sd_n": self.errors.force,
            "force_rate_n_per_s": self.force_rate,
            "displacement_sd_m": self.errors.displacement,
            "speed_m_per_s": self.speed,
        }
        if self.drift_ci95 is None:
            figures |= {"assumed_drift": self.drift, "drift_sd": self.drift_sd}
        elif self.is_identified:
            figures |= {"drift": self.drift, "low": self.drift_ci95[0], "high": self.drift_ci95[1]}
        else:
            figures |= {"lowest_drift": self.drift_ci95[0], "highest_drift": self.drift_ci95[1]}
        return Note(TrialNoteCode.SYNC_CERTIFICATE, figures)


def certify(manifest: Manifest, decimated: Mapping[str, Track]) -> SyncCertificate | None:
    """Sync certificate from decimated tracks (decimation.py); None without a sync line. Raises UnusableTrial."""
    if not manifest.begins_at_edge:
        return None
    motion = marker_motion(manifest)
    if "/markers" in decimated:
        require_labels((*motion.anchor, *motion.pulled), decimated["/markers"].stream.labels)
    aligned = align_by_sync_edge(manifest, decimated)
    force, frames = decimated["/force"], aligned.frames
    frame_time = aligned.first_frame + frames.seconds - frames.seconds[0]
    duration = float(min(aligned.force_time[-1], frame_time[-1]))
    worst = max(aligned.clock.largest_time_sd(duration), aligned.edge_sd)  # edge_sd includes a contradiction
    inside, seen = (aligned.force_time >= 0) & (aligned.force_time <= duration), frame_time <= duration
    numbers = force.sample_numbers[inside].astype(np.int64)
    volts_rate = highest_rate(numbers, force.values[inside], force.stream.rate_hz)
    force_rate = manifest.load_cell.newtons_per_unit * volts_rate
    speed = MILLIMETRE * highest_rate(frames.numbers[seen], frames.values[seen], frames.stream.rate_hz)
    return SyncCertificate(
        offset=aligned.clock.start,
        offset_sd=aligned.clock.time_sd(0.0),
        drift=aligned.clock.ratio - 1,
        drift_sd=math.sqrt(float(aligned.clock.covariance[1, 1])),
        drift_ci95=aligned.clock.drift_ci95,
        is_identified=aligned.clock.is_identified,
        has_both_edges=aligned.clock.has_both_edges,
        contradiction=aligned.stop_contradiction,
        force_rate=force_rate,
        speed=speed,
        errors=SyncErrors(worst, worst * force_rate, worst * speed),
        findings=aligned.sync_findings,
    )
