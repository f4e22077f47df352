"""A recording becomes a trial: SI units, one clock, cut to the capture, gaps marked."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from scipy.constants import g

from fitting import quality
from fitting.bounce import BounceTrial, calibrate
from fitting.calibration import Calibration
from fitting.protocol_file import PROTOCOL_FILE, ProtocolFileError, SessionProtocol, read_protocol
from fitting.quality import UnusableTrial
from fitting.timing.clocks import LagUncertainty
from fitting.timing.decimation import decimate
from fitting.timing.sync_certificate import SyncCertificate, certify
from fitting.timing.timeline import lay_out
from recordings.errors import DamagedFile, RecordingError
from recordings.manifest import CuffSite, DataOrigin, Manifest, TestKind
from recordings.reader import Recording, Track, TrackCollector, open_recording

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
    lag             of force against markers: what it was taken to be, and its uncertainty
    sync_fall       s, when the sync line fell again; None where that was not recorded
    sync            certificate of the sync line's edges; None where there is no sync line
    zero_drift      N by which the force at rest changed from start to end; None without rest, or the capture's end
    gain_sd         relative standard uncertainty of the load cell's scale
    calibration     of the load cell by the session's bounce trials, already applied; None without one
    cuff_mass       kg moving with the cuff between load cell and body
    step_masses     kg, the weights of a static test in the order in which they are hung on; empty if not given
    step_times      s, when the load changed, where the session's protocol.toml gives them; None: detected
    force_gaps, frame_gaps  (start, end) s of samples that were numbered and not recorded
    origin          measured or simulated, as the devices said of themselves
    is_whole        False if the recording was cut, or lost samples between the edge and the trial's end
    notes           what a reader should know before believing it
    damage          of the file, beyond a cut: then only the damage is a note
    marks           number of moments that the operator marked
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
    sync: SyncCertificate | None = None
    zero_drift: float | None = None
    gain_sd: float = 0.0
    calibration: Calibration | None = None
    cuff_mass: float = DEFAULT_CUFF_MASS
    step_masses: tuple[float, ...] = ()
    step_times: tuple[float, ...] | None = None
    force_gaps: tuple[tuple[float, float], ...] = ()
    frame_gaps: tuple[tuple[float, float], ...] = ()
    origin: DataOrigin = DataOrigin.UNKNOWN
    is_whole: bool = True
    notes: tuple[str, ...] = ()
    damage: tuple[str, ...] = ()
    marks: int = 0

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

    capture is its manifest if its capture had begun, so that the cuff may have been loaded; damage is that of the file.
    """

    file: str
    reason: str
    capture: Manifest | None = None
    damage: tuple[str, ...] = ()
    marks: int = 0


TrialReading = Trial | BounceTrial | RejectedTrial
"""What became of reading one recording."""


def read_trial(path: Path) -> Trial:
    """Reads one recording of a cuff, calibrated by nothing but its own configuration.

    Raises UnusableTrial, or RecordingError if the file is none of ours.
    """
    collector = TrackCollector(path)
    trial = _read(path, open_recording(path, collector.take), collector)
    if isinstance(trial, BounceTrial):
        raise UnusableTrial(f"{path.name} is a bounce, which calibrates the load cell; give a trial of a cuff")
    return trial


def read_bounce(path: Path) -> BounceTrial:
    """Reads one bounce. Raises UnusableTrial, or RecordingError if the file is none of ours."""
    collector = TrackCollector(path)
    trial = _read(path, open_recording(path, collector.take), collector)
    if isinstance(trial, Trial):
        raise UnusableTrial(f"{path.name} is a trial of a cuff; give a bounce")
    return trial


