"""A session's folder → its cuffs: recordings, trials, fit, cuffs.json."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

from fitting.bushing import bushing_force
from fitting.mass_checks import read_checks, with_gain_drift, with_mass_checks
from fitting.protocol_file import read_protocol
from fitting.result import SessionFit
from fitting.results.cuffs_json import cuffs_json
from fitting.seal import CheckedFile
from fitting.session import fit_session
from fitting.trial import RejectedTrial, Trial, TrialReading, read_alone, read_trials
from recordings.errors import RecordingError
from recordings.manifest import Manifest
from recordings.older_manifest import cuff_mass
from recordings.reader import read_manifest
from station.checksums import sha256_of, standing_of, write_checksums
from station.errors import StationError
from station.exit_code import LOSSY
from station.journal import Assignment, Journal, read_journal
from station.progress import Progress, silent
from station.whole_file import write_whole


class SessionError(StationError):
    """The folder cannot be fitted or assessed; one sentence."""


class DamagedSession(SessionError):
    """No recording can be used, and a damaged one is among them."""

    exit_code = LOSSY


def recordings_in(folder: Path) -> list[Path]:
    """The session's trial files; where one was recovered or completed, that file stands for its original."""
    files = sorted(folder.glob("*.mcap"))
    replaced = {_original_of(path) for path in files if _is(path, "recovered") or _is(path, "completed")}
    return [path for path in files if path not in replaced]


def originals_in(folder: Path) -> list[Path]:
    """As recordings_in, but a recovered copy is left out where its original is: it holds nothing else."""
    files = {path for path in folder.glob("*.mcap") if not _is(path, "completed")}
    kept = [path for path in files if not (_is(path, "recovered") and _original_of(path) in files)]
    completed = {_original_of(path): path for path in folder.glob("*.mcap") if _is(path, "completed")}
    return sorted({completed.get(path, path) for path in kept} | set(completed.values()))


def fit_session_folder(
    folder: Path,
    output: Path | None,
    progress: Progress = silent,
    readings: Mapping[str, TrialReading] = MappingProxyType({}),
) -> SessionFit:
    """Recordings → trials → fit → cuffs.json. Raises SessionError when not one trial can be used.

    readings, by file name, are not read again.
    """
    if not folder.is_dir():
        raise SessionError(f"{folder} is not a folder; give the folder that `station record` wrote into")
    paths = recordings_in(folder)
    if not paths:
        raise SessionError(f"{folder} holds no recording (*.mcap); record a trial into it first")
    journal = read_journal(folder)
    fitted = replace(_fit(folder, paths, journal, progress, readings), recordings=_checked(paths))
    if output is not None:
        write_whole(output, cuffs_json(fitted))
        write_checksums(output, *_write_bushings(output.parent, fitted))
    return fitted


def fit_donning_of(folder: Path, trial: Trial) -> SessionFit:
    """The fit of the donning that the trial belongs to, as in fit_session_folder, at the cost of that donning alone.

    Only its recordings and the bounces, which calibrate it, are read; the trial itself is not read again. The donning
    of another recording is as in the journal, or else as in its manifest. Raises SessionError.
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
            return False  # not known to have loaded this cuff
        return manifest.cuff is None or (manifest.cuff.name, manifest.donning) == (trial.cuff.name, trial.donning)

    paths = [path for path in recordings_in(folder) if belongs(path)]
    return _fit(folder, paths, journal, silent, {trial.file: trial})


def read_recording(path: Path) -> TrialReading:
    """One recording of a session, in one pass, as the trial that the operator assigned it to."""
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
    counting = [path for path in paths if path.name not in redone]
    assigned = {
        path.name: _read_assigned(path, journal)
        for path in counting
        if path.name in journal.assignments and path.name not in readings
    }
    trials, rejected = read_trials(_counted(counting, "reading trials", progress), {**readings, **assigned})
    rejected += tuple(_set_aside(path, journal) for path in paths if path.name in redone)
    if not trials:
        reasons = "; ".join(f"{trial.file}: {trial.reason}" for trial in rejected)
        reasons = reasons or "there are only bounce trials; record a cuff, too"
        damaged = [trial.file for trial in rejected if trial.damage]
        if damaged:
            raise DamagedSession(
                f"{', '.join(damaged)} is damaged, and no recording in {folder} can be used: {reasons}"
            )
        raise SessionError(f"no recording in {folder} can be used: {reasons}")
    checks = read_checks(folder)
    fitting = fit_session(with_gain_drift(trials, checks), rejected, lambda *count: progress("fitting cuffs", *count))
    return with_mass_checks(fitting, checks)


def _is(path: Path, what: str) -> bool:
    return path.suffixes[-2:-1] == [f".{what}"]


def _original_of(path: Path) -> Path:
    return path.with_suffix("").with_suffix(".mcap")


def _checked(paths: Sequence[Path]) -> dict[str, CheckedFile]:
    """Every recording against what was recorded of it when it ended."""
    hashes = {path: sha256_of(path) for path in paths}
    return {path.name: CheckedFile(sha256, standing_of(path, sha256)) for path, sha256 in hashes.items()}


def _write_bushings(folder: Path, fitted: SessionFit) -> list[Path]:
    """Beside cuffs.json, each cuff that is identified as OpenSim's BushingForce."""
    identified = {folder / f"bushing_{name}.xml": fit for name, fit in fitted.cuffs.items() if not fit.missing}
    for path, fit in identified.items():
        write_whole(path, bushing_force(fit))
    return list(identified)


def _set_aside(path: Path, journal: Journal) -> RejectedTrial:
    """A recording that the operator redid. Its cuff was loaded all the same, and may have migrated in it."""
    try:
        manifest = _corrected(read_manifest(path), journal.assignments.get(path.name))
    except RecordingError:
        manifest = None
    return RejectedTrial(path.name, f"set aside by the operator: {journal.redone[path.name]}", manifest)


def _read_assigned(path: Path, journal: Journal) -> TrialReading:
    """A recording as the trial that the operator assigned it to, with a note on what it was recorded as."""
    given, recorded_as = journal.assignments[path.name], ""

    def correct(manifest: Manifest) -> Manifest:
        nonlocal recorded_as
        recorded_as = f"{manifest.cuff.name if manifest.cuff else 'load cell'}, {manifest.test}, {manifest.repeat}"
        return _as_assigned(manifest, given)

    reading = read_alone(path, read_protocol(path.parent), correct)
    note = f"assigned to this trial by the operator; recorded as {recorded_as}"
    return replace(reading, notes=(*reading.notes, note)) if isinstance(reading, Trial) else reading


def _corrected(manifest: Manifest, given: Assignment | None) -> Manifest:
    return manifest if given is None else _as_assigned(manifest, given)


def _as_assigned(manifest: Manifest, given: Assignment) -> Manifest:
    cuff = given.cuff
    if cuff.mass_kg is None:  # the journal of an older station
        cuff = replace(cuff, mass_kg=cuff_mass(manifest.effective_config, cuff.name))
    return replace(manifest, cuff=cuff, test=given.test, repeat=given.repeat, donning=given.donning)


def _counted(paths: Sequence[Path], what: str, progress: Progress) -> Iterator[Path]:
    for done, path in enumerate(paths):
        progress(what, done, len(paths))
        yield path
    progress(what, len(paths), len(paths))
