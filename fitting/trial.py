"""A recording becomes a trial: SI units, one clock, cut to the capture, gaps marked."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fitting import calibration, clocks, quality
from fitting.clocks import LagUncertainty, SyncEdges
from fitting.quality import UnusableTrial
from recordings.errors import RecordingError
from recordings.manifest import CuffSite, Manifest, TestKind
from recordings.reader import Recording, Track, open_recording
from recordings.samples import Event, Stream

MILLIMETRE = 1e-3
DEFAULT_CUFF_MASS = 0.2


@dataclass(frozen=True)
class Trial:
    """One test of one cuff. Session time 0 is the rising edge of /sync; arrays are read-only.

    cuff, test, repeat, run, donning, start_utc_ns  as in the recording's manifest
    file, sha256    what it was read from
    force_time      (n,) s, without the samples that were lost
    force           (n,) N, zero not removed
    force_step      N per converter code, 0 if not known
    marker_time     (frames,) s, a regular grid
    labels          of the markers: anchor, cuff, rope
    markers         (frames, markers, 3) m in the mocap frame; a marker not seen, and a frame not received, is NaN
    lag             uncertainty of force time against marker time
    sync_fall       s, when the sync line fell again; None where that was not recorded
    gain_sd         relative standard uncertainty of the load cell's scale
    cuff_mass       kg moving with the cuff between load cell and body
    force_gaps, frame_gaps  (start, end) s of samples that were numbered and not recorded
    is_whole        False if the recording was cut, or lost samples between the edge and the trial's end
    notes           what a reader should know before believing it
    """

    cuff: CuffSite
    test: TestKind
    repeat: int
    run: int
    donning: str
    start_utc_ns: int
    file: str
    sha256: str
    force_time: NDArray[np.float64]
    force: NDArray[np.float64]
    force_step: float
    marker_time: NDArray[np.float64]
    labels: tuple[str, ...]
    markers: NDArray[np.float64]
    lag: LagUncertainty
    sync_fall: float | None = None
    gain_sd: float = 0.0
    cuff_mass: float = DEFAULT_CUFF_MASS
    force_gaps: tuple[tuple[float, float], ...] = ()
    frame_gaps: tuple[tuple[float, float], ...] = ()
    is_whole: bool = True
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for array in (self.force_time, self.force, self.marker_time, self.markers):
            array.setflags(write=False)

    @property
    def end(self) -> float:
        """Session time [s] up to which both force and markers were recorded."""
        return float(min(self.force_time[-1], self.marker_time[-1]))

    def positions(self, labels: Sequence[str]) -> NDArray[np.float64]:
        """(frames, len(labels), 3) m in the mocap frame."""
        return self.markers[:, [self.labels.index(label) for label in labels]]


@dataclass(frozen=True)
class RejectedTrial:
    """A recording that could not be used, and the sentence why.

    capture is its manifest if its capture had begun, so that the cuff may have been loaded.
    """

    file: str
    reason: str
    capture: Manifest | None = None


def read_trial(path: Path) -> Trial:
    """Reads one recording. Raises UnusableTrial, or RecordingError if the file is none of ours."""
    return _read(path, open_recording(path))


def read_trials(paths: Iterable[Path]) -> tuple[tuple[Trial, ...], tuple[RejectedTrial, ...]]:
    """Reads every recording that can be used, and says why the others cannot."""
    trials, rejected = [], []
    for path in paths:
        recording = None
        try:
            recording = open_recording(path)
            trials.append(_read(path, recording))
        except (UnusableTrial, RecordingError) as error:
            rejected.append(RejectedTrial(path.name, str(error), _begun(recording)))
    return tuple(trials), tuple(rejected)


def _read(path: Path, recording: Recording) -> Trial:
    if recording.outcome is not None and not recording.outcome.accepted:
        raise UnusableTrial(f"the trial was not accepted when it was recorded: {recording.outcome.sentence}")
    tracks = {stream.name: recording.load(stream.name) for stream in recording.streams}
    trial = build_trial(recording.manifest, tracks, path.name, hashlib.sha256(path.read_bytes()).hexdigest())
    is_whole = trial.is_whole and recording.complete
    return replace(trial, is_whole=is_whole, notes=trial.notes + recording.missing)


def _begun(recording: Recording | None) -> Manifest | None:
    """The manifest, unless the station was still waiting for the edge when the recording ended."""
    if recording is None:
        return None
    has_edge = any(isinstance(item, Event) and item.kind == "sync_edge" for item in recording.items())
    return recording.manifest if has_edge or recording.outcome is None else None


def build_trial(manifest: Manifest, tracks: Mapping[str, Track], file: str, sha256: str) -> Trial:
    """The streams "/force", "/sync" and "/markers" of a recording → Trial. Raises UnusableTrial in one sentence."""
    site = manifest.cuff
    labels = site.anchor_markers + site.cuff_markers + site.rope_markers
    force, frames = _counted(tracks, "/force"), _counted(tracks, "/markers")
    quality.require_labels(labels, frames.stream.labels)
    raw = force.values[:, 0].astype(np.float64)
    quality.require_sound_force(raw, _full_scale(manifest, force.stream))
    edges, edge_clock = _edges(manifest, tracks)
    frames = _captured(frames, edge_clock, edges)
    ratio, drift = clocks.clock_ratio(edges, int(frames.numbers[-1]), frames.stream.rate_hz)
    force_time, force_sd = _force_time(manifest, force, edge_clock, edges, ratio)
    first_frame, frames_sd, notes = _first_frame_time(frames, edge_clock, edges)

    grid = _regular(frames, labels)
    marker_time = first_frame + np.arange(len(grid)) / frames.stream.rate_hz
    in_force, in_frames = _overlap(force_time, marker_time)
    newtons = calibration.to_newtons(raw, manifest.load_cell)
    end = min(force_time[-1], marker_time[-1])
    force_gaps = _gaps(force.numbers, force_time, end)
    frame_gaps = _gaps(frames.numbers, first_frame + frames.seconds - frames.seconds[0], end)
    return Trial(
        cuff=site,
        test=manifest.test,
        repeat=manifest.repeat,
        run=manifest.run,
        donning=manifest.donning,
        start_utc_ns=manifest.start_utc_ns,
        file=file,
        sha256=sha256,
        force_time=force_time[in_force],
        force=newtons[in_force],
        force_step=calibration.code_width(newtons),
        marker_time=marker_time[in_frames],
        labels=labels,
        markers=MILLIMETRE * grid[in_frames],
        lag=LagUncertainty(float(np.hypot(force_sd, frames_sd)), clocks.DECLARED_LAG_SD, drift),
        sync_fall=None if edges.falling is None else (edges.falling - edges.rising) / ratio,
        gain_sd=float(_setting(manifest, "load_cell").get("gain_relative_sd", 0.0)),
        cuff_mass=float(_setting(manifest, "cuffs", site.name).get("mass_kg", DEFAULT_CUFF_MASS)),
        force_gaps=force_gaps,
        frame_gaps=frame_gaps,
        is_whole=not force_gaps and not frame_gaps,
        notes=notes + quality.loss_notes(force_gaps, frame_gaps),
    )


@dataclass(frozen=True)
class _Counted:
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

    def cut(self, part: slice) -> _Counted:
        return replace(
            self,
            numbers=self.numbers[part],
            device_time=self.device_time[part],
            host_time=self.host_time[part],
            values=self.values[part],
        )


def _counted(tracks: Mapping[str, Track], name: str) -> _Counted:
    if name not in tracks or not len(tracks[name].sample_numbers):
        raise UnusableTrial(
            f"the recording holds no samples of {name}; see with `station check` whether its device answers"
        )
    track = tracks[name]
    numbers = track.sample_numbers.astype(np.int64)
    device_time, host_time = (1e-9 * ns.astype(np.float64) for ns in (track.device_time_ns, track.host_time_ns))
    return _Counted(track.stream, numbers, device_time, host_time, track.values)


def _edges(manifest: Manifest, tracks: Mapping[str, Track]) -> tuple[SyncEdges, _Counted]:
    """The sync edges, and the track on whose clock they are."""
    if manifest.start == "pfi0":  # the hardware starts sample 0 at the edge
        return SyncEdges(0.0, 0.0, None), _counted(tracks, "/force")
    sync = _counted(tracks, "/sync")
    return clocks.find_edges(sync.seconds, sync.values[:, 0], manifest.sync_threshold_v), sync


def _edge_on_host(edge_clock: _Counted, edges: SyncEdges) -> float:
    """When the edge was, on the host's clock [s]."""
    return edges.rising + clocks.arrival_offset(edge_clock.host_time, edge_clock.seconds)


