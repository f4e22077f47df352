"""Read recordings as trials: SI units, one clock, cut to the capture, gaps marked; an unusable one with the reason.

protocol.toml in a session's folder has the operator's corrections of the detected steps:

step_masses_kg = [1.53, 1.53, 1.0]          # the weights as they were, instead of the configuration's

[steps_s]                                    # when the load changed, seconds after the sync edge
"cuff-hand_test-static_run-1.mcap" = [3.1, 12.0, 20.9]
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field, ValidationError

from documents.message import Figures
from documents.plain_data import PlainDataError, read_toml, shortened
from documents.results import EqualByFields
from documents.validation import Number, Positive, Section, describe_error, faulty_key
from fitting.errors import CodedError, UnusableTrial
from fitting.results.codes import FitErrorCode
from fitting.results.sentences import Note
from fitting.results.trial_codes import RejectionCode, TrialNoteCode
from fitting.trial.bounce import BounceTrial, calibrate
from fitting.trial.calibration import Calibration
from fitting.trial.clocks import LagUncertainty
from fitting.trial.decimation import decimate
from fitting.trial.timeline import (
    SyncCertificate,
    build_timeline,
    certify,
    damage_figures,
    loss_notes,
    require_steady_zero,
    zero_drift,
    zero_notes,
)
from recordings.errors import DamagedFile, RecordingError
from recordings.manifest import CuffSite, DataOrigin, Manifest, TestKind
from recordings.reader import Recording, Track, TrackCollector, open_recording
from recordings.standard_gravity import g

DEFAULT_CUFF_MASS = 0.2
OF_THE_WHOLE = (TrialNoteCode.ZERO_DRIFT, TrialNoteCode.FORCE_LOST, TrialNoteCode.FRAMES_LOST)
"""Notes that a part of a trial has anew."""


@dataclass(frozen=True, eq=False)
class Trial(EqualByFields):
    """One test of one cuff. Session time 0 is the rising edge of /sync; arrays are read-only.

    cuff, test, repeat, run, donning, start_utc_ns  as in the recording's manifest
    file, sha256    source of the trial
    force_time      (n,) s, without lost samples
    force           (n,) N, zero not removed
    force_step      N per converter code, 0 if unknown
    marker_time     (frames,) s, a regular grid
    labels          of the markers: anchor, cuff, rope
    markers         (frames, markers, 3) m in the mocap frame; NaN for a hidden marker and for a lost frame
    lag             of force against markers, already applied, with its uncertainty
    capture_end     s, falling edge of the sync line, or else the end of the longer stream; None for imports
    sync            certificate of the sync line; None without a sync line
    zero_drift      N, change of the force at rest from start to end; None without rest or without the capture's end
    gain_sd         relative standard uncertainty of the load cell's scale
    is_gain_checked  whether every reading of a known mass in the session is within its tolerance, and there is one
    calibration     of the load cell by the session's bounce trials, already applied; None without one
    cuff_mass       kg moving with the cuff between load cell and body
    step_masses     kg, the weights of a static test in the order in which they are added; empty if not given
    swing_duration  s, shortest duration of a dynamic test as planned; None if not given
    step_times      s, steps of the load as given in the session's protocol.toml; None: detected
    force_gaps, frame_gaps  (start, end) s of lost samples
    origin          measured or simulated, as the devices report
    is_whole        False if the recording was cut, or lost samples between the edge and the trial's end
    notes           remarks on the trial
    damage          of the file, beyond a cut end; then the damage is the only note
    marks           number of marks set by the operator
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
    capture_end: float | None = None
    sync: SyncCertificate | None = None
    zero_drift: float | None = None
    gain_sd: float = 0.0
    is_gain_checked: bool = False
    calibration: Calibration | None = None
    cuff_mass: float = DEFAULT_CUFF_MASS
    step_masses: tuple[float, ...] = ()
    swing_duration: float | None = None
    step_times: tuple[float, ...] | None = None
    force_gaps: tuple[tuple[float, float], ...] = ()
    frame_gaps: tuple[tuple[float, float], ...] = ()
    origin: DataOrigin = DataOrigin.UNKNOWN
    is_whole: bool = True
    notes: tuple[Note, ...] = ()
    damage: tuple[str, ...] = ()
    marks: int = 0

    def __post_init__(self) -> None:
        for array in (self.force_time, self.force, self.marker_time, self.markers):
            array.setflags(write=False)

    def __repr__(self) -> str:
        described = f"Trial {self.file}: {self.test} test of cuff {self.cuff.name}"
        if not self.force.size or not self.marker_time.size:
            return described
        return f"{described}, {self.end:.3g} s, force {self.force.min():.3g} to {self.force.max():.3g} N"

    @property
    def end(self) -> float:
        """Session time [s] at which the shorter of force and markers ends."""
        return float(min(self.force_time[-1], self.marker_time[-1]))

    def positions(self, labels: Sequence[str]) -> NDArray[np.float64]:
        """(frames, len(labels), 3) m in the mocap frame."""
        return self.markers[:, [self.labels.index(label) for label in labels]]