def read_trials(
    paths: Iterable[Path], readings: Mapping[str, TrialReading] = MappingProxyType({})
) -> tuple[tuple[Trial, ...], tuple[RejectedTrial, ...]]:
    """Reads every recording that can be used; the others come with the reason why not.

    Where there are bounce trials among them, lag and gain of all others are what those say. What protocol.toml beside
    a recording says of its steps counts; raises ProtocolFileError if that cannot be read. readings, by file name, are
    not read again.
    """
    protocols: dict[Path, SessionProtocol] = {}
    found = []
    for path in paths:
        if path.parent not in protocols:
            protocols[path.parent] = read_protocol(path.parent)
        found.append(readings.get(path.name) or read_alone(path, protocols[path.parent]))
    return calibrate_trials(found)


def read_alone(
    path: Path,
    protocol: SessionProtocol | None = None,
    correct: Callable[[Manifest], Manifest] | None = None,
) -> TrialReading:
    """Reads one recording of any kind, not yet calibrated by bounces. Raises ProtocolFileError as read_trials does.

    correct gives its manifest as it should read, where the recording is of another trial than it was recorded as.
    """
    recording, collector = None, TrackCollector(path)
    try:
        recording = open_recording(path, collector.take)
        if correct is not None:
            recording = replace(recording, manifest=correct(recording.manifest))
        trial = replace(_read(path, recording, collector), marks=_marks(collector))
    except (UnusableTrial, RecordingError) as error:
        damage = recording.damage if recording else (str(error),) if isinstance(error, DamagedFile) else ()
        return RejectedTrial(path.name, str(error), _begun(recording, collector), damage, _marks(collector))
    return _as_edited(trial, protocol) if isinstance(trial, Trial) and protocol is not None else trial


def calibrate_trials(readings: Iterable[TrialReading]) -> tuple[tuple[Trial, ...], tuple[RejectedTrial, ...]]:
    """All trials of a session, calibrated by its bounces, and what cannot be used."""
    readings = list(readings)
    calibration, refused = calibrate([each for each in readings if isinstance(each, BounceTrial)])
    rejected = [each for each in readings if isinstance(each, RejectedTrial)]
    rejected += [RejectedTrial(file, reason) for file, reason in refused.items()]
    trials = [each for each in readings if isinstance(each, Trial)]
    return tuple(each if calibration is None else calibrated(each, calibration) for each in trials), tuple(rejected)


def calibrated(trial: Trial, calibration: Calibration) -> Trial:
    """The trial with the lag and the gain that bounce trials found, in the place of the declared ones.

    A gain that the certificate knows better stays; one that is known from both is their weighted mean.
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


def _as_edited(trial: Trial, protocol: SessionProtocol) -> Trial:
    """With the steps as the operator knows them. Raises ProtocolFileError if one lies outside the trial."""
    masses = trial.step_masses if protocol.step_masses is None else protocol.step_masses
    times = protocol.steps.get(trial.file)
    first, last = float(trial.force_time[0]), float(trial.force_time[-1])
    outside = [time for time in times or () if not first < time < last]
    if outside:
        raise ProtocolFileError(
            f"{PROTOCOL_FILE} names a step of {trial.file} at {outside[0]:g} s, expected between {first:.1f} and "
            f"{last:.1f} s after its sync edge; correct the time"
        )
    return replace(trial, step_masses=masses, step_times=times)


def _read(path: Path, recording: Recording, collector: TrackCollector) -> Trial | BounceTrial:
    """Of a damaged file nothing but the damage is named: any other oddity in it may be the damage's work."""
    if recording.outcome is not None and not recording.outcome.accepted:
        raise UnusableTrial(f"the trial was not accepted when it was recorded: {recording.outcome.sentence}")
    if recording.damage and recording.manifest.bounce is not None:
        raise UnusableTrial(quality.damage_sentence(recording.damage))
    try:
        trial = _build(path, recording, collector)
    except (UnusableTrial, RecordingError) as error:
        if recording.damage:
            raise UnusableTrial(quality.damage_sentence(recording.damage)) from error
        raise
    if isinstance(trial, BounceTrial):
        return trial
    is_whole = trial.is_whole and recording.complete
    if not recording.damage:
        return replace(trial, is_whole=is_whole, notes=trial.notes + recording.missing)
    certificate = trial.sync and replace(trial.sync, findings=())
    notes = (quality.damage_sentence(recording.damage), *recording.missing)
    return replace(trial, is_whole=is_whole, notes=notes, sync=certificate, damage=recording.damage)


