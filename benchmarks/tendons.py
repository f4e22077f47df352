"""Rigid beside elastic tendons in the redundancy problem, and the elastic forces beside OpenSim's: docs/tendons.md.

    python -m benchmarks.tendons [--model M.osim --motion Q.mot --external-loads GRF.xml] [--cutoff-hz 6] [--every 1]

By default the bundled arm raise. Each coordinate without an actuator has a reserve: 500 N or N m at the pelvis, 10 N m
or N elsewhere, of weight 1. Printed are the processor time of a frame, the ratio, and the muscles whose activations
differ most. With OpenSim installed (extra `oracle`) and --model, its muscles are integrated forwards at the elastic
activations (linear between frames) in the same motion (cubic splines) from the same first fibre lengths, by SciPy's
Radau method, and their tendon forces compared with ours.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.optimize import OptimizeResult

from solver.model import Model
from solver.motion import Kinematics
from solver.multibody.constraints import is_held
from solver.redundancy.motion import solve_motion
from solver.redundancy.motion_solution import MotionSolution
from solver.redundancy.options import RedundancyOptions, Tendons, options_for
from solver.redundancy.reserves import Reserve, with_reserves
from station.assessment.given_motion import GivenMotion, MotionCut, MuscleInputs, read_given_motion

Array = NDArray[np.float64]
SHOWN = 8
PELVIS_RESERVE, JOINT_RESERVE = 500.0, 10.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--model", default="bundled")
    parser.add_argument("--motion", type=Path)
    parser.add_argument("--external-loads", type=Path)
    parser.add_argument("--cutoff-hz", type=float, default=3.0)
    parser.add_argument("--from", dest="start", type=float)
    parser.add_argument("--to", dest="end", type=float)
    parser.add_argument("--every", type=int, default=1)
    arguments = parser.parse_args()
    inputs = MuscleInputs(arguments.motion, arguments.model, arguments.external_loads)
    cut = MotionCut(arguments.cutoff_hz or None, arguments.start, arguments.end, arguments.every)
    given = read_given_motion(inputs, cut)
    model = given.model if arguments.model == "bundled" else reserved(given.model)
    reserve_weight = 10.0 if arguments.model == "bundled" else 1.0
    rigid, rigid_time = solved(model, given, "rigid", reserve_weight)
    elastic, elastic_time = solved(model, given, "elastic", reserve_weight)
    print(f"{len(rigid.time)} frames, {len(model.muscles)} muscles; not solved: {rigid.unsolved}, {elastic.unsolved}")
    print(f"rigid {rigid_time:.0f} µs a frame, elastic {elastic_time:.0f} µs, ratio {elastic_time / rigid_time:.1f}")
    print_differences(model, rigid, elastic)
    if arguments.model != "bundled":
        compare_with_opensim(Path(arguments.model), model, given.kinematics, elastic)


def reserved(model: Model) -> Model:
    """With reserves on all coordinates that have no actuator and that no constraint holds."""
    driven = {getattr(actuator, "coordinate", None) for actuator in model.actuators}
    free = [
        name
        for index, (name, held) in enumerate(zip(model.coordinate_names, is_held(model), strict=True))
        if index not in driven and not held
    ]
    return with_reserves(
        model, {name: Reserve(PELVIS_RESERVE if name.startswith("pelvis") else JOINT_RESERVE) for name in free}
    )


def solved(model: Model, given: GivenMotion, tendons: Tendons, reserve_weight: float) -> tuple[MotionSolution, float]:
    """The solution, and its processor time per frame [µs] in a second run."""
    options = options_for(model, RedundancyOptions(tendons=tendons, reserve_weight=reserve_weight))
    for _ in range(2):  # the first one compiles
        start = process_time()
        solution = solve_motion(model, given.kinematics, options, loads=given.loads)
        seconds = process_time() - start
    return solution, 1e6 * seconds / len(solution.time)


def print_differences(model: Model, rigid: MotionSolution, elastic: MotionSolution) -> None:
    """A Markdown table of the muscles whose activations differ most, in the frames that both solve."""
    known = np.isfinite(rigid.effort) & np.isfinite(elastic.effort)
    both = [(solution.activations[known], solution.muscle_forces[known]) for solution in (rigid, elastic)]
    (a, force), (elastic_a, elastic_force) = both
    strength = np.array([muscle.max_isometric_force for muscle in model.muscles])
    change, change_of_force = _rms(elastic_a - a), _rms(elastic_force - force)
    reaction = [np.linalg.norm(solution.reaction[known, 3:], axis=1) for solution in (rigid, elastic)]
    print(
        f"RMS difference over all muscles: activation {_rms(change):.4f}, force {_rms(change_of_force / strength):.4f} "
        f"of the strength; joint reaction {_rms(reaction[1] - reaction[0]):.1f} N, peak {reaction[0].max():.0f} N"
    )
    print("| muscle | slack / optimal length | peak strain | activation rigid, elastic | RMS difference | force [N] |")
    print("|---|---|---|---|---|---|")
    fibers = elastic.fibers
    assert fibers is not None  # noqa: S101 (elastic solutions have them)
    for i in np.argsort(-change)[:SHOWN]:
        muscle = model.muscles[i]
        strain = f"{100 * np.max(fibers.tendon_strain[known, i]):.1f} %" if i in fibers.elastic else "rigid"
        print(
            f"| {muscle.name} | {muscle.tendon_slack_length / muscle.optimal_fiber_length:.1f} | {strain} "
            f"| {a[:, i].max():.2f}, {elastic_a[:, i].max():.2f} "
            f"| {change[i]:.3f} | {force[:, i].max():.0f}, {elastic_force[:, i].max():.0f} |"
        )


def compare_with_opensim(path: Path, model: Model, kinematics: Kinematics, elastic: MotionSolution) -> None:
    """Print the differences of tendon forces over the strength, after the first tenth of the motion."""
    try:
        import opensim
    except ImportError:
        return
    from scipy.integrate import solve_ivp
    from scipy.sparse import eye_array

    fibers = elastic.fibers
    if fibers is None or not np.isfinite(elastic.activations).all():
        print("no comparison with OpenSim: not all frames are solved")
        return
    opensim.Logger.setLevelString("off")
    chosen, time = fibers.elastic, kinematics.time
    muscles = OpenSimMuscles(opensim, path, [model.muscle_names[i] for i in chosen])
    positions, names = CubicSpline(time, kinematics.positions), model.coordinate_names
    activations = elastic.activations[:, chosen]

    def velocities(t: float, lengths: Array) -> Array:
        a = np.array([np.interp(t, time, column) for column in activations.T])
        return muscles.evaluate(names, positions(t), positions(t, 1), a, lengths)[0]

    found: OptimizeResult = solve_ivp(
        velocities,
        (time[0], time[-1]),
        fibers.fiber_lengths[0, chosen],
        method="Radau",
        t_eval=time,
        rtol=1e-5,
        atol=1e-8,
        jac_sparsity=eye_array(len(chosen)),
    )
    states = zip(time, activations, found.y.T, strict=True)
    theirs = np.array([muscles.evaluate(names, positions(t), positions(t, 1), a, y)[1] for t, a, y in states])
    strength = np.array([model.muscles[i].max_isometric_force for i in chosen])
    settled = slice(len(time) // 10, None)
    difference = ((elastic.muscle_forces[:, chosen] - theirs) / strength)[settled]
    worst = int(np.argmax(_rms(difference)))
    print(
        f"tendon forces beside OpenSim's over the strength: RMS {_rms(difference.ravel()):.1e}, largest "
        f"{np.abs(difference).max():.1e}; the worst muscle {model.muscle_names[chosen[worst]]}, RMS "
        f"{_rms(difference)[worst]:.1e}"
    )


class OpenSimMuscles:
    """OpenSim's muscles by name, at given postures, activations and fibre lengths."""

    def __init__(self, opensim: Any, path: Path, names: list[str]) -> None:
        self._model = opensim.Model(str(path))
        self._state = self._model.initSystem()
        self._muscles = [self._model.getMuscles().get(name) for name in names]
        self._paths = [f"{muscle.getAbsolutePathString()}/fiber_length" for muscle in self._muscles]

    def evaluate(
        self, names: tuple[str, ...], positions: Array, speeds: Array, activations: Array, lengths: Array
    ) -> tuple[Array, Array]:
        """Fibre velocities [m/s] and tendon forces [N]."""
        state, coordinates = self._state, self._model.getCoordinateSet()
        for name, q, u in zip(names, positions, speeds, strict=True):
            coordinate = coordinates.get(name)
            if not coordinate.getLocked(state):
                coordinate.setValue(state, float(q), False)
                coordinate.setSpeedValue(state, float(u))
        for muscle, path, a, length in zip(self._muscles, self._paths, activations, lengths, strict=True):
            muscle.setActivation(state, float(a))
            self._model.setStateVariableValue(state, path, float(length))
        self._model.realizeDynamics(state)
        values = [(muscle.getFiberVelocity(state), muscle.getTendonForce(state)) for muscle in self._muscles]
        velocities, forces = np.array(values).T
        return velocities, forces


def _rms(values: Array) -> Any:
    return np.sqrt(np.mean(values**2, axis=0))


if __name__ == "__main__":
    main()
