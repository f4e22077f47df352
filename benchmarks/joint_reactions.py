"""Compare joint reactions with OpenSim's JointReaction, for the muscle and reserve forces of a solved motion.

    python -m benchmarks.joint_reactions MODEL MOTION LOADS [EVERY [FROM TO]]

solves every N-th frame of the motion under the external loads, with a reserve on every coordinate, applies the same
forces in OpenSim at the same positions and speeds, and prints the greatest difference of moment and force of every
joint over their greatest value, on child and parent and in all axes. Needs the extra oracle.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any, get_args

import numpy as np
import opensim

from solver.model import CoordinateActuator, Model
from solver.motion import Kinematics, decimate, differentiate, read_motion
from solver.multibody.joint_reactions import Axes, JointReactions, ReactionRequest, Side
from solver.multibody.postures import speeds_from_rates
from solver.osim.loads import read_external_loads
from solver.osim.reader import read_osim
from solver.redundancy.mechanics import evaluate_motion
from solver.redundancy.motion import solve_motion
from solver.redundancy.motion_solution import MotionSolution
from solver.redundancy.options import RedundancyOptions, options_for
from solver.redundancy.reactions import SolvedForces, solved_reactions
from solver.redundancy.reserves import Reserve, with_reserves

RESERVE = 100.0  # N m or N at a control of 1


def main(
    file: Path, motion: Path, loads_file: Path, every: int = 10, start: float | None = None, end: float | None = None
) -> None:
    opensim.Logger.setLevelString("error")
    bare = read_osim(file, ignore_forces=True)
    model = with_reserves(bare, dict.fromkeys(bare.coordinate_names, Reserve(RESERVE)))
    whole = differentiate(read_motion(motion, model), 6.0, start, end)
    kinematics = decimate(whole, every)
    loads = read_external_loads(loads_file, model, kinematics.time)
    solution = solve_motion(model, kinematics, options_for(model, RedundancyOptions()), loads=loads)
    mechanics = evaluate_motion(model, kinematics, loads=loads, joint=model.joints[0].name)
    solved = SolvedForces(solution.muscle_forces, solution.reserves, loads)
    names = tuple(joint.name for joint in model.joints)
    found = {
        (side, axes): solved_reactions(model, mechanics, solved, ReactionRequest(names, side, axes))
        for side in get_args(Side)
        for axes in get_args(Axes)
    }
    worst = differences(model, kinematics, solution, found, osim_with(file, model, loads_file))
    print(f"{file.name}: {len(kinematics.time)} frames, {solution.unsolved} not solved, {len(names)} joints")
    for name, (moment, force, largest) in zip(names, worst, strict=True):
        print(f"  {name:20} moment {moment:.0e}  force {force:.0e}  of up to {largest:.0f} N")


def osim_with(file: Path, model: Model, loads_file: Path) -> Any:
    """OpenSim's model with its own loads and the reserves; forces that the solver left out are switched off."""
    osim, named = opensim.Model(str(file)), {*model.muscle_names, *(actuator.name for actuator in model.actuators)}
    for index in range(osim.getForceSet().getSize()):
        force = osim.getForceSet().get(index)
        if force.getName() not in named and force.getConcreteClassName().endswith("Actuator"):
            force.set_appliesForce(False)
    for actuator in model.actuators:
        if not isinstance(actuator, CoordinateActuator):
            continue
        added = opensim.CoordinateActuator(model.coordinate_names[actuator.coordinate])
        added.setName(actuator.name)
        added.setOptimalForce(actuator.optimal_force)
        added.thisown = False
        osim.addForce(added)
    loads = opensim.ExternalLoads(str(loads_file), True)
    loads.thisown = False
    osim.addModelComponent(loads)
    return osim


def differences(
    model: Model,
    kinematics: Kinematics,
    solution: MotionSolution,
    found: dict[tuple[str, str], JointReactions],
    osim: Any,
) -> list[tuple[float, float, float]]:
    """Greatest relative difference of moment and force, and the greatest force [N], of every joint."""
    expected = {key: np.empty((*part.force.shape[:2], 2, 3)) for key, part in found.items()}
    state = osim.initSystem()
    speeds = speeds_from_rates(model, kinematics.positions, kinematics.speeds)
    forces = np.concatenate([solution.muscle_forces, solution.reserves], axis=1)
    names = [*model.muscle_names, *(actuator.name for actuator in model.actuators)]
    for name in names:
        scalar(osim, name).overrideActuation(state, True)
    for frame, time in enumerate(kinematics.time):
        state.setTime(float(time))
        for name, q, u in zip(model.coordinate_names, kinematics.positions[frame], speeds[frame], strict=True):
            coordinate = osim.getCoordinateSet().get(name)
            if not coordinate.getLocked(state):
                coordinate.setValue(state, float(q), False)
                coordinate.setSpeedValue(state, float(u))
        for name, force in zip(names, forces[frame], strict=True):
            scalar(osim, name).setOverrideActuation(state, float(force))
        osim.realizeAcceleration(state)
        for (side, axes), values in expected.items():
            for place, joint in enumerate(model.joints):
                values[frame, place] = reaction(osim, osim.getJointSet().get(joint.name), state, side, axes)
    worst = []
    for place in range(len(model.joints)):
        parts = []
        for part, name in enumerate(("moment", "force")):
            largest = max(np.abs(values[:, place, part]).max() for values in expected.values())
            off = max(np.abs(getattr(found[k], name) - v[:, :, part])[:, place].max() for k, v in expected.items())
            parts.append((off / max(largest, 1.0), largest))
        worst.append((parts[0][0], parts[1][0], parts[1][1]))
    return worst


def reaction(osim: Any, joint: Any, state: Any, side: str, axes: str) -> list[Any]:
    of_side = {
        "child": joint.calcReactionOnChildExpressedInGround,
        "parent": joint.calcReactionOnParentExpressedInGround,
    }
    frames = {"ground": osim.getGround(), "child": joint.getChildFrame(), "parent": joint.getParentFrame()}
    given, seen = of_side[side](state), frames[axes].findBaseFrame()
    return [osim.getGround().expressVectorInAnotherFrame(state, given.get(k), seen).to_numpy() for k in (0, 1)]


def scalar(osim: Any, name: str) -> Any:
    return opensim.ScalarActuator.safeDownCast(osim.getForceSet().get(name))


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:4]), *map(int, sys.argv[4:5]), *map(float, sys.argv[5:]))
