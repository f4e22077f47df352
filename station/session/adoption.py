"""Adopt recordings that are missing in the journal: left by a killed recorder, or written by `station record`."""

from __future__ import annotations

from pathlib import Path

from filelock import FileLock, Timeout

from recordings.errors import RecordingError
from recordings.reader import open_recording
from recordings.recovery import RecoveryReport, recover
from station.bench.trial_recorder import LOCK
from station.checksums import write_checksums
from station.journal import Recorded, read_journal, write_recorded
from station.messages.codes import TrialCode
from station.messages.message import Message
from station.recordings_of_session import recordings_in


def adopt_recordings(folder: Path) -> tuple[Recorded, ...] | None:
    """Enter every recording of the folder into the journal if it is missing there; recover a cut one first.

    Returns the new entries; None, without effect, while a recorder runs in the folder: it writes its own entry.
    """
    adopted = []
    try:
        with FileLock(folder / LOCK, timeout=0):
            known = {trial.file for trial in read_journal(folder).recorded}
            for path in recordings_in(folder):
                if path.name not in known:
                    adopted.append(_recorded_from(path))
                    write_recorded(folder, adopted[-1])
    except Timeout:
        return None
    return tuple(adopted)


def is_being_recorded(folder: Path) -> bool:
    """Whether a recorder runs in the folder of a session."""
    if not (folder / LOCK).exists():
        return False
    try:
        with FileLock(folder / LOCK, timeout=0):
            return False
    except Timeout:
        return True
    except (OSError, NotImplementedError):  # a folder without locks records nothing
        return False


def _recorded_from(path: Path) -> Recorded:
    try:
        recording = open_recording(path)
        killed = None
        if not recording.complete:
            report = recover(path)
            write_checksums(path, report.output)
            path, killed = report.output, _describe_kill(report)
        manifest, outcome = recording.manifest, recording.outcome
    except RecordingError as error:
        unreadable = Message(TrialCode.UNREADABLE, {"text": str(error)})
        place = (path.name, None, "unreadable", 0, "")
        return Recorded(*place, accepted=False, lost_samples=0, sentence=str(unreadable), codes=(unreadable,))
    cuff = manifest.cuff.name if manifest.cuff else None
    is_accepted = killed is None and outcome is not None and outcome.accepted
    sentence = str(killed) if killed else outcome.sentence if outcome else ""
    known = {code.value: code for code in TrialCode}
    codes = [Message(known[code]) for code in outcome.codes if code in known] if outcome else []
    return Recorded(
        path.name,
        cuff,
        manifest.test,
        manifest.repeat,
        manifest.donning,
        is_accepted,
        0,
        sentence,
        manifest.origin,
        (killed,) if killed else tuple(codes),
        manifest.condition,
    )


def _describe_kill(report: RecoveryReport) -> Message[TrialCode]:
    """The time that was kept for the operator; the damage to the file and to its streams as `details`."""
    streams = report.contents.streams.values()
    kept_s = max(((stream.last_device_time_ns - stream.first_device_time_ns) * 1e-9 for stream in streams), default=0)
    figures = {"text": f"{kept_s:.0f} s of it are kept", "details": "; ".join(report.sentences())}
    return Message(TrialCode.RECORDER_KILLED, figures)