def _captured(frames: _Counted, edge_clock: _Counted, edges: SyncEdges) -> _Counted:
    """The frames without live preview."""
    edge_host, rate = _edge_on_host(edge_clock, edges), frames.stream.rate_hz
    return frames.cut(clocks.capture_frames(frames.numbers, frames.device_time, frames.host_time, rate, edge_host))


def _force_time(
    manifest: Manifest, force: _Counted, edge_clock: _Counted, edges: SyncEdges, ratio: float
) -> tuple[NDArray[np.float64], float]:
    """Session time (n,) [s] of the force samples, and what is not known of the edge's place among them [s]."""
    if manifest.load_cell.source == "daq":
        return (force.seconds - edges.rising) / ratio, edges.rising_sd
    edge_host = _edge_on_host(edge_clock, edges)
    offset = clocks.arrival_offset(force.host_time, force.device_time)
    return force.device_time + offset - edge_host, clocks.HOST_ALIGNMENT_SD


def _first_frame_time(frames: _Counted, edge_clock: _Counted, edges: SyncEdges) -> tuple[float, float, tuple[str, ...]]:
    """Session time [s] of the first recorded frame of the capture, its uncertainty [s], and a note.

    Frame 1 is exposed at the edge. If what the host saw contradicts that by far, the numbers did not start with the
    capture, and arrival times are the better guess: good enough for plateaus, not for damping.
    """
    counted = float(frames.numbers[0] - 1) / frames.stream.rate_hz
    edge_host = _edge_on_host(edge_clock, edges)
    frame_one_host = clocks.arrival_offset(frames.host_time, (frames.numbers - 1) / frames.stream.rate_hz)
    late = frame_one_host - edge_host
    if abs(late) <= clocks.HOST_TOLERANCE:
        return counted, 0.0, ()
    note = (
        f"frame numbers put the capture's start {late:+.2f} s from the sync edge by the host's clock; markers are "
        f"aligned by arrival time (± {1e3 * clocks.HOST_ALIGNMENT_SD:.0f} ms), too coarse for damping of a stiff cuff"
    )
    return counted + late, clocks.HOST_ALIGNMENT_SD, (note,)


