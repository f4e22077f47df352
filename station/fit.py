"""Fit the cuffs of a session folder: recordings, trials, fit, cuffs.json."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

from documents.message import Message
from fitting.cuffs.cuff_fit import SessionFit
from fitting.cuffs.cuffs_file import cuffs_json
from fitting.cuffs.wearable_cuff import bushing_force
from fitting.results.sentences import Note
from fitting.results.trial_codes import RejectionCode, TrialNoteCode
from fitting.session import fit_session
from fitting.trial.mass_checks import check_notes, read_checks, with_mass_checks
from fitting.trial.trial import RejectedTrial, Trial, TrialReading, read_alone, read_protocol, read_trials
from recordings.errors import RecordingError
from recordings.manifest import Manifest
from recordings.reader import read_manifest
from station.checksums import check_hash, write_checksums, write_whole
from station.errors import StationError
from station.exit_code import LOSSY
from station.folders import ensure_folder, require_folder
from station.journal import Assignment, Journal, read_journal
from station.messages.setup_messages import FolderCode
from station.progress import Progress, silent
from station.recordings_of_session import pulls_in, useless_copies_in


class SessionError(StationError):
    """The folder cannot be fitted or assessed."""


class DamagedSession(SessionError):
    """No recording can be used, and at least one is damaged."""

    exit_code = LOSSY


def fit_session_folder(
    folder: Path,
    output: Path | None,
    progress: Progress = silent,
    readings: Mapping[str, TrialReading] = MappingProxyType({}),
) -> SessionFit:
    """Fit a session folder and write cuffs.json. readings: recordings by file name that are not read again.

    Raises SessionError if no trial can be used.
    """
    require_folder(folder, SessionError)
    paths = pulls_in(folder)
    if not paths:
        raise SessionError(Message(FolderCode.NO_RECORDING, {"folder": str(folder)}))
    if output is not None:
        ensure_folder(output.parent)
    journal = read_journal(folder)
    fitted = replace(
        _fit(folder, paths, journal, progress, readings), recordings={path.name: check_hash(path) for path in paths}
    )
    if output is not None:
        write_whole(output, cuffs_json(fitted))
        write_checksums(output, *_write_bushings(output.parent, fitted))
    return fitted


def fit_trial_donning(folder: Path, trial: Trial) -> SessionFit:
    """Fit the donning of a trial, as in fit_session_folder, at the cost of that donning only.

    Only its recordings and the bounces, which calibrate it, are read; the trial is not read again. The donning of the
    other recordings is taken from the journal, or else from the manifest. Raises SessionError.
    """
    journal = read_journal(folder)
    recorded = {entry.file: entry for entry in journal.recorded}

    def belongs(path: Path) -> bool:
        if path.name == trial.file:
            return True
        entry = recorded.get(path.name)
        if entry is not None:
            return entry.test == "bounce" or (entry.cuff, entry.donning) == (trial.cuff.name, trial.donning)
        try:
            manifest = _corrected(read_manifest(path), journal.assignments.get(path.name))
        except RecordingError:
            return False  # unreadable: its cuff is unknown
        return manifest.cuff is None or (manifest.cuff.name, manifest.donning) == (trial.cuff.name, trial.donning)

    paths = [path for path in pulls_in(folder) if belongs(path)]
    return _fit(folder, paths, journal, silent, {trial.file: trial})


def read_recording(path: Path) -> TrialReading:
    """Read a recording of a session in one pass, as the trial that the operator assigned it to."""
    journal = read_journal(path.parent)
    return (
        _read_assigned(path, journal)
        if path.name in journal.assignments
        else read_alone(path, read_protocol(path.parent))
    )


def _fit(
    folder: Path, paths: Sequence[Path], journal: Journal, progress: Progress, readings: Mapping[str, TrialReading]
) -> SessionFit:
    redone = journal.redone
    used = [path for path in paths if path.name not in redone]
    assigned = {
        path.name: _read_assigned(path, journal)
        for path in used
        if path.name in journal.assignments and path.name not in readings
    }
    trials, rejected = read_trials(_with_progress(used, progress), {**readings, **assigned})
    rejected += tuple(_set_aside(path, journal) for path in paths if path.name in redone)
    rejected += tuple(RejectedTrial(path.name, Note(RejectionCode.OTHER_TRIAL)) for path in useless_copies_in(folder))
    if not trials:
        reasons = "; ".join(f"{trial.file}: {trial.reason}" for trial in rejected)
        reasons = reasons or "there are only bounce trials; record a trial of a cuff"
        damaged = [trial.file for trial in rejected if trial.damage]
        if damaged:
            figures = {"files": ", ".join(damaged), "folder": str(folder), "reasons": reasons}
            raise DamagedSession(Message(FolderCode.DAMAGED, figures))
        raise SessionError(Message(FolderCode.NOT_USABLE, {"folder": str(folder), "reasons": reasons}))
    checks = read_checks(folder)
    fitting = fit_session(with_mass_checks(trials, checks), rejected, lambda *count: progress("fitting cuffs", *count))
    return fitting.with_notes(check_notes(checks))


def _write_bushings(folder: Path, fitted: SessionFit) -> list[Path]:
    """Write every identified cuff as a BushingForce of OpenSim, in the folder of cuffs.json."""
    identified = {folder / f"bushing_{name}.xml": fit for name, fit in fitted.cuffs.items() if not fit.missing}
    for path, fit in identified.items():
        write_whole(path, bushing_force(fit.wearable()))
    return list(identified)


def _set_aside(path: Path, journal: Journal) -> RejectedTrial:
    """A recording that the operator redid. It counts for migration, because its cuff was loaded."""
    try:
        manifest = _corrected(read_manifest(path), journal.assignments.get(path.name))
    except RecordingError:
        manifest = None
    return RejectedTrial(path.name, Note(RejectionCode.SET_ASIDE, {"reason": journal.redone[path.name]}), manifest)


def _read_assigned(path: Path, journal: Journal) -> TrialReading:
    """Read a recording as the trial that the operator assigned it to, with a note on its original trial."""
    given, recorded_as = journal.assignments[path.name], ""

    def correct(manifest: Manifest) -> Manifest:
        nonlocal recorded_as
        recorded_as = f"{manifest.cuff.name if manifest.cuff else 'load cell'}, {manifest.test}, {manifest.repeat}"
        return _as_assigned(manifest, given)

    reading = read_alone(path, read_protocol(path.parent), correct)
    note = Note(TrialNoteCode.ASSIGNED, {"recorded_as": recorded_as})
    return replace(reading, notes=(*reading.notes, note)) if isinstance(reading, Trial) else reading


def _corrected(manifest: Manifest, given: Assignment | None) -> Manifest:
    return manifest if given is None else _as_assigned(manifest, given)


def _as_assigned(manifest: Manifest, given: Assignment) -> Manifest:
    return replace(manifest, cuff=given.cuff, test=given.test, repeat=given.repeat, donning=given.donning)


def _with_progress(paths: Sequence[Path], progress: Progress) -> Iterator[Path]:
    for done, path in enumerate(paths):
        progress("reading trials", done, len(paths))
        yield path
    progress("reading trials", len(paths), len(paths))
