"""Measure how exosuit cuffs yield on a body, and what that does to the wearer's muscles.

    import cuffstation as cs

    cuffs = cs.fit_session("simulated/demo").cuffs           # stiffness, damping, migration with their uncertainty
    cs.plot(cs.assess(cuffs)).savefig("effort.png")   # muscle effort over the cord's rest length

The functions below, the types of their results and the roots of their exceptions follow semantic versioning;
everything else may change. Units are SI from a trial on; a recording keeps the unit of its device in Stream.unit.

A name is imported at its first use (PEP 562), so that reading a recording loads neither SciPy nor the solver. A file of
the user in the place of one of our packages is named then.
"""

from __future__ import annotations

import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # for editors and type checkers, which do not run __getattr__
    from drivers.errors import DeviceError as DeviceError
    from fitting.cuffs.cuff_fit import CuffFit as CuffFit
    from fitting.cuffs.cuff_fit import SessionFit as SessionFit
    from fitting.cuffs.cuff_tables import published_cuffs as published_cuffs
    from fitting.cuffs.cuffs_file import read_cuffs as read_cuffs
    from fitting.cuffs.cuffs_file import write_cuffs as write_cuffs
    from fitting.cuffs.wearable_cuff import Cuff as Cuff
    from fitting.errors import FitError as FitError
    from fitting.uncertainty import Estimate as Estimate
    from recordings.errors import RecordingError as RecordingError
    from recordings.reader import Recording as Recording
    from recordings.reader import Track as Track
    from solver.errors import SolverError as SolverError
    from solver.model import Model as Model
    from solver.motion import Kinematics as Kinematics
    from solver.multibody.dynamics import ReactionRequest as ReactionRequest
    from solver.redundancy.effort import ActivationCost as ActivationCost
    from solver.redundancy.effort import RedundancyOptions as RedundancyOptions
    from solver.redundancy.effort import Reserve as Reserve
    from solver.redundancy.effort import with_reserves as with_reserves
    from solver.redundancy.motion_solution import MotionSolution as MotionSolution
    from solver.stream.stream_frame import StreamFrame as StreamFrame
    from solver.stream.stream_frame import StreamSuitFrame as StreamSuitFrame
    from solver.stream.stream_solver import StreamSolver as StreamSolver
    from solver.suit.assessment import Assessment as Assessment
    from station.errors import StationError as StationError
    from station.library import fit_donning as fit_donning
    from station.library import fit_session as fit_session
    from station.library import read_recording as read_recording
    from station.library import sample_session as sample_session
    from station.report.plot import plot as plot
    from station.solver_library import assess as assess
    from station.solver_library import load_model as load_model
    from station.solver_library import load_motion as load_motion
    from station.solver_library import open_stream as open_stream
    from station.solver_library import solve_motion as solve_motion

    __version__: str

_MODULES = {
    "ActivationCost": "solver.redundancy.effort",
    "Assessment": "solver.suit.assessment",
    "Cuff": "fitting.cuffs.wearable_cuff",
    "CuffFit": "fitting.cuffs.cuff_fit",
    "DeviceError": "drivers.errors",
    "Estimate": "fitting.uncertainty",
    "FitError": "fitting.errors",
    "Kinematics": "solver.motion",
    "Model": "solver.model",
    "MotionSolution": "solver.redundancy.motion_solution",
    "ReactionRequest": "solver.multibody.dynamics",
    "Recording": "recordings.reader",
    "RecordingError": "recordings.errors",
    "RedundancyOptions": "solver.redundancy.effort",
    "Reserve": "solver.redundancy.effort",
    "SessionFit": "fitting.cuffs.cuff_fit",
    "SolverError": "solver.errors",
    "StationError": "station.errors",
    "StreamFrame": "solver.stream.stream_frame",
    "StreamSolver": "solver.stream.stream_solver",
    "StreamSuitFrame": "solver.stream.stream_frame",
    "Track": "recordings.reader",
    "assess": "station.solver_library",
    "fit_donning": "station.library",
    "fit_session": "station.library",
    "load_model": "station.solver_library",
    "load_motion": "station.solver_library",
    "open_stream": "station.solver_library",
    "plot": "station.report.plot",
    "published_cuffs": "fitting.cuffs.cuff_tables",
    "read_cuffs": "fitting.cuffs.cuffs_file",
    "read_recording": "station.library",
    "sample_session": "station.library",
    "solve_motion": "station.solver_library",
    "with_reserves": "solver.redundancy.effort",
    "write_cuffs": "fitting.cuffs.cuffs_file",
}
"""Public name → the module that has it."""

_PACKAGES = ("documents", "drivers", "fitting", "recordings", "solver", "station")
__all__ = list(_MODULES)


def _ensure_own_packages() -> None:
    """Raise ImportError if Python finds a module of the user under the name of one of our packages."""
    for name in _PACKAGES:
        module = sys.modules.get(name)
        found = getattr(module, "__file__", None) if module else getattr(find_spec(name), "origin", None)
        if found is None or Path(found).resolve().parents[1] != Path(__file__).resolve().parents[1]:
            raise ImportError(
                f"cuffstation needs its own package {name}, and Python finds {found or 'none'} in its place; rename "
                "that file or folder, or run Python in another folder",
                name=name,
                path=found,
            )


if not TYPE_CHECKING:  # else a type checker accepts any name

    def __getattr__(name: str) -> object:
        if name == "__version__":
            from importlib.metadata import version

            value: object = version("cuffstation")
        elif name in _MODULES:
            _ensure_own_packages()
            value = getattr(import_module(_MODULES[name]), name)
        else:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        globals()[name] = value  # later uses do not come here
        return value


def __dir__() -> list[str]:
    """The public names, which dir() and completion list."""
    return [*__all__, "__version__"]
