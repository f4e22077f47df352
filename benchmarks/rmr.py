"""Speed of the muscle solver, as ratios to other programs measured in one run; the last line has that of a whole frame.

    python -m benchmarks.rmr [--frames N] [--scenarios N]

Motion and model are FLX01 of the public data set if it is beside the repository, else the bundled arm raise. The peer,
OpenSim's maps and SLSQP, is `shared/peer/opensim_rmr.py` beside the repository, run in this Python process.

All times are processor times, the least of several repeats, unless a line says otherwise, because other load changes
them little. NumPy's threads are off. Exit code 1: our solver and Clarabel disagree.
"""

import os

os.environ.update(OPENBLAS_NUM_THREADS="1", OMP_NUM_THREADS="1", MKL_NUM_THREADS="1")  # before NumPy comes

import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from multiprocessing import get_context
from time import process_time

import numpy as np
from numpy.typing import NDArray

from benchmarks.command_line import parse_options
from solver.bundled import bundled_model, simulate_arm_raise
from solver.model import Model
from solver.motion import Kinematics, decimate, differentiate
from solver.redundancy.effort import RedundancyOptions
from solver.redundancy.mechanics import evaluate_motion
from solver.redundancy.motion_solution import solve_motion
from solver.redundancy.problem import CONE_FORCE_SCALE, FrameOutcome, LoadResponse, RedundancyProblem, build_redundancy
from solver.redundancy.sequence import ScenarioSolutions, solve_redundancy
from tests.solver.published import trial
from tests.solver.references import NO_WEIGHT, SHARED

MOTION, PEER = SHARED / "motions/FLX01.mot", SHARED.parent / "peer/opensim_rmr.py"
REPEATS = 3
OBJECTIVE_LIMIT, VIOLATION_LIMIT = 1e-6, 1e-8

Array = NDArray[np.float64]


def main() -> int:
    options = parse_options(__doc__, frames=12, scenarios=300)
    model, kinematics, name = subject()
    solve_motion(model, decimate(kinematics, 20))  # compiles at the first call
    print(f"{name}: {len(kinematics.time)} frames, {len(model.muscles)} muscles")
    peer, whole = side_by_side(model, kinematics, options.frames)
    print(f"whole frame, one core           {1e6 * whole:8.0f} µs")
    is_agreed = further_scenario(build_redundancy(model, evaluate_motion(model, kinematics), RedundancyOptions()))
    with ProcessPoolExecutor(1, get_context("spawn")) as alone:  # a process whose memory has no earlier stages
        print(alone.submit(memory, options.scenarios).result())
    print(f"ratio={peer / whole:.0f}" if peer else "ratio=none: there is no peer to compare with")
    return 0 if is_agreed else 1


def subject() -> tuple[Model, Kinematics, str]:
    if MOTION.exists():
        return *trial("FLX01"), "FLX01"
    model = bundled_model()
    return model, differentiate(simulate_arm_raise(model)), "bundled arm raise (no public data beside the repository)"


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
    if not (PEER.exists() and MOTION.exists()):
        print(f"no peer: {PEER.name} should lie in shared/peer beside the repository and does not")
        return None
    sys.path.insert(0, str(PEER.parent))
    try:
        import opensim_rmr
    except ImportError as error:
        print(f"no peer: {error}; install the extra `oracle`")
        return None
    oracle = opensim_rmr.Oracle(str(NO_WEIGHT))
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
    unsolved = int((found.outcomes != FrameOutcome.SOLVED).sum())
    is_agreed = objective <= OBJECTIVE_LIMIT and violation <= VIOLATION_LIMIT and not unsolved
    print(f"    objective within {objective:.1e} of Clarabel's, violation {violation:.1e}, {unsolved} unsolved")
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


def memory(scenarios: int) -> str:
    """The most memory of a process that solves so many scenarios."""
    try:
        import resource
    except ImportError:
        return "memory: not available on this system"
    model, kinematics, _ = subject()
    problem = build_redundancy(model, evaluate_motion(model, kinematics), RedundancyOptions())
    solve_redundancy(problem, random_loads(problem, scenarios))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)
    return f"    {len(problem.time)} × {scenarios}: at most {peak / 1e6:.0f} MB in memory, the whole process"


if __name__ == "__main__":
    sys.exit(main())
