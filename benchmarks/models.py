"""Public OpenSim models: which are accepted, parity with OpenSim, and time: the table of docs/osim-files.md.

    python -m benchmarks.models FOLDER… [--states 20] [--ignore-forces]

FOLDER holds .osim files that you have fetched, a folder per repository; docs/osim-files.md lists the repositories. The
table is printed as Markdown, a row per distinct file with muscles, then the counts. With OpenSim installed (extra
`oracle`) every accepted model is compared with it in random states: each coordinate in its range (or near its default),
speeds normal with 1 rad/s or 0.3 m/s. Lengths are those of the muscles' paths; accelerations those without muscle
forces, over the greatest of the state; inverse dynamics the generalised forces M u̇ + c for random accelerations, over
the greatest of the state, or 1 if that is less. Time is processor time per state of everything that the redundancy
problem needs (postures, paths, accelerations) in a batch of 200 states, and the ratio OpenSim's for the same
(realizeAcceleration, lengths and speeds of every muscle) over it. OpenSim is called from Python, a state at a time, and
the calls count.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.command_line import parse_options
from benchmarks.foreign import distinct_files
from solver.errors import SolverError
from solver.model import CoordinateLock, Model
from solver.multibody.dynamics import equations_of_motion
from solver.multibody.postures import postures
from solver.muscle import evaluate_paths
from solver.osim.model_reader import read_osim

Array = NDArray[np.float64]
SEED = 18
COMPARED = ("length", "acceleration", "inverse_dynamics")
TIMED_STATES = 200
NEITHER = ", nor by OpenSim"
MUSCLE = re.compile(rb"<\w*Muscle\w*[ >]")


@dataclass(frozen=True)
class Row:
    """A model's row; numbers are None where they were not measured, and `problem` is empty if it is accepted."""

    name: str
    muscles: int = 0
    left_out: int = 0
    problem: str = ""
    length: float | None = None
    acceleration: float | None = None
    inverse_dynamics: float | None = None
    microseconds: float | None = None
    ratio: float | None = None

    def markdown(self) -> str:
        status = self.problem or ("yes" if not self.left_out else f"without {self.left_out} forces")
        formats = {**dict.fromkeys(COMPARED, ".0e"), "microseconds": ".0f", "ratio": ".0f"}
        values = {name: getattr(self, name) for name in formats}
        figures = ["" if value is None else f"{value:{formats[name]}}" for name, value in values.items()]
        return f"| {self.name} | {self.muscles or ''} | {status} | {' | '.join(figures)} |"


def main() -> None:
    options = parse_options(__doc__, paths="+", states=20, ignore_forces=False)
    print("| model | muscles | accepted | length [m] | acceleration | inverse dynamics | time [µs] | ratio |")
    print("|---|---|---|---|---|---|---|---|")
    rows = []
    for path in distinct_files(options.paths, (".osim",)):
        if not MUSCLE.search(path.read_bytes()):
            continue
        row = examine(path, options.states, ignore_forces=options.ignore_forces)
        rows.append(replace(row, name=_title(path, options.paths)))
        print(rows[-1].markdown(), flush=True)
    accepted, neither = [row for row in rows if not row.problem], sum(row.problem.endswith(NEITHER) for row in rows)
    print(f"\n{len(accepted)} of {len(rows)} models accepted, {neither} that OpenSim does not open either")
    worst = {name: max((getattr(row, name) or 0.0 for row in accepted), default=0.0) for name in COMPARED}
    print("largest difference: " + ", ".join(f"{name} {value:.0e}" for name, value in worst.items()))


def _title(path: Path, folders: Sequence[Path]) -> str:
    """That of the repository's folder, and the path below it with _ for / and space."""
    parent = next(folder for folder in folders if path.is_relative_to(folder))
    repository, *below = path.relative_to(parent).with_suffix("").parts
    return "/".join([repository, *(["_".join(below).replace(" ", "_")] if below else [])])


def examine(path: Path, states: int, *, ignore_forces: bool) -> Row:
    try:
        model = read_osim(path, ignore_forces=ignore_forces)
    except SolverError as error:
        return Row(path.stem, problem=_problem(error, path))
    row = Row(path.stem, len(model.muscles), len(model.left_out))
    if not model.coordinates:
        return row
    q, u, acceleration = random_states(model, states)
    try:
        row = replace(row, microseconds=1e6 * seconds_per_state(model))
        ours = our_values(model, q, u, acceleration)
    except SolverError as error:
        return replace(row, problem=_problem(error, path))
    try:
        theirs, seconds = opensim_values(path, model, q, u, acceleration)
    except (ImportError, RuntimeError):  # no OpenSim; or it does not open the file, or cannot build its system
        return row
    differences = {name: float(_error(name, ours[name], theirs[name]).max(initial=0.0)) for name in theirs}
    return replace(row, ratio=1e6 * seconds / (row.microseconds or np.nan), **differences)  # type: ignore[arg-type]


def random_states(model: Model, states: int) -> tuple[Array, Array, Array]:
    """q, u and u̇ (states, coordinates)."""
    random = np.random.default_rng(SEED)
    low, high = np.array([coordinate.range for coordinate in model.coordinates]).T
    default = model.default_coordinates
    is_angle = np.array([coordinate.motion == "rotation" for coordinate in model.coordinates])
    widest = np.where(is_angle, 0.8, 0.1)
    low = np.where(np.isfinite(low), np.maximum(low, default - widest), default - widest)
    high = np.where(np.isfinite(high), np.minimum(high, default + widest), default + widest)
    q = random.uniform(np.minimum(low, high), np.maximum(low, high), (states, len(default)))
    scale = np.where(is_angle, 1.0, 0.3)
    u, acceleration = scale * random.normal(size=q.shape), scale * random.normal(size=q.shape)
    for constraint in model.constraints:
        if isinstance(constraint, CoordinateLock):  # OpenSim keeps it where it is
            q[:, constraint.coordinate], u[:, constraint.coordinate] = constraint.value, 0.0
    return q, u, acceleration


