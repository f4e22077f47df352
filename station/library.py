"""What the public package offers beyond single functions of the folders below: files and results put together."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from fitting.result import CuffFit, SessionFit
from fitting.session import fit_session as fit_trials
from fitting.trial import read_trials
from fitting.wearable_cuff import WearableCuff
from recordings.reader import Recording, open_recording
from solver.model import Model
from solver.motion import Kinematics, decimate, differentiate
from solver.redundancy.motion import MotionSolution, RedundancyOptions
from solver.redundancy.motion import solve_motion as solve
from solver.suit.assessment import Assessment
from solver.suit.assessment import assess as assess_suit
from solver.suit.suit import BUNDLED_SUIT, read_suit
from station.assessment.assessment_inputs import worn_cuffs
from station.assessment.sources import BUNDLED, model_of, motion_of
from station.fit import SessionError, fit_session_folder

File = Path | str


def read_recording(path: File) -> Recording:
    """Read an MCAP recording through once: what it is, and what is missing from it.

    `recording.load("/force").to_dataframe()` gives the samples of one stream in Stream.unit. Raises RecordingError.
    """
    return open_recording(Path(path))


def fit_donning(recordings: Sequence[File]) -> CuffFit:
    """Fit stiffness [N/m], damping [N s/m] and migration [m] of one cuff from all trials of one donning.

    Bounce trials among them calibrate the lag of the load cell. Raises SessionError where no trial can be used, or the
    recordings are of several cuffs or donnings.
    """
    trials, rejected = read_trials([Path(path) for path in recordings])
    if not trials:
        reasons = "; ".join(f"{trial.file}: {trial.reason}" for trial in rejected) or "none was given"
        raise SessionError(f"no recording can be used: {reasons}")
    fitted = fit_trials(trials, rejected)
    found = [fit for fits in fitted.donnings.values() for fit in fits.values()]
    if len(found) > 1:
        named = ", ".join(f"{fit.name} ({fit.donning})" for fit in found)
        raise SessionError(f"expected recordings of one cuff in one donning, found {named}; fit the session instead")
    return found[0]


def fit_session(folder: File) -> SessionFit:
    """Fit every cuff of a session's folder, donning by donning, by its journal's decisions. Raises SessionError."""
    return fit_session_folder(Path(folder), None)


def load_model(source: File = BUNDLED) -> Model:
    """Read an OpenSim model (.osim), or the bundled thoracoscapular one. Raises ModelError."""
    return model_of(str(source))


def load_motion(model: Model, path: File | None = None, cutoff_hz: float | None = 3.0, every: int = 1) -> Kinematics:
    """Read a motion (.mot, .sto, .csv) and differentiate it; without a path, the bundled raise of the arm.

    cutoff_hz is that of the low-pass filter (Butterworth of order 4, forwards and backwards), None for no filter. Every
    `every`-th frame is kept. Raises MotionError.
    """
    recorded = motion_of(None if path is None else Path(path), model)
    return decimate(differentiate(recorded, cutoff_hz), every)


def solve_motion(model: Model, kinematics: Kinematics, options: RedundancyOptions | None = None) -> MotionSolution:
    """Solve the muscle-redundancy problem of every frame: activations, forces and the glenohumeral reaction.

    Equations: Belli et al. 2023 (solver/redundancy/motion.py). A frame that cannot be solved has its outcome and NaN.
    Raises ModelError, MotionError.
    """
    return solve(model, kinematics, options)


def assess(
    cuffs: Mapping[str, CuffFit | WearableCuff],
    model: Model | None = None,
    kinematics: Kinematics | None = None,
    suit: File = BUNDLED_SUIT,
    *,
    draws: int = 200,
    most_frames: int | None = None,
    options: RedundancyOptions | None = None,
) -> Assessment:
    """Wear the cuffs in the suit through a motion: effort over the rest length, rigid, shifted, yielding, and both.

    Without model and kinematics, the bundled ones. draws is how often the cuffs are drawn from the covariance of their
    fit; most_frames bounds the frames whose muscles are solved. Raises NotIdentified, ModelError, SuitError.
    """
    model = model or load_model()
    kinematics = kinematics or load_motion(model)
    every = 1 if most_frames is None else math.ceil(len(kinematics.time) / most_frames)
    fitted = {name: cuff.wearable() if isinstance(cuff, CuffFit) else cuff for name, cuff in cuffs.items()}
    worn = worn_cuffs(fitted, ())
    return assess_suit(model, kinematics, read_suit(Path(suit)), worn, every=every, draws=draws, options=options)
