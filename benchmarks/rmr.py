"""How fast the muscle solver is, in ratios measured side by side in one run; the whole frame's ratio in the last line.

    python benchmarks/rmr.py [--frames N] [--scenarios N]

Motion and model are FLX01 of the public data set where it lies beside the repository, else the bundled arm raise. The
peer, OpenSim's maps and SLSQP, is `shared/peer/opensim_rmr.py` beside the repository, run in this process's Python.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from time import perf_counter

import numpy as np

ROOT = Path(__file__).parents[1]
SHARED = ROOT.parent / "shared"
OSIM, MOTION = SHARED / "data/models/TSM_subject_noWeight.osim", SHARED / "data/motions/FLX01.mot"
PEER = SHARED / "peer/opensim_rmr.py"
REPEATS = 3

sys.path.insert(0, str(ROOT))

from solver.bundled import bundled_model  # noqa: E402
from solver.dynamics import equations_of_motion, response_maps  # noqa: E402
from solver.kinematics import postures  # noqa: E402
from solver.model import Model  # noqa: E402
from solver.motion import Kinematics, differentiate, read_motion, thin  # noqa: E402
from solver.muscle import muscle_forces  # noqa: E402
from solver.paths import evaluate_paths  # noqa: E402
from solver.raise_arm import raise_arm  # noqa: E402
from solver.redundancy import (  # noqa: E402
    FrameOutcome,
    LoadResponse,
    RedundancyOptions,
    RedundancyProblem,
    build_redundancy,
    go_through,
    solve_motion,
    solve_redundancy,
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=12, help="frames of the peer's sample")
    parser.add_argument("--scenarios", type=int, default=300, help="scenarios of the design study")
    arguments = parser.parse_args()
    model, kinematics, name = subject()
    frames = len(kinematics.time)
    print(f"{name}: {frames} frames, {len(model.muscles)} muscles, {os.cpu_count()} processors")
    solve_motion(model, thin(kinematics, 20))  # compiled from here on

    peer, whole = side_by_side(model, kinematics, arguments.frames)
    print(f"whole frame, one core           {1e6 * whole:8.0f} µs")
    stations(model, kinematics)
    problem = build_redundancy(model, go_through(model, kinematics), RedundancyOptions())
    against_clarabel(problem)
    linearity(problem, arguments.scenarios)
    single_frame(model, kinematics)
    imports()
    print(f"ratio={peer / whole:.0f}" if peer else "ratio=none: there is no peer to compare with")


def subject() -> tuple[Model, Kinematics, str]:
    if not OSIM.exists():
        model = bundled_model()
        return model, differentiate(raise_arm(model)), "bundled arm raise (no public data set beside the repository)"
    from solver.osim.reader import read_osim

    model = read_osim(OSIM)
    return model, differentiate(read_motion(MOTION, model)), "FLX01"


def best(run: Callable[[], object]) -> float:
    """The shortest of some runs [s]: what disturbs only lengthens."""
    times = []
    for _ in range(REPEATS):
        start = perf_counter()
        run()
        times.append(perf_counter() - start)
    return min(times)


def stations(model: Model, kinematics: Kinematics) -> None:
    """What each room takes of a whole frame."""
    mechanics, options = go_through(model, kinematics), RedundancyOptions()
    problem = build_redundancy(model, mechanics, options)
    steps: dict[str, Callable[[], object]] = {
        "postures": lambda: postures(model, kinematics.positions, kinematics.speeds),
        "paths": lambda: evaluate_paths(model, mechanics.state),
        "muscle forces": lambda: muscle_forces(model, mechanics.paths.lengths, mechanics.paths.speeds),
        "equations": lambda: equations_of_motion(model, mechanics.state),
        "response maps": lambda: response_maps(model, mechanics.equations, mechanics.paths, mechanics.forces),
        "building": lambda: build_redundancy(model, mechanics, options),
        "solving": lambda: solve_redundancy(problem),
    }
    for name, run in steps.items():
        print(f"    {name:<27} {1e6 * best(run) / len(kinematics.time):8.0f} µs")


def scenarios_of(problem: RedundancyProblem, count: int) -> LoadResponse:
    """Loads that grow and fade over the motion, each of another size and direction."""
    generator = np.random.default_rng(1)
    shape = np.sin(np.linspace(0, np.pi, len(problem.time)))[:, None]
    acceleration = generator.uniform(-2, 2, (count, 1, len(problem.tracked))) * shape
    return LoadResponse(acceleration, generator.uniform(-5, 5, (count, 1, 6)) * shape)


def against_clarabel(problem: RedundancyProblem) -> None:
    """A further scenario on the same motion, on one core and against Clarabel, which is given the same bounds."""
    frames = len(problem.time)
    loads = scenarios_of(problem, 20)
    one = LoadResponse(loads.acceleration[:1], loads.reaction[:1])
    more, single = (
        best(lambda: solve_redundancy(problem, loads, workers=1)),
        best(lambda: solve_redundancy(problem, one)),
    )
    ours = (more - single) / (19 * frames)
    start = perf_counter()
    reference = solve_redundancy(replace(problem, solver="clarabel"), one)
    clarabel = (perf_counter() - start) / frames
    print(f"further scenario, one core      {1e6 * ours:8.1f} µs a frame")
    print(f"    Clarabel frame by frame     {1e6 * clarabel:8.0f} µs a frame: {clarabel / ours:.0f} times ours")
    alone = replace(problem, interval=1e3)  # no bounds from frame to frame: the very same problems for both
    found, expected = (solve_redundancy(replace(alone, solver=s), one) for s in ("interior_point", "clarabel"))
    effort, known = ((problem.weights * s.controls[0] ** 2).sum(axis=1) for s in (found, expected))
    unsolved = int((found.outcomes != FrameOutcome.SOLVED).sum() + (reference.outcomes != FrameOutcome.SOLVED).sum())
    print(
        f"    objective within {np.abs(effort / known - 1).max():.1e} of Clarabel's, outside the cone by at most "
        f"{max(0.0, -found.cone_slack.min()) / 1e3:.1e} kN, {unsolved} frames unsolved"
    )


def linearity(problem: RedundancyProblem, scenarios: int) -> None:
    """Frames and scenarios doubled, on all processors; and the memory of the largest."""
    print("frames × scenarios, all processors: µs each")
    half = replace(
        problem, **{n: getattr(problem, n)[: len(problem.time) // 2] for n in vars(problem) if is_per_frame(problem, n)}
    )
    for part in (half, problem):
        for count in (scenarios // 4, scenarios // 2, scenarios):
            loads = scenarios_of(part, count)
            start = perf_counter()
            solve_redundancy(part, loads)
            seconds = perf_counter() - start
            print(f"    {len(part.time):4} × {count:<4} {1e6 * seconds / count / len(part.time):8.1f} µs")
    tracemalloc.start()
    solve_redundancy(problem, loads)
    print(f"    memory at most {tracemalloc.get_traced_memory()[1] / 1e6:.0f} MB")
    tracemalloc.stop()


def is_per_frame(problem: RedundancyProblem, name: str) -> bool:
    value = getattr(problem, name)
    return isinstance(value, np.ndarray) and value.ndim > 0 and len(value) == len(problem.time)


def single_frame(model: Model, kinematics: Kinematics) -> None:
    frame = replace(
        kinematics,
        **{n: v[100:101] for n, v in vars(kinematics).items() if isinstance(v, np.ndarray) and v.ndim > 0},
    )
    print(f"one frame alone                 {1e3 * best(lambda: solve_motion(model, frame)):8.1f} ms")


def imports() -> None:
    command = [sys.executable, "-X", "importtime", "-c", "import solver.redundancy, solver.assessment"]
    seconds = []
    for _ in range(REPEATS):
        lines = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stderr.splitlines()  # noqa: S603
        rows = [re.match(r"import time: +\d+ \| +(\d+) \| (solver\.\w+)$", line) for line in lines]
        seconds.append(sum(int(row[1]) for row in rows if row and row[2] in {"solver.redundancy", "solver.assessment"}))
    print(f"import redundancy, assessment   {min(seconds) / 1e6:8.2f} s")


def side_by_side(model: Model, kinematics: Kinematics, frames: int) -> tuple[float | None, float]:
    """Median seconds a frame of the peer, None where it is not there, and of ours, in turns."""
    peer = the_peer()
    maps, solving, ours = [], [], []
    for k in np.linspace(0, len(kinematics.time) - 1, frames).astype(int):
        start = perf_counter()
        solve_motion(model, kinematics)
        ours.append((perf_counter() - start) / len(kinematics.time))
        if peer:
            seconds = peer(k)
            maps.append(seconds[0])
            solving.append(seconds[1])
    if not peer:
        return None, float(np.median(ours))
    print(f"peer: OpenSim's maps            {1e3 * np.median(maps):8.1f} ms a frame")
    print(f"      SLSQP                     {1e3 * np.median(solving):8.1f} ms a frame")
    return float(np.median(np.add(maps, solving))), float(np.median(ours))


def the_peer() -> Callable[[int], tuple[float, float]] | None:
    """What takes the seconds of OpenSim's maps and of SLSQP in one frame of FLX01, or None where it is not there."""
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
        start = perf_counter()
        mapped = oracle.maps(time[k], q[k], u[k])
        between = perf_counter()
        opensim_rmr.solve_slsqp(mapped, acceleration[k], weights, lower, upper, guess)
        return between - start, perf_counter() - between

    return frame


if __name__ == "__main__":
    main()
