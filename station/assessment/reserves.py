"""Share of reserve actuators in the generalised forces of a motion, by coordinate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from documents.message import Figures, Message
from solver.model import Array, AxisMotion, BallMotion, Model
from solver.motion import Kinematics
from solver.multibody.body_tables import pack_bodies
from solver.multibody.dynamics import inverse_dynamics
from solver.multibody.loads import ExternalForce
from solver.redundancy.effort import UNWEIGHTED_COORDINATES, RedundancyOptions, effort_weights, tracked_coordinates
from solver.redundancy.mechanics import actuator_forces
from solver.redundancy.motion_solution import MotionSolution
from station.messages.assessment_messages import AssessmentCode

ReserveShares = Mapping[str, tuple[float, float]]
"""Coordinate → root mean squares over the solved frames of the force of actuators, and of that needed [N m, N]."""

LARGE_RESERVES = 0.1
"""Share of reserves in the RMS force that a motion needs, above which muscles do not explain it (the published motions
need less than 0.01). OpenSim's guide "Reserves and Residuals" has it for peaks.
"""
LARGE_RESIDUALS = 0.1
"""Share of the weight of the model above which residuals carry the body in place of measured loads. OpenSim's guide
allows peaks of 5 % of the greatest net external force; RMS residuals of gait2392 in its public walk are 4 %.
"""
LEAST_SHARE = 0.01
"""Of the greatest force with the same unit: less is not reported."""
MOST_NAMED = 3


def reserve_shares(
    model: Model, kinematics: Kinematics, loads: Sequence[ExternalForce], solution: MotionSolution
) -> ReserveShares:
    """By coordinate where actuators give more than LEAST_SHARE, the greatest share of its unit first."""
    is_solved = np.isfinite(solution.reserves).all(axis=1)
    given = rms(actuator_forces(model, kinematics, solution.reserves)[is_solved])
    needed = rms(inverse_dynamics(model, kinematics, loads)[is_solved])
    share = given / _greatest_of_its_unit(model, np.maximum(given, needed))
    order = [k for k in np.argsort(-share) if share[k] > LEAST_SHARE]
    return {model.coordinate_names[k]: (float(given[k]), float(needed[k])) for k in order}


def large_reserves(model: Model, options: RedundancyOptions, shares: ReserveShares) -> ReserveShares:
    """The shares above LARGE_RESERVES of the force needed, where muscles should give it.

    They should at a tracked coordinate that a muscle crosses and whose actuators have a weight. So residuals of a
    pelvis are not counted, nor arms without muscles, nor the actuators that carry thorax and forearm.
    """
    is_muscles = _is_crossed(model) & _is_counted(model, options)
    return {
        name: (given, needed)
        for name, (given, needed) in shares.items()
        if given > LARGE_RESERVES * needed and is_muscles[model.coordinate_index(name)]
    }


def large_residuals(
    model: Model, options: RedundancyOptions, shares: ReserveShares, *, has_external_loads: bool
) -> ReserveShares:
    """Coordinate → RMS residual force and weight of the model [N], where the first is above LARGE_RESIDUALS.

    Residuals are forces of actuators at coordinates that move a part of the model along a line and that no muscle
    crosses, such as pelvis_ty. Those of the bundled model's thorax stand for a seat. Actuators without a weight stand
    for a part that the model lacks, such as a trunk, if external loads are given; otherwise they may hide that the
    loads were forgotten.
    """
    is_counted = _is_counted(model, options) if has_external_loads else tracked_coordinates(model, options)
    is_residual = ~_is_crossed(model) & is_counted
    is_residual &= [coordinate_unit(model, index) == "N" for index in range(len(model.coordinates))]
    weight = float(sum(body.mass for body in model.bodies) * np.linalg.norm(model.gravity))
    return {
        name: (given, weight)
        for name, (given, _) in shares.items()
        if given > LARGE_RESIDUALS * weight
        and is_residual[model.coordinate_index(name)]
        and name not in UNWEIGHTED_COORDINATES
    }


def reserve_findings(model: Model, large: ReserveShares, residuals: ReserveShares) -> list[Message[AssessmentCode]]:
    """One that names the coordinates of large reserves, one that names those of large residuals."""
    found = []
    if large:
        figures: Figures = {"shares": shares_text(model, large), "percent": 100 * LARGE_RESERVES}
        found.append(Message(AssessmentCode.RESERVES_LARGE_AT, figures))
    if residuals:
        (weight,) = {weight for _, weight in residuals.values()}
        forces = listed([f"{given:.3g} N at {name}" for name, (given, _) in residuals.items()])
        found.append(Message(AssessmentCode.RESIDUALS_LARGE, {"forces": forces, "weight": weight}))
    return found


def shares_text(model: Model, shares: ReserveShares) -> str:
    """Such as "4.1 of 35 N m at knee_angle_r (RMS, of what the motion needs)"."""
    parts = [
        f"{given:.3g} of {needed:.3g} {coordinate_unit(model, model.coordinate_index(coordinate))} at {coordinate}"
        for coordinate, (given, needed) in shares.items()
    ]
    return f"{listed(parts)} (RMS, of what the motion needs)"


def listed(parts: Sequence[str]) -> str:
    """The first MOST_NAMED, and the number of the others."""
    more = f" and smaller ones at {len(parts) - MOST_NAMED} more" if len(parts) > MOST_NAMED else ""
    return ", ".join(parts[:MOST_NAMED]) + more


def rms(forces: Array) -> Array:
    """(coordinates,) over the frames; zero without frames."""
    found: Array = np.sqrt((forces**2).mean(axis=0)) if len(forces) else np.zeros(forces.shape[1])
    return found


def coordinate_unit(model: Model, coordinate: int) -> str:
    """Unit of a generalised force: N for a coordinate that drives translations only, otherwise N m."""
    motion = next(joint.motion for joint in model.joints if coordinate in joint.motion.coordinates)
    if isinstance(motion, AxisMotion):
        return "N m" if coordinate in motion.coordinate[:3] else "N"
    return "N" if isinstance(motion, BallMotion) and coordinate in motion.sliding else "N m"


def _greatest_of_its_unit(model: Model, sizes: Array) -> Array:
    """(coordinates,) the greatest size among the coordinates with the same unit, so that shares can be compared."""
    units = np.array([coordinate_unit(model, coordinate) for coordinate in range(len(sizes))])
    return np.array([max(sizes[units == unit].max(), 1e-9) for unit in units])


def _is_counted(model: Model, options: RedundancyOptions) -> NDArray[np.bool_]:
    """(coordinates,) whether the acceleration is tracked, and the coordinate's own actuator, if any, has a weight."""
    is_counted = tracked_coordinates(model, options)
    weights = effort_weights(model, options)[len(model.muscles) :]
    free = [name for name, weight in zip(model.actuated_names, weights, strict=True) if weight == 0.0]
    names = set(free) & set(model.coordinate_names)
    is_counted[[model.coordinate_index(name) for name in names]] = False
    return is_counted


def _is_crossed(model: Model) -> NDArray[np.bool_]:
    """(coordinates,) whether the points of a muscle lie on both sides of the coordinate's joint."""
    moves = pack_bodies(model).moves.astype(bool)
    is_crossed = np.zeros(len(model.coordinates), dtype=bool)
    for muscle in model.muscles:
        moved = moves[[point.body for point in muscle.path.points]]
        is_crossed |= moved.any(axis=0) & ~moved.all(axis=0)
    return is_crossed