def our_values(model: Model, q: Array, u: Array, acceleration: Array) -> dict[str, Array]:
    state = postures(model, q, u)
    equations = equations_of_motion(model, state, model.joints[0].name)
    inertial = np.einsum("fij,fj->fi", equations.mass_matrix, acceleration) + equations.bias_force
    found = (evaluate_paths(model, state).lengths, equations.acceleration_unloaded, inertial)
    return dict(zip(COMPARED, found, strict=True))


def seconds_per_state(model: Model) -> float:
    """Processor time, the least of several batches."""
    q, u, _ = random_states(model, TIMED_STATES)
    times = []
    for _ in range(4):  # the first compiles
        start = process_time()
        state = postures(model, q, u)
        evaluate_paths(model, state)
        equations_of_motion(model, state, model.joints[0].name)
        times.append(process_time() - start)
    return min(times[1:]) / TIMED_STATES


def opensim_values(path: Path, model: Model, q: Array, u: Array, acceleration: Array) -> tuple[dict[str, Array], float]:
    """The same of OpenSim, and its processor time per state [s]. ImportError without OpenSim."""
    import opensim

    osim = _without_left_out(path, model)
    state = osim.initSystem()
    coordinates = [osim.getCoordinateSet().get(name) for name in model.coordinate_names]
    by_name = {muscle.getName(): muscle for muscle in osim.getMuscleList()}  # also those outside of the ForceSet
    muscles = [by_name[name] for name in model.muscle_names]
    for muscle in muscles:
        muscle.overrideActuation(state, True)
        muscle.setOverrideActuation(state, 0.0)
    for index in range(osim.getActuators().getSize()):
        actuator = opensim.ScalarActuator.safeDownCast(osim.getActuators().get(index))
        if actuator is not None:
            actuator.overrideActuation(state, True)
            actuator.setOverrideActuation(state, 0.0)
    solver = opensim.InverseDynamicsSolver(osim)
    order = _speed_order(opensim.State(state), coordinates)
    rows, seconds = [], 0.0
    for values, speeds, wanted in zip(q, u, acceleration, strict=True):
        start = process_time()
        for coordinate, value, speed in zip(coordinates, values, speeds, strict=True):
            if not coordinate.getLocked(state):
                coordinate.setValue(state, float(value), False)
            coordinate.setSpeedValue(state, float(speed))  # a locked one may have a default speed
        osim.realizeAcceleration(state)
        lengths = [muscle.getLength(state) for muscle in muscles]
        for muscle in muscles:
            muscle.getLengtheningSpeed(state)
        seconds += process_time() - start
        given = opensim.Vector(state.getNU(), 0.0)
        for index, value in zip(order, wanted, strict=True):
            given.set(index, float(value))
        forces_found = solver.solve(state, given)
        found = [coordinate.getAccelerationValue(state) for coordinate in coordinates]
        rows.append((lengths, found, [forces_found.get(index) for index in order]))
    return dict(zip(COMPARED, map(np.array, zip(*rows, strict=True)), strict=True)), seconds / len(q)


def _without_left_out(path: Path, model: Model) -> Any:
    """OpenSim's model without the forces that ours lacks, and without controllers."""
    import opensim

    opensim.Logger.setLevelString("off")
    osim = opensim.Model(str(path))
    forces, controllers = osim.getForceSet(), osim.getControllerSet()
    left_out = {name.split(" ", 1)[-1] for name in model.left_out}
    for index in range(forces.getSize()):
        if forces.get(index).getName() in left_out:
            forces.get(index).set_appliesForce(False)
    osim.finalizeFromProperties()
    for index in range(controllers.getSize()):
        controllers.get(index).setEnabled(False)
    return osim


def _problem(error: SolverError, path: Path) -> str:
    """The code of the refusal, and whether OpenSim opens the file."""
    problem = f"no: {error.code.rpartition('.')[2]}"
    try:
        import opensim

        opensim.Logger.setLevelString("off")
        opensim.Model(str(path)).initSystem()
    except ImportError:
        return problem
    except RuntimeError:
        return problem + NEITHER
    return problem


def _speed_order(state: Any, coordinates: Sequence[Any]) -> list[int]:
    """Index in Simbody's u of every coordinate: the one that its speed changes. The state is changed."""
    before = state.getU().to_numpy()
    order = []
    for coordinate in coordinates:
        value = coordinate.getSpeedValue(state)
        coordinate.setLocked(state, False)
        coordinate.setSpeedValue(state, value + 1.0)
        order.append(int(np.flatnonzero(state.getU().to_numpy() != before)[0]))
        coordinate.setSpeedValue(state, value)
    return order


def _error(name: str, ours: Array, theirs: Array) -> Array:
    difference = np.abs(ours - theirs)
    difference[np.isnan(ours) & np.isnan(theirs)] = 0.0  # a path or an acceleration that neither program can compute
    difference[np.isnan(difference)] = np.inf
    if name == "length":
        return difference
    largest: Array = np.nanmax(np.abs(theirs), axis=1, keepdims=True, initial=1.0)
    return difference / largest


if __name__ == "__main__":
    main()
