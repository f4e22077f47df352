"""What is left out of a model, and what that changes in a motion: a note of the results and sentences on stderr."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.inverse_dynamics import inverse_dynamics
from solver.model import Model
from solver.motion import Kinematics
from solver.multibody.external_loads import ExternalForce
from solver.redundancy.left_out import forces_of, reserve_forces
from solver.redundancy.motion import MotionSolution

Array = NDArray[np.float64]

MOST_NAMED = 3
LEAST_SHARE = 0.01


@dataclass(frozen=True)
class LeftOutEffect:
    """Root mean squares over the solved frames [N m, N for a translation], by the name of a coordinate.

    loads     of each force that was left out on request and can be computed: its generalised force
    reserves  (of reserve actuators, needed by inverse dynamics) where the solver lacks forces
    """

    loads: Mapping[str, Mapping[str, float]]
    reserves: Mapping[str, tuple[float, float]]

    def note(self) -> str:
        """JSON, in one line; "none" if nothing is known to change."""
        parts = {"loads": self.loads, "reserve_and_needed": self.reserves}
        known = {name: part for name, part in parts.items() if part}
        return json.dumps(known) if known else "none"


NOTHING_LEFT_OUT = LeftOutEffect({}, {})


def effect_of(
    model: Model,
    without: Model,
    names: Sequence[str],
    kinematics: Kinematics,
    loads: Sequence[ExternalForce],
    solution: MotionSolution,
) -> LeftOutEffect:
    """The forces `names` of the model are not in `without`, which was solved in the motion under the loads."""
    is_solved = np.isfinite(solution.reserves).all(axis=1)
    known = {name: forces_of(model, kinematics, name)[is_solved] for name in names}
    reserves: dict[str, tuple[float, float]] = {}
    if without.lacking:
        given = _rms(reserve_forces(without, solution.reserves)[is_solved])
        needed = _rms(inverse_dynamics(without, kinematics, loads)[is_solved])
        share = given / _greatest_of_its_unit(model, np.maximum(given, needed))
        order = [k for k in np.argsort(-share) if share[k] > LEAST_SHARE]
        reserves = {model.coordinate_names[k]: (float(given[k]), float(needed[k])) for k in order}
    return LeftOutEffect({name: _largest(model, forces) for name, forces in known.items()}, reserves)


def describe_left_out(model: Model, effect: LeftOutEffect) -> list[str]:
    """Sentences on what is left out; none if nothing is."""
    if not model.left_out:
        return []
    sentences = [f"Left out of the model: {', '.join(model.left_out)}."]
    for name, forces in effect.loads.items():
        parts = [f"{rms:.3g} {_unit(model, coordinate)} at {coordinate}" for coordinate, rms in forces.items()]
        sentences.append(f"{name} would give {_listed(parts)} (RMS)." if parts else f"{name} gives nothing here.")
    if model.lacking:
        parts = [
            f"{given:.3g} of {needed:.3g} {_unit(model, coordinate)} at {coordinate}"
            for coordinate, (given, needed) in effect.reserves.items()
        ]
        reserves = (
            f"reserves give {_listed(parts)} (RMS, of what the motion needs)" if parts else "reserves give nothing"
        )
        sentences.append(f"Muscles and reserves carry the loads of {', '.join(model.lacking)}; {reserves}.")
    return [" ".join(sentences)]


def _rms(forces: Array) -> Array:
    """(coordinates,) over the frames; zero without frames."""
    found: Array = np.sqrt((forces**2).mean(axis=0)) if len(forces) else np.zeros(forces.shape[1])
    return found


def _greatest_of_its_unit(model: Model, sizes: Array) -> Array:
    """(coordinates,) the greatest size among the coordinates with the same unit, so that shares can be compared."""
    motions = np.array([coordinate.motion for coordinate in model.coordinates])
    return np.array([max(sizes[motions == motion].max(), 1e-9) for motion in motions])


def _largest(model: Model, forces: Array) -> dict[str, float]:
    """By coordinate, the greatest first, down to a hundredth of it."""
    rms = _rms(forces)
    kept = [k for k in np.argsort(-rms) if rms[k] > LEAST_SHARE * rms.max(initial=0.0)]
    return {model.coordinate_names[k]: float(rms[k]) for k in kept}


def _unit(model: Model, coordinate: str) -> str:
    motion = model.coordinates[model.coordinate_index(coordinate)].motion
    return {"rotation": "N m", "translation": "N", "coupled": "N m or N"}[motion]


def _listed(parts: list[str]) -> str:
    more = f" and less at {len(parts) - MOST_NAMED} more" if len(parts) > MOST_NAMED else ""
    return ", ".join(parts[:MOST_NAMED]) + more
