"""Inverse kinematics beside OpenSim's own tool, in one process, on the public trials; needs the extra oracle.

    python -m benchmarks.inverse_kinematics [--frames 100]

Prints per trial processor milliseconds a frame of both, at OpenSim's default accuracy and at 1e-9, their ratios, the
cost that OpenSim's postures have above ours, and how far they lie from ours.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from solver.inverse_kinematics.solve import solve_inverse_kinematics
from solver.osim.reader import read_osim
from tests.solver.inverse_kinematics.marked import cost_of
from tests.solver.oracle import test_inverse_kinematics as oracle
from tests.solver.oracle.two_bodies import opensim

REPEATS = 5


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=100, help="of each trial that OpenSim solves")
    frames = parser.parse_args().frames
    opensim.Logger.setLevelString("Off")
    print("| trial | frames | ours | OpenSim 1e-5 | ratio | OpenSim 1e-9 | ratio | its cost − ours, 1e-9 | q, 1e-9 |")
    print("|---|---:|---:|---:|---:|---:|---:|---:|---:|")
    for name, trial in oracle.TRIALS.items():
        print(_row(name, trial, frames), flush=True)


def _row(name: str, trial: oracle.Trial, most: int) -> str:
    model = read_osim(trial.model)
    tasks, observed = oracle.tracked(trial, model)
    rate = float(opensim.TimeSeriesTableVec3(str(trial.markers)).getTableMetaDataString("DataRate"))
    observed = observed[:most]
    whole = replace(trial, end=(len(observed) - 1.5) / rate)
    solution = solve_inverse_kinematics(model, observed, tasks)  # compiles
    ours = min(_processor_s(lambda: solve_inverse_kinematics(model, observed, tasks)) for _ in range(REPEATS))
    theirs = {}
    for accuracy in (1e-5, 1e-9):
        oracle.ACCURACY = accuracy
        with tempfile.TemporaryDirectory() as folder:
            began = time.process_time()
            found = oracle.solved_by_opensim(whole, model, Path(folder))
            theirs[accuracy] = (time.process_time() - began) / len(found), found
    each, near = ours / len(observed), theirs[1e-9][1]
    above = (cost_of(model, tasks, observed[: len(near)], near) - solution.cost[: len(near)]).max()
    away = np.abs(near - solution.coordinates[: len(near)]).max()
    cells = [name, str(len(observed)), _ms(each)]
    for took, _ in theirs.values():
        cells += [_ms(took), f"{took / each:.0f}"]
    return f"| {' | '.join([*cells, f'{above:.0e} m²', f'{away:.0e} rad'])} |"


def _processor_s(work: Callable[[], object]) -> float:
    began = time.process_time()
    work()
    return time.process_time() - began


def _ms(seconds: float) -> str:
    return f"{1e3 * seconds:.3f} ms"


if __name__ == "__main__":
    main()
