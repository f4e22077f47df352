"""Speed of the muscle solver, as ratios to other programs measured in one run; the last line has that of a whole frame.

    python benchmarks/rmr.py [--frames N] [--scenarios N]

Motion and model are FLX01 of the public data set if it is beside the repository, else the bundled arm raise. The peer,
OpenSim's maps and SLSQP, is `shared/peer/opensim_rmr.py` beside the repository, run in this Python process.

All times are processor times, the least of several repeats, unless a line says otherwise, because other load changes
them little. NumPy's threads are off. Exit code 1: our solver and Clarabel disagree.
"""

from __future__ import annotations

import os

os.environ.update(OPENBLAS_NUM_THREADS="1", OMP_NUM_THREADS="1", MKL_NUM_THREADS="1")  # before NumPy comes

import argparse
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from time import process_time

import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).parents[1]
SHARED = ROOT.parent / "shared"
OSIM, MOTION = SHARED / "data/models/TSM_subject_noWeight.osim", SHARED / "data/motions/FLX01.mot"
PEER = SHARED / "peer/opensim_rmr.py"
REPEATS = 3
OBJECTIVE_LIMIT, VIOLATION_LIMIT = 1e-6, 1e-8

sys.path.insert(0, str(ROOT))

from solver.bundled import bundled_model, simulate_arm_raise  # noqa: E402
from solver.model import Model  # noqa: E402
from solver.motion import Kinematics, decimate, differentiate, read_motion  # noqa: E402
from solver.multibody.dynamics import equations_of_motion  # noqa: E402
from solver.multibody.postures import postures  # noqa: E402
from solver.muscle import evaluate_paths, muscle_forces  # noqa: E402
from solver.redundancy.effort import RedundancyOptions  # noqa: E402
from solver.redundancy.mechanics import evaluate_motion  # noqa: E402
from solver.redundancy.motion_solution import solve_motion  # noqa: E402
from solver.redundancy.problem import (  # noqa: E402
    CONE_FORCE_SCALE,
    FrameOutcome,
    LoadResponse,
    RedundancyProblem,
    build_redundancy,
)
from solver.redundancy.sequence import ScenarioSolutions, solve_redundancy  # noqa: E402

Array = NDArray[np.float64]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=12, help="frames of the peer's sample")
    parser.add_argument("--scenarios", type=int, default=300, help="scenarios whose memory is measured")
    parser.add_argument("--memory", action="store_true", help="only the memory that the largest study takes")
    arguments = parser.parse_args()
    model, kinematics, name = subject()
    solve_motion(model, decimate(kinematics, 20))  # compiles at the first call
    problem = build_redundancy(model, evaluate_motion(model, kinematics), RedundancyOptions())
    if arguments.memory:
        memory(problem, arguments.scenarios)
        return 0
    print(f"{name}: {len(kinematics.time)} frames, {len(model.muscles)} muscles, {os.cpu_count()} processors")
    peer, whole = side_by_side(model, kinematics, arguments.frames)
    print(f"whole frame, one core           {1e6 * whole:8.0f} µs")
    stations(model, kinematics)
    is_agreed = further_scenario(problem)
    run_again("--memory", "--scenarios", str(arguments.scenarios))
    print(f"ratio={peer / whole:.0f}" if peer else "ratio=none: there is no peer to compare with")
    return 0 if is_agreed else 1


def subject() -> tuple[Model, Kinematics, str]:
    if not OSIM.exists():
        model = bundled_model()
        motion = differentiate(simulate_arm_raise(model))
        return model, motion, "bundled arm raise (no public data set beside the repository)"
    from solver.osim.model_reader import read_osim

    model = read_osim(OSIM)
    return model, differentiate(read_motion(MOTION, model)), "FLX01"


def least(run: Callable[[], object], repeats: int = REPEATS) -> float:
    """The shortest of several runs [s], because other load only lengthens a run."""
    times = []
    for _ in range(repeats):
        start = process_time()
        run()
        times.append(process_time() - start)
    return min(times)


def side_by_side(model: Model, kinematics: Kinematics, frames: int) -> tuple[float | None, float]:
    """Seconds per frame of the peer (None without it) and of our solver, alternating; the least of every frame."""
    peer = the_peer()
    sample = np.linspace(0, len(kinematics.time) - 1, frames).astype(int)
    seconds, ours = np.full((REPEATS, frames, 2), np.nan), np.empty(REPEATS)
    for repeat in range(REPEATS):
        ours[repeat] = least(lambda: solve_motion(model, kinematics), repeats=2) / len(kinematics.time)
        if peer:
            seconds[repeat] = [peer(k) for k in sample]
    if not peer:
        return None, float(ours.min())
    maps, solving = seconds.min(axis=0).mean(axis=0)
    print(f"peer: OpenSim's maps            {1e3 * maps:8.1f} ms a frame")
    print(f"      SLSQP                     {1e3 * solving:8.1f} ms a frame")
    return float(maps + solving), float(ours.min())


