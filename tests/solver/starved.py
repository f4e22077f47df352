"""Outcomes of the solver's compiled iterations, starved of rounds, as JSON: limit → outcomes that occur.

    NUMBA_DISABLE_JIT=1 python -m tests.solver.starved

Without its compiler numba leaves plain functions, whose limits can be changed one by one.
"""

from __future__ import annotations

import importlib
import json
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from solver.bundled import bundled_model
from solver.motion import decimate, differentiate
from solver.multibody.postures import postures
from solver.paths import PathMode, evaluate_paths
from solver.raise_arm import simulate_arm_raise
from solver.redundancy import frames, interior_point
from solver.redundancy.motion import solve_motion

MODEL = bundled_model()
MOTION = decimate(differentiate(simulate_arm_raise(MODEL)), 150)
LIMITS: tuple[tuple[PathMode, str, str, int], ...] = (
    ("opensim", "solver.wrapping.tangent", "MOST_ITERATIONS", 1),
    ("opensim", "solver.wrapping.closest", "MOST_ITERATIONS", 1),
    ("opensim", "solver.wrapping.opensim_path", "MOST_SWEEPS", 1),
    ("opensim", "solver.wrapping.cylinder", "MOST_ADJUSTMENTS", 1),
    ("geodesic", "solver.geodesics.shortest_path", "MOST_STEPS", 1),
    ("geodesic", "solver.geodesics.contact_order", "MOST_ROUNDS", 1),
)


@contextmanager
def limited(module: str, name: str, limit: int) -> Iterator[None]:
    """The constant of the module at another value."""
    found = importlib.import_module(module)
    before = getattr(found, name)
    setattr(found, name, limit)
    yield
    setattr(found, name, before)


def path_outcomes(mode: PathMode) -> list[str]:
    """Outcomes that occur among all paths of the motion."""
    state = postures(MODEL, MOTION.positions, MOTION.speeds)
    return sorted(set(evaluate_paths(MODEL, state, mode=mode).outcomes.ravel().tolist()))


def frame_outcomes() -> list[str]:
    """Outcomes that occur among the frames of the motion."""
    return sorted({outcome.name for outcome in np.ravel(solve_motion(MODEL, MOTION).outcomes)})


def interior_point_outcomes() -> list[str]:
    """Outcomes of the interior point itself, which Newton's method asks for where it is starved."""
    codes: set[int] = set()

    def recorded(*arguments: Any) -> int:
        code = interior_point.interior_point(*arguments)
        codes.add(code)
        return code

    frames.interior_point, whole = recorded, frames.interior_point
    with limited("solver.redundancy.newton", "MOST_STEPS", 0):
        frame_outcomes()
    frames.interior_point = whole
    return [("solved", "infeasible", "not_converged")[code] for code in sorted(codes)]


def main() -> None:
    found = {
        "opensim": path_outcomes("opensim"),
        "geodesic": path_outcomes("geodesic"),
        "frames": frame_outcomes(),
        "interior_point": interior_point_outcomes(),
    }
    for mode, module, name, limit in LIMITS:
        with limited(module, name, limit):
            found[f"{module}.{name}"] = path_outcomes(mode)
    with limited("solver.redundancy.newton", "MOST_STEPS", 0):
        found["solver.redundancy.newton.MOST_STEPS"] = frame_outcomes()
    with limited("solver.redundancy.interior_point", "MOST_STEPS", 1):
        found["solver.redundancy.interior_point.MOST_STEPS"] = interior_point_outcomes()
    print(json.dumps(found))


if __name__ == "__main__":
    main()
