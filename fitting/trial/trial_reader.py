"""Read recordings as trials and bounces; an unusable one is returned with the reason.

protocol.toml in a session's folder has the operator's corrections of the detected steps:

step_masses_kg = [1.53, 1.53, 1.0]          # the weights as they were, instead of the configuration's

[steps_s]                                    # when the load changed, seconds after the sync edge
"cuff-hand_test-static_run-1.mcap" = [3.1, 12.0, 20.9]
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType
from typing import Annotated

from pydantic import AfterValidator, Field, ValidationError

from documents.plain_data import PlainDataError, read_toml, shortened
from documents.validation import Number, Positive, Section, describe_error, faulty_key
from fitting.errors import CodedError, UnusableTrial
from fitting.results.codes import FitErrorCode, RejectionCode, TrialNoteCode
from fitting.results.rendering import Figures, Note
from fitting.trial.bounce import BounceTrial, calibrate
from fitting.trial.force_quality import damage_figures
from fitting.trial.trial import RejectedTrial, Trial, build_bounce, build_trial, calibrated
from recordings.errors import DamagedFile, RecordingError
from recordings.manifest import Manifest
from recordings.reader import Recording, TrackCollector, open_recording

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
    path: Path,
    protocol: SessionProtocol | None = None,
    correct: Callable[[Manifest], Manifest] | None = None,
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
        return RejectedTrial(
            path.name, _reason(error), _capture_manifest(recording, collector), damage, _marks(collector)
        )
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


def _reason(error: UnusableTrial | RecordingError) -> Note:
    return error.reason if isinstance(error, UnusableTrial) else Note(RejectionCode.UNREADABLE, {"problem": str(error)})


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
        data = read_toml(path)
    except FileNotFoundError:
        return SessionProtocol()
    except OSError as error:
        figures = {"file": str(path), "problem": error.strerror or str(error)}
        raise ProtocolFileError(FitErrorCode.PROTOCOL_UNREADABLE, figures) from error
    except PlainDataError as error:
        figures = {"file": str(path), "problem": str(error)}
        raise ProtocolFileError(FitErrorCode.PROTOCOL_NOT_TOML, figures) from error
    try:
        table = _ProtocolTable.model_validate(data)
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
