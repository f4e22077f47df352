"""Inverse kinematics beside OpenSim's own tool, in one process, on every public trial; needs the extra oracle.

    python -m benchmarks.ik [--frames 100] [--varied 40]

Prints per trial the processor time of a frame of both, at OpenSim's default accuracy and at 1e-9, and how OpenSim's
postures at 1e-9 differ from ours: the cost that they have above it, and the coordinates that are held, in frames in
which none is at its bound. Then the same for varied trials: markers hidden, coordinates locked, clamped or tracked.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from solver.errors import SolverError
from solver.inverse_kinematics.solve import InverseKinematics, PostureOutcome
from solver.inverse_kinematics.uncertainty import posture_uncertainty
from tests.solver.inverse_kinematics.marked import cost_of
from tests.solver.oracle.two_bodies import opensim
from tests.solver.oracle.varied_trials import (
    TRIALS,
    Tracked,
    Trial,
    count_bounds,
    solved_by_opensim,
    tracked,
    varied,
)

Array = NDArray[np.float64]
COLUMNS = (
    *("trial", "frames", "RMS", "ours", "OpenSim 1e-5", "ratio", "OpenSim 1e-9", "ratio"),
    *("its cost − ours", "Δq max, median"),
)
REPEATS = 5
HIGHER, FAR = 1e-8, 2e-5  # m², rad


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=100_000, help="of each trial")
    parser.add_argument("--varied", type=int, default=40, help="number of varied trials")
    options = parser.parse_args()
    opensim.Logger.setLevelString("Off")
    print(f"| {' | '.join(COLUMNS)} |\n|---{'|---:' * (len(COLUMNS) - 1)}|")
    for name, trial in TRIALS.items():
        print(_row(name, trial, options.frames), flush=True)
    print("\n| of varied trials | frames |\n|---|---:|")
    for kind, frames in _compare_varied(options.varied).items():
        print(f"| {kind} | {frames} |")


def _row(name: str, files: Trial, most: int) -> str:
    whole = tracked(files)
    end = float(whole.time[min(most, len(whole.time)) - 1])
    trial = tracked(files, end)
    solution = trial.solve()  # compiles
    ours = min(_processor_s(trial) for _ in range(REPEATS)) / len(trial.time)
    cells = [name, str(len(trial.time)), f"{1e3 * np.sqrt(np.nanmean(solution.residuals**2)):.1f} mm", _ms(ours)]
    for accuracy in (1e-5, 1e-9):
        with tempfile.TemporaryDirectory() as folder:
            began = time.process_time()
            theirs = solved_by_opensim(files, trial.model, Path(folder), accuracy, end)
            theirs_s = (time.process_time() - began) / len(theirs)
        cells += [_ms(theirs_s), f"{theirs_s / ours:.0f}"]
    above = cost_of(trial.model, trial.tasks, trial.observed, theirs) - solution.cost
    away = _away(trial, solution, theirs)[count_bounds(trial.model, solution.coordinates) == 0]
    cells += [f"{above.min():.0e} to {above.max():.0e} m²", f"{away.max():.0e}, {np.median(away):.0e} rad"]
    return f"| {' | '.join(cells)} |"


def _compare_varied(count: int) -> Counter[str]:
    """Frames by what distinguishes OpenSim's postures at 1e-9 from ours."""
    found: Counter[str] = Counter()
    for seed in range(count):
        with tempfile.TemporaryDirectory() as folder:
            files, _ = varied(seed, Path(folder))
            trial = tracked(files)
            try:
                theirs = solved_by_opensim(files, trial.model, Path(folder), 1e-9)
                solution = trial.solve()
            except (RuntimeError, SolverError):
                found["the model cannot be assembled, in OpenSim or here"] += len(trial.time)
                continue
        above = cost_of(trial.model, trial.tasks, trial.observed, theirs) - solution.cost
        away, at_bound = _away(trial, solution, theirs), count_bounds(trial.model, solution.coordinates)
        for frame, outcome in enumerate(solution.outcomes):
            found[_kind(outcome, float(above[frame]), float(away[frame]), int(at_bound[frame]))] += 1
    return found


def _kind(outcome: PostureOutcome, above: float, away: float, at_bound: int) -> str:
    if outcome is not PostureOutcome.SOLVED:
        return outcome.value
    if abs(above) > HIGHER:
        return f"another optimum, OpenSim's {'higher' if above > 0 else 'lower'} by more than 1e-8 m²"
    if away <= FAR:
        return "the same optimum, held coordinates within 2e-5 rad"
    return "costs within 1e-8 m², a coordinate at its bound" if at_bound else "costs within 1e-8 m², nearly flat"


def _away(trial: Tracked, solution: InverseKinematics, theirs: Array) -> Array:
    """(frames,) largest difference of a coordinate that is held [rad or m]."""
    is_held = posture_uncertainty(trial.model, trial.observed, trial.tasks, solution, 1e-3).is_held
    return np.asarray(np.where(is_held, np.abs(theirs - solution.coordinates), 0.0).max(axis=1))


def _processor_s(trial: Tracked) -> float:
    began = time.process_time()
    trial.solve()
    return time.process_time() - began


def _ms(seconds: float) -> str:
    return f"{1e3 * seconds:.3g} ms"


if __name__ == "__main__":
    main()
