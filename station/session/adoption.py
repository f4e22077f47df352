"""Recordings that nobody has spoken for: a killed recorder left them, or `station record` wrote them."""

from __future__ import annotations

from pathlib import Path

from filelock import FileLock, Timeout

from recordings.errors import RecordingError
from recordings.reader import open_recording
from recordings.recovery import recover
from station.bench.trial_recorder import LOCK
from station.checksums import write_checksums
from station.fit import recordings_in
from station.journal import Recorded, read_journal, write_recorded


def adopt_recordings(folder: Path) -> None:
    """Enters every recording of the folder that the journal does not know; a cut one is recovered first.

    Does nothing while a recorder is at work in the folder: it writes its own line.
    """
    try:
        with FileLock(folder / LOCK, timeout=0):
            known = {each.file for each in read_journal(folder).recorded}
            for path in recordings_in(folder):
                if path.name not in known:
                    write_recorded(folder, _account_of(path))
    except Timeout:
        return


def _account_of(path: Path) -> Recorded:
    try:
        recording = open_recording(path)
        words = ""
        if not recording.complete:
            report = recover(path)
            write_checksums(path, report.output)
            path, words = report.output, "; ".join(("the recorder was killed in mid trial", *report.sentences()))
        manifest, outcome = recording.manifest, recording.outcome
    except RecordingError as error:
        return Recorded(path.name, None, "unreadable", 0, "", accepted=False, lost_samples=0, sentence=str(error))
    cuff = manifest.cuff.name if manifest.cuff else None
    is_accepted = not words and outcome is not None and outcome.accepted
    said = words or (outcome.sentence if outcome else "")
    place = (cuff, manifest.test, manifest.repeat, manifest.donning)
    return Recorded(path.name, *place, is_accepted, 0, said, manifest.origin)