def within(trial: Trial, start: float, end: float) -> Trial:
    """The trial from start to end [s] of session time, with a note. Raises ValueError unless that is a part of it.

    Zero drift, losses and their notes are those of the part. The clocks are aligned by the whole capture. The weights
    are compared, and a zero drift is known, only if the part begins unloaded, as the trial does.
    """
    if not 0.0 <= start < end <= trial.end:
        found = f"window of {trial.file} is {start:g} to {end:g} s"
        raise ValueError(f"{found}, expected a part of 0 to {trial.end:.1f} s; choose another")
    used = (trial.force_time >= start) & (trial.force_time <= end)
    frames = (trial.marker_time >= start) & (trial.marker_time <= end)
    time, force = trial.force_time[used], trial.force[used]
    if not time.size or not frames.any():
        raise ValueError(f"window of {trial.file} holds no samples, expected force and markers; choose a longer one")
    is_unloaded = _begins_unloaded(trial, time, force)
    drift = zero_drift(time, force) if is_unloaded else None
    gaps = [_clipped(of_stream, start, end) for of_stream in (trial.force_gaps, trial.frame_gaps)]
    kept = tuple(note for note in trial.notes if note.code not in OF_THE_WHOLE)
    return replace(
        trial,
        force_time=time,
        force=force,
        marker_time=trial.marker_time[frames],
        markers=trial.markers[frames],
        zero_drift=drift,
        step_masses=trial.step_masses if is_unloaded else (),
        step_times=trial.step_times and tuple(step for step in trial.step_times if start < step < end),
        force_gaps=gaps[0],
        frame_gaps=gaps[1],
        notes=(
            *kept,
            *loss_notes(*gaps),
            *zero_notes(drift, float(np.ptp(force))),
            Note(TrialNoteCode.WINDOW, {"start_s": start, "end_s": end}),
        ),
    )


def _clipped(gaps: Sequence[tuple[float, float]], start: float, end: float) -> tuple[tuple[float, float], ...]:
    """The parts of gaps within start and end."""
    parts = ((max(first, start), min(last, end)) for first, last in gaps)
    return tuple((first, last) for first, last in parts if first < last)


def _begins_unloaded(trial: Trial, time: NDArray[np.float64], force: NDArray[np.float64]) -> bool:
    """Whether the first second of a part has the force of that of the trial, within half of any weight."""
    before = trial.force[trial.force_time < trial.force_time[0] + 1.0].mean()
    limit = min([0.125 * float(np.ptp(trial.force)), *(0.5 * g * mass for mass in trial.step_masses)])
    return abs(float(force[time < time[0] + 1.0].mean() - before)) < limit


@dataclass(frozen=True)
class RejectedTrial:
    """An unusable recording and the reason.

    capture is its manifest if the capture had started, so that the cuff may have been loaded; damage is of the file.
    """

    file: str
    reason: Note
    capture: Manifest | None = None
    damage: tuple[str, ...] = ()
    marks: int = 0


def calibrated(trial: Trial, calibration: Calibration) -> Trial:
    """The trial with lag and gain from bounce trials instead of the declared ones.

    The gain is the weighted mean of bounces and certificate (Calibration.gain_with).
    """
    gain, gain_sd = calibration.gain_with(trial.gain_sd)
    lag = calibration.lag
    return replace(
        trial,
        force_time=trial.force_time + lag.value - trial.lag.value,
        force=trial.force / gain,
        force_step=trial.force_step / gain,
        zero_drift=None if trial.zero_drift is None else trial.zero_drift / gain,
        lag=replace(
            trial.lag,
            declared=lag.standard_error,
            since=calibration.middle,
            value=lag.value,
            source=", ".join(calibration.sources),
        ),
        gain_sd=gain_sd,
        calibration=calibration,
    )


