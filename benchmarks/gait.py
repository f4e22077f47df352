"""Inverse dynamics and static optimisation of gait beside OpenSim's tools: the tables of docs/gait.md.

    python -m benchmarks.gait FOLDER [--case NAME]

FOLDER holds the public files that docs/gait.md lists. Every motion is filtered at 6 Hz, written to a file at 100 Hz or
less, and given to both programs without a further filter, with the same loads and actuators. Differences are printed
per case: moments [N m] of inverse dynamics, also over the greatest of the motion, and activations of static
optimisation. OpenSim's optimiser runs with a criterion of 1e-8 for the comparison, and with its default 1e-4 for the
time, over the first frames. Times are processor time per frame from the files of motion and loads to the result, with a
model that is read, and without compiling.

Exit code 1 if moments differ by more than 1e-6 of the greatest, or activations by more than 1e-3.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solver.inverse_dynamics import inverse_dynamics
from solver.model import CoordinateActuator, Model
from solver.motion import read_motion
from solver.motion_splines import differentiate_by_splines, held_by_constraints
from solver.multibody.constraints import is_held
from solver.osim.loads import read_external_loads
from solver.osim.reader import read_osim
from solver.redundancy.motion import solve_motion
from solver.redundancy.options import RedundancyOptions, options_for, static_optimisation
from solver.time_series_table import read_table, write_table
from station.assessment.given_motion import MotionCut, MuscleInputs, read_given_motion
from station.assessment.inverse_dynamics import solve_inverse_dynamics
from station.assessment.rmr import SolvedMotion, solve_muscles

Array = NDArray[np.float64]
MOMENT_LIMIT, ACTIVATION_LIMIT = 1e-6, 1e-3
RESIDUAL, RESERVE = 500.0, 5.0
"""Optimal forces of actuators on the pelvis and on other coordinates, where a case has no file of them."""


@dataclass(frozen=True)
class Case:
    """Files of a case, and the frames that are solved: from start to end [s]."""

    name: str
    model: str
    motion: str
    loads: str
    start: float
    end: float
    actuators: str | None = None


WALK = ("coordinates.sto", "grf_walk.xml", 0.5, 1.3)
TIMED_FRAMES = 20
FRAME_INTERVAL = 0.01
"""[s] to which motions with more frames are decimated."""
CASES = (
    Case(
        "gait2392",
        "subject01_simbody_adjusted.osim",
        "subject01_walk1_ik.mot",
        "subject01_walk1_grf.xml",
        0.6,
        1.6,
        "gait2392_CMC_Actuators.xml",
    ),
    Case("Rajagopal 2016, scaled", "subject_walk_scaled.osim", *WALK),
    Case("Rajagopal 2016, generic", "Rajagopal2016.osim", *WALK),
    Case("Lai-Uhlrich 2022, generic", "RajagopalLaiUhlrich2023.osim", *WALK),
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--case", help="only this one")
    arguments = parser.parse_args()
    cases = [case for case in CASES if arguments.case in (None, case.name)]
    print(
        "| case | frames | Δ moments | relative | Δ activations, median | largest | ID [ms] | ratio | SO [ms] | ratio |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|")
    is_equal = True
    for case in cases:
        with tempfile.TemporaryDirectory() as name:
            is_equal &= compare(case, arguments.folder, Path(name))
    sys.exit(0 if is_equal else 1)


def compare(case: Case, folder: Path, work: Path) -> bool:
    """Print the row of a case; whether its differences are within the limits."""
    inputs = prepare(case, folder, work)
    cut = MotionCut(None, case.start, case.end, derivatives="splines")
    moments = solve_inverse_dynamics(inputs, cut)
    solved = solve_muscles(inputs, cut, options())  # compiles
    ours_id, ours_so = seconds_per_frame(inputs, cut)
    theirs, opensim_id = inverse_dynamics_of_opensim(inputs, cut, work)
    activations, _ = static_optimisation_of_opensim(inputs, solved, solved.solution.time, 1e-8, work)
    timed = solved.solution.time[:TIMED_FRAMES]
    _, opensim_so = static_optimisation_of_opensim(inputs, solved, timed, 1e-4, work)
    error = float(np.abs(np.column_stack([theirs[name] for name in moments.columns]) - moments.values).max())
    share = error / float(np.abs(moments.values).max())
    differences = np.abs(activations - solved.solution.activations)
    frames = len(moments.time)
    figures = [f"{error:.0e}", f"{share:.0e}", f"{np.median(differences):.0e}", f"{differences.max():.0e}"]
    figures += [f"{1e3 * ours_id:.2f}", f"{opensim_id / ours_id:.1f}"]
    figures += [f"{1e3 * ours_so:.2f}", f"{opensim_so / ours_so:.0f}"]
    print(f"| {case.name} | {frames} | {' | '.join(figures)} |", flush=True)
    if solved.solution.unsolved:
        print(f"{case.name}: {solved.solution.unsolved} frames not solved", file=sys.stderr)
    return share <= MOMENT_LIMIT and float(differences.max()) <= ACTIVATION_LIMIT and not solved.solution.unsolved


def seconds_per_frame(inputs: MuscleInputs, cut: MotionCut) -> tuple[float, float]:
    """Of inverse dynamics and of static optimisation by us, each from the files of motion and loads [s]."""
    model = read_osim(inputs.model, actuators=inputs.actuators)
    found = []
    for accelerations in ("curvatures", "slopes_of_speeds"):
        before = process_time()
        motion = read_motion(Path(str(inputs.motion)), model)
        kinematics = differentiate_by_splines(motion, None, cut.start, cut.end, accelerations)  # type: ignore[arg-type]
        loads = read_external_loads(Path(str(inputs.external_loads)), model, kinematics.time)
        if accelerations == "curvatures":
            inverse_dynamics(model, kinematics, loads)
        else:
            solve_motion(model, held_by_constraints(model, kinematics), options_for(model, options()), loads=loads)
        found.append((process_time() - before) / len(kinematics.time))
    return found[0], found[1]


def options() -> RedundancyOptions:
    return static_optimisation(RedundancyOptions())


def prepare(case: Case, folder: Path, work: Path) -> MuscleInputs:
    """The inputs of both programs: a motion that constraints hold, and a file of actuators."""
    model = read_osim(folder / case.model)
    given = MuscleInputs(folder / case.motion, str(folder / case.model))
    whole = read_given_motion(given, MotionCut(6.0, derivatives="splines"), is_assembled=True).kinematics
    every = max(1, round(FRAME_INTERVAL / whole.interval))
    time, positions = whole.time[::every], whole.positions[::every]
    write_table(work / "motion.sto", model.coordinate_names, time, positions)
    actuators = work / "actuators.xml"
    if case.actuators is None:
        actuators.write_text(actuator_file(model), encoding="utf-8")
    else:
        actuators = folder / case.actuators
    return replace(given, motion=work / "motion.sto", external_loads=folder / case.loads, actuators=(actuators,))


def actuator_file(model: Model) -> str:
    """A ForceSet with an actuator for every coordinate that has none and that no constraint determines."""
    driven = {one.coordinate for one in model.actuators if isinstance(one, CoordinateActuator)}
    lacking = [
        name
        for index, (name, held) in enumerate(zip(model.coordinate_names, is_held(model), strict=True))
        if not held and index not in driven
    ]
    objects = "".join(
        f'<CoordinateActuator name="{name}_added"><min_control>-inf</min_control><max_control>inf</max_control>'
        f"<coordinate>{name}</coordinate>"
        f"<optimal_force>{RESIDUAL if name.startswith('pelvis') else RESERVE}</optimal_force></CoordinateActuator>"
        for name in lacking
    )
    return (
        f'<OpenSimDocument Version="40000"><ForceSet name="added"><objects>{objects}</objects></ForceSet>'
        "</OpenSimDocument>"
    )


def inverse_dynamics_of_opensim(inputs: MuscleInputs, cut: MotionCut, work: Path) -> tuple[dict[str, Array], float]:
    """Column → its values, and processor time per frame [s]."""
    opensim = silent_opensim()
    tool = opensim.InverseDynamicsTool()
    model = opensim.Model(inputs.model)
    tool.setModel(model)
    tool.setCoordinatesFileName(str(inputs.motion))
    tool.setExternalLoadsFileName(str(inputs.external_loads))
    tool.setStartTime(cut.start)
    tool.setEndTime(cut.end)
    without = opensim.ArrayStr()
    without.append("Muscles")
    tool.setExcludedForces(without)
    tool.setResultsDir(str(work))
    tool.setOutputGenForceFileName("id.sto")
    before = process_time()
    with silent_output():
        tool.run()
    seconds = process_time() - before
    columns, table, _ = read_table(work / "id.sto")
    return dict(zip(columns, table.T, strict=True)), seconds / len(table)


def static_optimisation_of_opensim(
    inputs: MuscleInputs, solved: SolvedMotion, time: Array, criterion: float, work: Path
) -> tuple[Array, float]:
    """Activations (frames, muscles) at these times, and processor time per frame [s]."""
    opensim = silent_opensim()
    model = opensim.Model(inputs.model)
    for path in inputs.actuators:
        added = opensim.ForceSet(str(path), True)
        for index in range(added.getSize()):
            model.updForceSet().cloneAndAppend(added.get(index))
    model.initSystem()
    analysis = opensim.StaticOptimization()
    analysis.setConvergenceCriterion(criterion)
    analysis.setMaxIterations(100 if criterion >= 1e-4 else 3000)
    model.updAnalysisSet().cloneAndAppend(analysis)
    tool = opensim.AnalyzeTool()
    tool.setModel(model)
    tool.setName("gait")
    tool.setCoordinatesFileName(str(inputs.motion))
    tool.setExternalLoadsFileName(str(inputs.external_loads))
    tool.setLoadModelAndInput(True)
    tool.setInitialTime(float(time[0]))
    tool.setFinalTime(float(time[-1]))
    tool.setResultsDir(str(work))
    before = process_time()
    with silent_output():
        tool.run()
    seconds = process_time() - before
    columns, table, _ = read_table(work / "gait_StaticOptimization_activation.sto")
    rows = [int(np.abs(table[:, 0] - moment).argmin()) for moment in time]
    return table[np.ix_(rows, [columns.index(name) for name in solved.solution.muscles])], seconds / len(table)


@contextmanager
def silent_output() -> Iterator[None]:
    """OpenSim prints facts of the model at every level of its logger, from C++."""
    kept, nowhere = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    sys.stdout.flush()
    os.dup2(nowhere, 1)
    try:
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nowhere)


def silent_opensim() -> Any:
    import opensim

    opensim.Logger.setLevelString("off")
    return opensim


if __name__ == "__main__":
    main()
