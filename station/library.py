"""Functions of the public package that read and fit recordings. Those that solve are in solver_library.py."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from os import PathLike
from pathlib import Path

from fitting.cuffs.cuff_fit import CuffFit, SessionFit
from fitting.session import fit_session as fit_trials
from fitting.trial.reader import read_trials
from recordings.reader import Recording, open_recording
from station.fit import SessionError, fit_session_folder
from station.messages.message import Message
from station.messages.setup_codes import FolderCode

File = Path | str


def read_recording(path: File) -> Recording:
    """Read an MCAP recording: its manifest, streams and losses.

    `recording.load("/force").to_dataframe()` gives the samples of one stream in Stream.unit. Raises RecordingError.
    """
    return open_recording(Path(path))


def fit_donning(recordings: Sequence[File]) -> CuffFit:
    """Fit stiffness [N/m], damping [N s/m] and migration [m] of one cuff from all trials of one donning.

    Bounce trials among them calibrate lag and gain of the load cell (SessionFit.bounces names those of a session);
    without one, the notes of the fit have note.not_calibrated. Raises SessionError if no trial can be used, or if the
    recordings are of several cuffs or donnings.
    """
    if isinstance(recordings, str | PathLike) or not isinstance(recordings, Iterable):
        raise TypeError(f"recordings should be a list of paths, and got a {type(recordings).__name__}")
    paths = [Path(path) for path in recordings]
    trials, rejected = read_trials(paths)
    if not trials:
        reasons = "; ".join(f"{trial.file}: {trial.reason}" for trial in rejected)
        reasons = reasons or ("there are only bounce trials; add the trials of a cuff" if paths else "none was given")
        raise SessionError(Message(FolderCode.NO_TRIAL_USABLE, {"reasons": reasons}))
    fitted = fit_trials(trials, rejected)
    found = [fit for fits in fitted.donnings.values() for fit in fits.values()]
    if len(found) > 1:
        named = ", ".join(f"{fit.name} ({fit.donning})" for fit in found)
        raise SessionError(Message(FolderCode.SEVERAL_DONNINGS, {"found": named}))
    return found[0]


def fit_session(folder: File) -> SessionFit:
    """Fit every cuff of a session folder by donning, with the decisions of the journal. Raises SessionError."""
    return fit_session_folder(Path(folder), None)