def calibrated_by(trials: Sequence[Trial]) -> dict[str, str]:
    """File → SHA-256 of the bounces that calibrate the trials."""
    return {file: sha for trial in trials if trial.calibration for file, sha in trial.calibration.sources.items()}


def data_origins(trials: Sequence[Trial]) -> Iterator[DataOrigin]:
    """Origins of the trials and of the bounces that calibrate them."""
    for trial in trials:
        yield trial.origin
        if trial.calibration is not None:
            yield trial.calibration.origin


def build_trial(manifest: Manifest, tracks: Mapping[str, Track], file: str, sha256: str) -> Trial:
    """A trial from the streams "/force", "/sync" and "/markers" of a cuff's recording. Raises UnusableTrial."""
    site = manifest.cuff
    if site is None:
        raise UnusableTrial(RejectionCode.NO_CUFF, {"file": file})
    timeline = build_timeline(manifest, tracks, site.labels)
    is_at_end = timeline.sync_fall is not None or not manifest.begins_at_edge  # otherwise a load may be on at the end
    drift = zero_drift(timeline.force_time, timeline.force) if is_at_end else None
    require_steady_zero(drift, _zero_limit(manifest))
    return Trial(
        cuff=site,
        test=manifest.test,
        repeat=manifest.repeat,
        run=manifest.run,
        donning=manifest.donning,
        start_utc_ns=manifest.start_utc_ns,
        file=file,
        sha256=sha256,
        force_time=timeline.force_time,
        force=timeline.force,
        force_step=timeline.force_step,
        marker_time=timeline.marker_time,
        labels=site.labels,
        markers=timeline.markers,
        lag=timeline.lag,
        capture_end=timeline.capture_end,
        sync=certify(manifest, decimate(manifest, tracks)),
        zero_drift=drift,
        gain_sd=manifest.load_cell.gain_relative_sd,
        cuff_mass=DEFAULT_CUFF_MASS if site.mass_kg is None else site.mass_kg,
        step_masses=manifest.protocol.step_masses_kg,
        swing_duration=manifest.protocol.swing_s,
        force_gaps=timeline.force_gaps,
        frame_gaps=timeline.frame_gaps,
        origin=manifest.origin,
        is_whole=not timeline.force_gaps and not timeline.frame_gaps,
        notes=timeline.notes + zero_notes(drift, float(np.ptp(timeline.force))),
    )


def _zero_limit(manifest: Manifest) -> float:
    """Limit of the zero drift within a trial [N]; inf for a cell of unknown capacity."""
    cell = manifest.load_cell
    if cell.capacity_kg is None:
        return math.inf
    return cell.zero_drift_relative_limit * cell.capacity_kg * g


def build_bounce(manifest: Manifest, tracks: Mapping[str, Track], file: str, sha256: str) -> BounceTrial:
    """A bounce trial from the streams of its recording. Raises UnusableTrial."""
    rig = manifest.bounce
    if rig is None:
        raise UnusableTrial(RejectionCode.NO_BOUNCE, {"file": file})
    timeline = build_timeline(manifest, tracks, rig.labels)
    return BounceTrial(
        rig=rig,
        repeat=manifest.repeat,
        run=manifest.run,
        start_utc_ns=manifest.start_utc_ns,
        file=file,
        sha256=sha256,
        force_time=timeline.force_time,
        force=timeline.force,
        marker_time=timeline.marker_time,
        position=timeline.markers[:, 0],
        lag=timeline.lag,
        origin=manifest.origin,
    )


TrialReading = Trial | BounceTrial | RejectedTrial
"""Result of reading one recording."""
PROTOCOL_FILE = "protocol.toml"
REPLACEMENTS = (".recovered.mcap", ".completed.mcap")
"""Endings of the files that replace a recording; the steps of the recording apply to them."""


