"""Outcomes of the solver's compiled iterations, starved of rounds, as JSON: limit → outcomes that occur.

    NUMBA_DISABLE_JIT=1 python -m tests.solver.starved

Without its compiler numba leaves plain functions, whose limits can be changed one by one. They are slow: there is one
posture.
"""

import importlib
import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from solver.bundled import bundled_model
from solver.motion import Kinematics
from solver.multibody.postures import postures
from solver.muscle import PathMode, evaluate_paths, muscle_forces
from solver.redundancy import frames, interior_point
from solver.redundancy.motion_solution import solve_motion
from tests.solver.references import certified

MODEL = bundled_model()
Q, U = certified()["q"][:1], certified()["u"][:1]
STATE = postures(MODEL, Q, U)
MOTION = Kinematics(np.zeros(1), 0.01, Q, U, np.zeros_like(Q), None)


@contextmanager
def limited(limit: str, value: int) -> Iterator[None]:
    """The constant "module.NAME" at another value."""
    module, _, name = limit.rpartition(".")
    found = importlib.import_module(module)
    before = getattr(found, name)
    setattr(found, name, value)
    yield
    setattr(found, name, before)


def path_outcomes(mode: PathMode) -> list[str]:
    """Of the paths of all muscles."""
    return sorted(set(evaluate_paths(MODEL, STATE, mode=mode).outcomes.ravel()))


def opensim_outcomes() -> list[str]:
    return path_outcomes("opensim")


def geodesic_outcomes() -> list[str]:
    return path_outcomes("geodesic")


def curve_outcomes() -> list[str]:
    """Of the forces of all muscles at lengths between the nodes of their curves."""
    lengths = evaluate_paths(MODEL, STATE).lengths
    return sorted(set(muscle_forces(MODEL, lengths, np.full_like(lengths, 0.01)).outcomes.ravel()))


def frame_outcomes() -> list[str]:
    return sorted(set(solve_motion(MODEL, MOTION).outcomes))


def interior_point_outcomes() -> list[str]:
    """Of the interior-point method itself, which solves the frame if Newton's method is starved."""
    codes: set[int] = set()

    def recorded(*arguments: Any) -> int:
        code = interior_point.interior_point(*arguments)
        codes.add(code)
        return code

    frames.interior_point, whole = recorded, frames.interior_point
    with limited("solver.redundancy.frames.MOST_STEPS", 0):
        frame_outcomes()
    frames.interior_point = whole
    return [("solved", "infeasible", "not_converged")[code] for code in sorted(codes)]


LIMITS: dict[str, tuple[Callable[[], list[str]], int]] = {
    "solver.wrapping.ellipsoid.MOST_ITERATIONS": (opensim_outcomes, 1),
    "solver.wrapping.fan.MOST_ITERATIONS": (opensim_outcomes, 1),
    "solver.wrapping.wrapped_paths.MOST_SWEEPS": (opensim_outcomes, 1),
    "solver.wrapping.sphere_and_cylinder.MOST_ADJUSTMENTS": (opensim_outcomes, 1),
    "solver.geodesics.geodesic.MOST_STEPS": (geodesic_outcomes, 1),
    "solver.geodesics.shortest_path.MOST_STEPS": (geodesic_outcomes, 1),
    "solver.geodesics.geodesic_paths.MOST_ROUNDS": (geodesic_outcomes, 1),
    "solver.functions.bezier.NEWTON_STEPS": (curve_outcomes, 1),
    "solver.redundancy.frames.MOST_STEPS": (frame_outcomes, 0),
    "solver.redundancy.interior_point.MOST_STEPS": (interior_point_outcomes, 1),
}
"""Limit → the outcomes that depend on it, and a value that is too small."""


def main() -> None:
    found = {outcomes.__name__: outcomes() for outcomes, _ in LIMITS.values()}
    for limit, (outcomes, value) in LIMITS.items():
        with limited(limit, value):
            found[limit] = outcomes()
    print(json.dumps(found))


if __name__ == "__main__":
    main()