def the_peer() -> Callable[[int], tuple[float, float]] | None:
    """A function that times OpenSim's maps and SLSQP in one frame of FLX01 [s]; None without the peer."""
    if not (PEER.exists() and OSIM.exists()):
        print(f"no peer: {PEER.name} should lie in shared/peer beside the repository and does not")
        return None
    sys.path.insert(0, str(PEER.parent))
    try:
        import opensim_rmr
    except ImportError as error:
        print(f"no peer: {error}; install the extra `oracle`")
        return None
    oracle = opensim_rmr.Oracle(str(OSIM))
    oracle.mot_names, time, q, u, acceleration = opensim_rmr.kinematics(str(MOTION))
    weights = opensim_rmr.weights(oracle)
    free = np.full(oracle.na - oracle.nm, np.inf)
    lower, upper = np.r_[np.zeros(oracle.nm), -free], np.r_[np.ones(oracle.nm), free]
    guess = np.r_[np.full(oracle.nm, 0.1), np.zeros(len(free))]

    def frame(k: int) -> tuple[float, float]:
        start = process_time()
        mapped = oracle.maps(time[k], q[k], u[k])
        between = process_time()
        opensim_rmr.solve_slsqp(mapped, acceleration[k], weights, lower, upper, guess)
        return between - start, process_time() - between

    return frame


def stations(model: Model, kinematics: Kinematics) -> None:
    """Time of every stage of a whole frame."""
    mechanics, options = evaluate_motion(model, kinematics), RedundancyOptions()
    problem = build_redundancy(model, mechanics, options)
    steps: dict[str, Callable[[], object]] = {
        "postures": lambda: postures(model, kinematics.positions, kinematics.speeds),
        "paths": lambda: evaluate_paths(model, mechanics.state),
        "muscle forces": lambda: muscle_forces(model, mechanics.paths.lengths, mechanics.paths.speeds),
        "equations": lambda: equations_of_motion(model, mechanics.state),
        "response maps": lambda: mechanics.maps(model),
        "building, with the maps": lambda: build_redundancy(model, mechanics, options),
        "solving": lambda: solve_redundancy(problem),
    }
    for name, run in steps.items():
        print(f"    {name:<27} {1e6 * least(run) / len(kinematics.time):8.1f} µs")


def random_loads(problem: RedundancyProblem, count: int) -> LoadResponse:
    """Loads that increase and decrease over the motion, with different sizes and directions."""
    generator = np.random.default_rng(1)
    shape = np.sin(np.linspace(0, np.pi, len(problem.time)))[:, None]
    acceleration = generator.uniform(-2, 2, (count, 1, len(problem.tracked))) * shape
    return LoadResponse(acceleration, generator.uniform(-5, 5, (count, 1, 6)) * shape)


def further_scenario(problem: RedundancyProblem) -> bool:
    """A further scenario on the same motion, on one core and against Clarabel; whether both solve the same problems to
    the same solutions.
    """
    frames, loads = len(problem.time), random_loads(problem, 20)
    one = LoadResponse(loads.acceleration[:1], loads.reaction[:1])
    more, single = (least(partial(solve_redundancy, problem, a, workers=1)) for a in (loads, one))
    ours = (more - single) / (19 * frames)
    alone = replace(problem, interval=1e3)  # no bounds from frame to frame, so that both solve the same problems
    start = process_time()
    known = solve_redundancy(replace(alone, solver="clarabel"), one)
    clarabel = (process_time() - start) / frames
    print(f"further scenario, one core      {1e6 * ours:8.1f} µs a frame")
    print(f"    Clarabel frame by frame     {1e6 * clarabel:8.0f} µs a frame: {clarabel / ours:.0f} times ours")
    found = solve_redundancy(alone, one)
    objective, violation = differences(alone, one, found, known)
    is_agreed = objective <= OBJECTIVE_LIMIT and violation <= VIOLATION_LIMIT and not unsolved(found)
    print(f"    objective within {objective:.1e} of Clarabel's, violation {violation:.1e}, {unsolved(found)} unsolved")
    print("    as it should be" if is_agreed else f"    NOT WITHIN {OBJECTIVE_LIMIT:g} AND {VIOLATION_LIMIT:g}")
    return is_agreed


def differences(
    problem: RedundancyProblem, loads: LoadResponse, found: ScenarioSolutions, known: ScenarioSolutions
) -> tuple[float, float]:
    """The greatest relative difference of the objectives, and our greatest violation: of an equality (in the space that
    A reaches, in rows of length 1), of a bound, or of the cone [kN].
    """
    effort, expected = ((problem.weights * s.controls[0] ** 2).sum(axis=1) for s in (found, known))
    x, A = found.controls[0], problem.matrix
    target = problem.target[0] - loads.acceleration[0][:, problem.tracked]
    gap = np.linalg.pinv(A, rcond=1e-9) @ (A @ x[..., None] - target[..., None])
    a = x[:, : problem.time_constants.shape[1]]
    outside = max(float(-a.min()), float(a.max()) - 1.0, float(-found.cone_slack.min()) / CONE_FORCE_SCALE)
    return float(np.abs(effort / expected - 1).max()), max(float(np.abs(gap).max()), outside, 0.0)


def unsolved(solution: ScenarioSolutions) -> int:
    return int((solution.outcomes != FrameOutcome.SOLVED).sum())


def memory(problem: RedundancyProblem, scenarios: int) -> None:
    solve_redundancy(problem, random_loads(problem, scenarios))
    try:
        import resource
    except ImportError:
        print("memory: this system does not tell")
        return
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)
    print(f"    {len(problem.time)} × {scenarios}: at most {peak / 1e6:.0f} MB in memory, the whole process")


def run_again(*options: str) -> None:
    """In a new process, whose memory is not affected by earlier stages."""
    sys.stdout.flush()
    subprocess.run([sys.executable, __file__, *options], check=True)  # noqa: S603


if __name__ == "__main__":
    sys.exit(main())