def _build(path: Path, recording: Recording, collector: TrackCollector) -> Trial | BounceTrial:
    tracks = {stream.name: collector.track(stream) for stream in recording.streams}
    sha256 = hashlib.sha256(path.read_bytes()).hexdigest()
    build = build_trial if recording.manifest.bounce is None else build_bounce
    return build(recording.manifest, tracks, path.name, sha256)


def _marks(collector: TrackCollector) -> int:
    return sum(event.kind == "mark" for event in collector.events())


def _begun(recording: Recording | None, collector: TrackCollector) -> Manifest | None:
    """The manifest, unless the station was still waiting for the edge when the recording ended."""
    if recording is None:
        return None
    begins = ("sync_edge", "imported")
    has_begun = any(event.kind in begins for event in collector.events())
    return recording.manifest if has_begun or recording.outcome is None else None


def build_trial(manifest: Manifest, tracks: Mapping[str, Track], file: str, sha256: str) -> Trial:
    """The streams "/force", "/sync" and "/markers" of a recording of a cuff → Trial. Raises UnusableTrial."""
    site = manifest.cuff
    if site is None:
        raise UnusableTrial(f"{file} is a recording of no cuff; give the test a cuff")
    line = lay_out(manifest, tracks, site.labels)
    is_at_end = line.sync_fall is not None or not manifest.begins_at_edge  # else a load may hang on at what is the end
    drift = quality.zero_drift(line.force_time, line.force) if is_at_end else None
    quality.require_steady_zero(drift, _zero_limit(manifest))
    return Trial(
        cuff=site,
        test=manifest.test,
        repeat=manifest.repeat,
        run=manifest.run,
        donning=manifest.donning,
        start_utc_ns=manifest.start_utc_ns,
        file=file,
        sha256=sha256,
        force_time=line.force_time,
        force=line.force,
        force_step=line.force_step,
        marker_time=line.marker_time,
        labels=site.labels,
        markers=line.markers,
        lag=line.lag,
        sync_fall=line.sync_fall,
        sync=certify(manifest, decimate(manifest, tracks)),
        zero_drift=drift,
        gain_sd=manifest.load_cell.gain_relative_sd,
        cuff_mass=DEFAULT_CUFF_MASS if site.mass_kg is None else site.mass_kg,
        step_masses=manifest.protocol.step_masses_kg,
        force_gaps=line.force_gaps,
        frame_gaps=line.frame_gaps,
        origin=manifest.origin,
        is_whole=not line.force_gaps and not line.frame_gaps,
        notes=line.notes + quality.zero_notes(drift, float(np.ptp(line.force))),
    )


def _zero_limit(manifest: Manifest) -> float:
    """Newtons by which the zero may drift within a trial; inf for a cell of unknown capacity."""
    cell = manifest.load_cell
    if cell.capacity_kg is None:
        return math.inf
    return cell.zero_drift_relative_limit * cell.capacity_kg * g


def build_bounce(manifest: Manifest, tracks: Mapping[str, Track], file: str, sha256: str) -> BounceTrial:
    """The same of a bounce. Raises UnusableTrial."""
    rig = manifest.bounce
    if rig is None:
        raise UnusableTrial(f"{file} is a recording of no bounce; its manifest holds no weight")
    line = lay_out(manifest, tracks, rig.labels)
    return BounceTrial(
        rig=rig,
        repeat=manifest.repeat,
        run=manifest.run,
        start_utc_ns=manifest.start_utc_ns,
        file=file,
        sha256=sha256,
        force_time=line.force_time,
        force=line.force,
        marker_time=line.marker_time,
        position=line.markers[:, 0],
        lag=line.lag,
        origin=manifest.origin,
    )
