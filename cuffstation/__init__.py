"""Measure how exosuit cuffs yield on a body, and what that does to the wearer's muscles.

    import cuffstation as cs

    cuffs = cs.fit_session("simulated/demo").cuffs           # stiffness, damping, migration with their uncertainty
    cs.plot(cs.assess(cuffs)).savefig("effort.png")   # muscle effort over the cord's rest length

The twelve functions below, the types of their results and the roots of their exceptions follow semantic versioning;
everything else may change. Units are SI from a trial on; a recording keeps the unit of its device in Stream.unit.
"""

from __future__ import annotations

from importlib.metadata import version

from drivers.errors import DeviceError
from fitting.cuffs.cuff_fit import CuffFit, SessionFit
from fitting.cuffs.cuffs_file import read_cuffs, write_cuffs
from fitting.cuffs.wearable_cuff import WearableCuff
from fitting.errors import FitError
from fitting.uncertainty import Estimate
from recordings.errors import RecordingError
from recordings.reader import Recording, Track
from solver.errors import SolverError
from solver.model import Model
from solver.motion import Kinematics
from solver.multibody.joint_reactions import ReactionRequest
from solver.redundancy.motion_solution import MotionSolution
from solver.redundancy.options import RedundancyOptions
from solver.redundancy.reserves import Reserve, with_reserves
from solver.stream.stream_frame import StreamFrame, StreamSuitFrame
from solver.stream.stream_solver import StreamSolver
from solver.suit.assessment import Assessment
from station.errors import StationError
from station.library import (
    assess,
    fit_donning,
    fit_session,
    load_model,
    load_motion,
    open_stream,
    read_recording,
    solve_motion,
)
from station.report.plot import plot

__version__ = version("cuffstation")

__all__ = [
    "Assessment",
    "CuffFit",
    "DeviceError",
    "Estimate",
    "FitError",
    "Kinematics",
    "Model",
    "MotionSolution",
    "ReactionRequest",
    "Recording",
    "RecordingError",
    "RedundancyOptions",
    "Reserve",
    "SessionFit",
    "SolverError",
    "StationError",
    "StreamFrame",
    "StreamSolver",
    "StreamSuitFrame",
    "Track",
    "WearableCuff",
    "assess",
    "fit_donning",
    "fit_session",
    "load_model",
    "load_motion",
    "open_stream",
    "plot",
    "read_cuffs",
    "read_recording",
    "solve_motion",
    "with_reserves",
    "write_cuffs",
]


def __dir__() -> list[str]:
    """The public names, which dir() and completion list."""
    return [*__all__, "__version__"]