def read_trial(path: Path) -> Trial:
    """Read one recording of a cuff, calibrated with its own configuration only.

    Raises UnusableTrial, or RecordingError if the file is not a recording.
    """
    collector = TrackCollector(path)
    trial = _read(path, open_recording(path, collector.take), collector)
    if isinstance(trial, BounceTrial):
        raise UnusableTrial(RejectionCode.IS_BOUNCE, {"file": path.name})
    return trial


def read_trials(
    paths: Iterable[Path], readings: Mapping[str, TrialReading] = MappingProxyType({})
) -> tuple[tuple[Trial, ...], tuple[RejectedTrial, ...]]:
    """Read recordings as trials; unusable recordings are returned with the reason.

    Bounce trials among them determine lag and gain of the other trials. The steps in protocol.toml beside a recording
    replace the detected ones; raises ProtocolFileError if it is unusable. readings, by file name, are not read again.
    """
    protocols: dict[Path, SessionProtocol] = {}
    found = []
    for path in paths:
        if path.parent not in protocols:
            protocols[path.parent] = read_protocol(path.parent)
        found.append(readings.get(path.name) or read_alone(path, protocols[path.parent]))
    return calibrate_trials(found)


def read_alone(
    path: Path, protocol: SessionProtocol | None = None, correct: Callable[[Manifest], Manifest] | None = None
) -> TrialReading:
    """Read one recording of any kind, without calibration by bounces. Raises ProtocolFileError as read_trials does.

    correct returns the corrected manifest, for a recording that was assigned to another trial.
    """
    recording, collector = None, TrackCollector(path)
    try:
        recording = open_recording(path, collector.take)
        if correct is not None:
            recording = replace(recording, manifest=correct(recording.manifest))
        trial = replace(_read(path, recording, collector), marks=_marks(collector))
    except (UnusableTrial, RecordingError) as error:
        damage = recording.damage if recording else (str(error),) if isinstance(error, DamagedFile) else ()
        unreadable = Note(RejectionCode.UNREADABLE, {"problem": str(error)})
        reason = error.reason if isinstance(error, UnusableTrial) else unreadable
        return RejectedTrial(path.name, reason, _capture_manifest(recording, collector), damage, _marks(collector))
    return _as_edited(trial, protocol) if isinstance(trial, Trial) and protocol is not None else trial


def calibrate_trials(readings: Iterable[TrialReading]) -> tuple[tuple[Trial, ...], tuple[RejectedTrial, ...]]:
    """All trials of a session, calibrated by its bounces, and the rejected recordings."""
    readings = list(readings)
    calibration, refused = calibrate([reading for reading in readings if isinstance(reading, BounceTrial)])
    rejected = [reading for reading in readings if isinstance(reading, RejectedTrial)]
    rejected += [RejectedTrial(file, reason) for file, reason in refused.items()]
    trials = [reading for reading in readings if isinstance(reading, Trial)]
    if calibration is not None:
        trials = [calibrated(trial, calibration) for trial in trials]
    return tuple(trials), tuple(rejected)


def _as_edited(trial: Trial, protocol: SessionProtocol) -> Trial:
    """The trial with the operator's steps and weights. Raises ProtocolFileError for a step outside the trial."""
    masses = trial.step_masses if protocol.step_masses is None else protocol.step_masses
    times = protocol.steps.get(trial.file)
    first, last = float(trial.force_time[0]), float(trial.force_time[-1])
    outside = [time for time in times or () if not first < time < last]
    if outside:
        figures: Figures = {
            "file": PROTOCOL_FILE,
            "recording": trial.file,
            "step_s": outside[0],
            "first_s": first,
            "last_s": last,
        }
        raise ProtocolFileError(FitErrorCode.PROTOCOL_OUTSIDE, figures)
    return replace(trial, step_masses=masses, step_times=times)


