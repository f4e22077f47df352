"""Functions of the public package that read and fit recordings. Those that solve are in solver_library.py.

The sample session is a bounce, a static and a dynamic trial of the hand cuff, on simulated devices. Its three
recordings in station/sample_session are those of `python -m tests.house.one_cuff FOLDER --sample`.
"""

from __future__ import annotations

import filecmp
import os
import shutil
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib.metadata import version
from numbers import Real
from os import PathLike
from pathlib import Path

from documents.message import Message
from documents.regular_file import ensure_path, replaced
from fitting.cuffs.cuff_fit import CuffFit, SessionFit
from fitting.session import fit_session as fit_trials
from fitting.trial.trial import Trial, TrialReading, read_alone, read_protocol, read_trials, within
from recordings.reader import Recording, open_recording
from station.fit import SessionError, fit_session_folder
from station.fit import read_recording as read_assigned
from station.messages.setup_messages import FolderCode
from station.recordings_of_session import pulls_in

File = Path | str
Window = tuple[float, float] | Mapping[str, tuple[float, float]]
RECORDINGS = Path(__file__).with_name("sample_session")


def read_recording(path: File) -> Recording:
    """Read an MCAP recording: its manifest, streams and losses.

    `recording.load("/force").to_dataframe()` gives the samples of one stream in Stream.unit. Raises RecordingError.
    """
    return open_recording(ensure_path("path", path))


def fit_donning(recordings: Sequence[File], *, window: Window | None = None) -> CuffFit:
    """Fit stiffness [N/m], damping [N s/m] and migration [m] of one cuff from all trials of one donning.

    window: as in fit_session.

    Bounce trials among them calibrate lag and gain of the load cell (SessionFit.bounces names those of a session);
    without one, the notes of the fit have note.not_calibrated. Raises SessionError if no trial can be used, or if the
    recordings are of several cuffs or donnings.
    """
    if isinstance(recordings, str | PathLike) or not isinstance(recordings, Iterable):
        raise TypeError(f"recordings should be a list of paths, and got a {type(recordings).__name__}")
    paths = [ensure_path("recordings", path) for path in recordings]
    windowed = _windowed(paths, window, lambda path: read_alone(path, read_protocol(path.parent)))
    trials, rejected = read_trials(paths, windowed)
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


def fit_session(folder: File, *, window: Window | None = None) -> SessionFit:
    """Fit every cuff of a session folder by donning, with the decisions of the journal. Raises SessionError.

    window: start and end [s after the sync edge] of the part of every trial that is used, or file name → start and end;
    its trials have a note on it. Zero drift and losses are those of the part; the clocks are aligned by the whole
    capture, and a bounce calibrates as a whole. Raises ValueError for a window outside of the trial.
    """
    folder = ensure_path("folder", folder)
    return fit_session_folder(folder, None, readings=_windowed(pulls_in(folder), window, read_assigned))


def _windowed(
    paths: Sequence[Path], window: Window | None, read: Callable[[Path], TrialReading]
) -> dict[str, TrialReading]:
    """File name → the part of a trial in its window. Raises ValueError for a window of no recording."""
    if window is None:
        return {}
    for part in window.values() if isinstance(window, Mapping) else [window]:
        if not isinstance(part, tuple | list) or len(part) != 2 or not all(isinstance(end, Real) for end in part):
            raise TypeError(f"window should be start and end, or file name → both, and got a {type(part).__name__}")
    windows = window if isinstance(window, Mapping) else {path.name: window for path in paths}
    if unknown := sorted(set(windows) - {path.name for path in paths}):
        raise ValueError(f"window names {unknown[0]}, expected the name of one of the recordings; correct it")
    readings = {path.name: read(path) for path in paths if path.name in windows}
    return {
        name: within(reading, *windows[name])
        for name, reading in readings.items()
        if isinstance(reading, Trial)  # a bounce calibrates as a whole
    }


def sample_session() -> Path:
    """A session folder to try things on, in the user's cache: its recordings are restored, other files may be changed.

    Its hand cuff has k = 8520 N/m, c = 210 N s/m and a migration of 12.0 mm; devices and wearer are simulated. Raises
    OSError where the cache cannot be written.
    """
    folder = _cache() / "cuffstation" / version("cuffstation") / "simulated" / "sample"
    for source in sorted(RECORDINGS.glob("*.mcap")):
        kept = folder / source.name
        if not kept.is_file() or not filecmp.cmp(source, kept, shallow=False):
            with replaced(kept) as draft:
                shutil.copyfile(source, draft)
    return folder


def _cache() -> Path:
    """The folder in which programs of this user keep what they can make again."""
    named = os.environ.get("LOCALAPPDATA" if sys.platform == "win32" else "XDG_CACHE_HOME")
    if named and Path(named).is_absolute():
        return Path(named)
    return Path.home() / ("Library/Caches" if sys.platform == "darwin" else ".cache")