def _regular(frames: _Counted, labels: tuple[str, ...]) -> NDArray[np.float64]:
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
    end = min(force_time[-1], marker_time[-1])
    in_force = (force_time >= 0) & (force_time <= end)
    in_frames = (marker_time >= -1e-9) & (marker_time <= end)
    if np.count_nonzero(in_force) < 2 or np.count_nonzero(in_frames) < 2:
        raise UnusableTrial(
            f"force ends {force_time[-1]:.2f} s and markers end {marker_time[-1]:.2f} s after the sync edge, so "
            "nothing was recorded of both; record the trial again"
        )
    return in_force, in_frames


def _gaps(numbers: NDArray[np.int64], time: NDArray[np.float64], end: float) -> tuple[tuple[float, float], ...]:
    """(start, end) s of every jump of the numbers between the edge and the trial's end."""
    jumps = np.flatnonzero(np.diff(numbers) > 1)
    return tuple((float(time[i]), float(time[i + 1])) for i in jumps if time[i + 1] > 0 and time[i] < end)


def _full_scale(manifest: Manifest, stream: Stream) -> float:
    return float(_setting(manifest, "daq").get("force_range_v", 10.0)) if stream.unit == "V" else float("inf")


def _setting(manifest: Manifest, *keys: str) -> dict[str, Any]:
    section: Any = manifest.effective_config
    for key in keys:
        section = section.get(key, {}) if isinstance(section, dict) else {}
    return section if isinstance(section, dict) else {}