def _read(path: Path, recording: Recording, collector: TrackCollector) -> Trial | BounceTrial:
    """Only the damage of a damaged file is reported, because it may cause all other findings."""
    if recording.outcome is not None and not recording.outcome.accepted:
        raise UnusableTrial(RejectionCode.NOT_ACCEPTED, {"outcome": recording.outcome.sentence})
    if recording.damage and recording.manifest.bounce is not None:
        raise UnusableTrial(RejectionCode.DAMAGED, damage_figures(recording.damage))
    try:
        trial = _build(path, recording, collector)
    except (UnusableTrial, RecordingError) as error:
        if recording.damage:
            raise UnusableTrial(RejectionCode.DAMAGED, damage_figures(recording.damage)) from error
        raise
    if isinstance(trial, BounceTrial):
        return trial
    is_whole = trial.is_whole and recording.complete
    missing = tuple(Note(TrialNoteCode.INCOMPLETE, {"missing": sentence}) for sentence in recording.missing)
    if not recording.damage:
        return replace(trial, is_whole=is_whole, notes=trial.notes + missing)
    certificate = trial.sync and replace(trial.sync, findings=())
    notes = (Note(TrialNoteCode.DAMAGED, damage_figures(recording.damage)), *missing)
    return replace(trial, is_whole=is_whole, notes=notes, sync=certificate, damage=recording.damage)


def _build(path: Path, recording: Recording, collector: TrackCollector) -> Trial | BounceTrial:
    if recording.manifest.body is not None:
        figures = {"file": path.name, "test": recording.manifest.test}
        raise UnusableTrial(RejectionCode.IS_WEARER_TRIAL, figures)
    tracks = {stream.name: collector.track(stream) for stream in recording.streams}
    sha256 = hashlib.sha256(path.read_bytes()).hexdigest()
    build = build_trial if recording.manifest.bounce is None else build_bounce
    return build(recording.manifest, tracks, path.name, sha256)


def _marks(collector: TrackCollector) -> int:
    return sum(event.kind == "mark" for event in collector.events())


def _capture_manifest(recording: Recording | None, collector: TrackCollector) -> Manifest | None:
    """The manifest, or None if the recording ended while the station was waiting for the sync edge."""
    if recording is None:
        return None
    begins = ("sync_edge", "imported")
    has_begun = any(event.kind in begins for event in collector.events())
    return recording.manifest if has_begun or recording.outcome is None else None


class ProtocolFileError(CodedError):
    """The session's protocol.toml cannot be used."""


@dataclass(frozen=True)
class SessionProtocol:
    """step_masses [kg], None: as configured; steps: file name of a recording → times [s] of its steps."""

    step_masses: tuple[float, ...] | None = None
    steps: Mapping[str, tuple[float, ...]] = field(default_factory=dict)


def read_protocol(folder: Path) -> SessionProtocol:
    """Read protocol.toml of a session; an empty SessionProtocol without the file. Raises ProtocolFileError."""
    path = folder / PROTOCOL_FILE
    try:
        table = _ProtocolTable.model_validate(read_toml(path))
    except FileNotFoundError:
        return SessionProtocol()
    except OSError as error:
        figures = {"file": str(path), "problem": error.strerror or str(error)}
        raise ProtocolFileError(FitErrorCode.PROTOCOL_UNREADABLE, figures) from error
    except PlainDataError as error:
        figures = {"file": str(path), "problem": str(error)}
        raise ProtocolFileError(FitErrorCode.PROTOCOL_NOT_TOML, figures) from error
    except ValidationError as error:
        figures = {"file": str(path), "key": faulty_key(error), "problem": describe_error(error)}
        raise ProtocolFileError(FitErrorCode.PROTOCOL_INVALID, figures) from error
    return SessionProtocol(table.step_masses_kg, _with_replacements(table.steps_s, path))


def _with_replacements(steps: Mapping[str, tuple[float, ...]], path: Path) -> dict[str, tuple[float, ...]]:
    """Steps by recording, and by the file that replaces it. Refuse a name without a file: it would have no effect."""
    for file in steps:
        if not (path.parent / file).is_file():
            figures = {"file": str(path), "recording": file}
            raise ProtocolFileError(FitErrorCode.PROTOCOL_NO_RECORDING, figures)
    return {Path(file).stem + ending: times for file, times in steps.items() for ending in REPLACEMENTS} | dict(steps)


def _rising(times: tuple[float, ...]) -> tuple[float, ...]:
    if any(after <= before for before, after in pairwise(times)):
        raise ValueError(f"found {shortened(list(times))}, expected times that rise")
    return times


class _ProtocolTable(Section):
    """The keys of protocol.toml."""

    step_masses_kg: tuple[Positive, ...] | None = None
    steps_s: dict[str, Annotated[tuple[Number, ...], AfterValidator(_rising)]] = Field(default_factory=dict)
