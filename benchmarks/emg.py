"""EMG of the public trials beside three sets of activations: ours, the published ones and those of static optimisation.

    python -m benchmarks.emg [--method seth_2019]
    python -m benchmarks.emg --simulated 100

Trials of Seth et al. (2019), published activations of Belli et al. (2023), both with the glenohumeral cone. Static
optimisation is that of OpenSim's tool: Σ of all squared controls in each frame by itself, reserve actuators included,
without a cone and without activation dynamics. Prints correlation and lag with 95 % intervals (docs/emg.md), and over
the channels of all trials the mean of Fisher's z, as a correlation, beside the published one.

Needs the public data set beside the repository. Trials, files and their licence are described there.

--simulated prints which part of the intervals of lag and correlation contains the truth, over so many simulated pairs
of EMG and activation for each kind of noise (tests/fitting/emg/simulated.py).
"""

from __future__ import annotations

import argparse
import gzip
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from fitting.emg.envelopes import EnvelopeSettings
from fitting.emg.shape import ShapeComparison, ShapeOutcome
from solver.motion import differentiate, read_motion
from solver.osim.model_reader import read_osim
from solver.redundancy.mechanics import evaluate_motion
from solver.redundancy.problem import build_redundancy
from solver.redundancy.redundancy_options import RedundancyOptions
from solver.redundancy.sequence import solve_redundancy
from solver.time_series_table import write_table
from station.emg.comparison import ConditionFiles, compare_emg
from station.emg.trials import EnvelopeSection
from tests.fitting.emg.simulated import NOISES, compare_pair, emg_pair

DATA = Path(__file__).parents[1].parent / "shared" / "data"
TRIALS: Mapping[str, tuple[str, ...]] = {"FLX01": (), "ABD02": (), "SHRUG01": ("plane_elv", "axial_rot")}
"""Trial → coordinates whose accelerations are not tracked."""
SOURCES = ("ours", "published", "static optimisation")
LABELS = ("AD", "MD", "PD", "TS", "TM", "TI", "Infra", "SA", "LatD", "PM_Sternal", "PM_Clav", "TMajor", "Bic", "Tric")
SETUP = """
[file]
rate_hz = 1000.0
labels = {labels}
[envelope]
method = "{method}"
"""
"""One of the files has no header; its columns are those of the others."""
WITHOUT_DYNAMICS_S = 1e6
"""Between frames, so that activations may take any value."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--method", default="linear_envelope", choices=("linear_envelope", "rms", "seth_2019"))
    parser.add_argument("--simulated", type=int, default=0)
    options = parser.parse_args()
    settings = EnvelopeSection(method=options.method).settings()
    if options.simulated:
        print_coverage(settings, options.simulated)
    else:
        print_sources(options.method)


def print_coverage(settings: EnvelopeSettings, pairs: int) -> None:
    print("| noise | lag identified % | lag covered % | half of its interval [ms] | correlation covered % |")
    print("|---|---:|---:|---:|---:|")
    found = {noise: [compare_pair(emg_pair(noise, settings, i), settings) for i in range(pairs)] for noise in NOISES}
    together = [row for rows in found.values() for row in rows]
    for noise, rows in (*found.items(), ("all", together)):
        known, lag, width, correlation = np.array(rows, dtype=float).T
        error = 100 * np.sqrt([part.mean() * (1 - part.mean()) / len(rows) for part in (lag, correlation)])
        print(
            f"| {noise} | {100 * known.mean():.0f} | {100 * lag.mean():.0f} ± {error[0]:.0f} "
            f"| {500 * np.median(width):.0f} | {100 * correlation.mean():.0f} ± {error[1]:.0f} |"
        )


def print_sources(method: str) -> None:
    found = compare_sources(method)
    print(f"| trial | channel | {' | '.join(SOURCES)} |")
    print("|---|---|" + "---|" * len(SOURCES))
    for (trial, channel), comparisons in found.items():
        print(f"| {trial} | {channel} | {' | '.join(_cell(comparisons[source]) for source in SOURCES)} |")
    pairs = [comparisons for comparisons in found.values() if _all_known(comparisons)]
    print(f"\nover the {len(pairs)} channels in which all three are active, mean of Fisher's z as a correlation:")
    for source in SOURCES:
        z = np.array([np.arctanh(comparisons[source].correlation) for comparisons in pairs])
        print(f"- {source}: {np.tanh(z.mean()):.2f}")


def compare_sources(method: str) -> dict[tuple[str, str], dict[str, ShapeComparison]]:
    """Trial and channel → source → comparison of the shapes."""
    found: dict[tuple[str, str], dict[str, ShapeComparison]] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        setup = folder / "setup.toml"
        setup.write_text(SETUP.format(labels=list(LABELS), method=method), encoding="utf-8")
        for trial, free in TRIALS.items():
            emg = folder / f"{trial}.exp"
            emg.write_bytes(gzip.decompress((DATA / "markers" / f"{trial}_emg.exp.gz").read_bytes()))
            for source, activations in zip(SOURCES, activation_files(folder, trial, free), strict=True):
                compared = compare_emg(ConditionFiles((emg,), (activations,)), ConditionFiles(()), (), setup)
                for channel, comparison in compared.trials[0].comparisons.items():
                    found.setdefault((trial, channel), {})[source] = comparison
    return found


def activation_files(folder: Path, trial: str, free: Sequence[str]) -> tuple[Path, Path, Path]:
    """Tables of activations, in the order of SOURCES."""
    model = read_osim(DATA / "models" / "TSM_subject_noWeight.osim")
    kinematics = differentiate(read_motion(DATA / "motions" / f"{trial}.mot", model))
    mechanics = evaluate_motion(model, kinematics)
    ours = build_redundancy(model, mechanics, RedundancyOptions(free_coordinates=tuple(free)))
    alone = RedundancyOptions(
        has_glenoid_cone=False, free_coordinates=tuple(free), reserve_weight=1.0, unweighted_coordinates=()
    )
    static = replace(build_redundancy(model, mechanics, alone), interval=WITHOUT_DYNAMICS_S)
    solved = []
    for source, problem in (("ours", ours), ("static", static)):
        activations = solve_redundancy(problem).controls[0, :, : len(model.muscles)]
        solved.append(folder / f"{trial}_{source}.csv")
        write_table(solved[-1], model.muscle_names, kinematics.time, activations)
    return solved[0], DATA / "published" / f"{trial}_gh.csv", solved[1]


def _all_known(comparisons: Mapping[str, ShapeComparison]) -> bool:
    return all(np.isfinite(comparison.correlation) for comparison in comparisons.values())


def _cell(found: ShapeComparison) -> str:
    if not np.isfinite(found.correlation):
        return "at rest" if found.outcome is ShapeOutcome.MODEL_AT_REST else "–"
    low, high = found.correlation_ci95
    text = f"{found.correlation:.2f} ({low:.2f} to {high:.2f})"
    if found.outcome is ShapeOutcome.COMPARED:
        first, last = found.lag_ci95
        text += f", {1e3 * found.lag:.0f} ms ({1e3 * first:.0f} to {1e3 * last:.0f})"
    return text


if __name__ == "__main__":
    main()
