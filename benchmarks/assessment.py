"""Time of the whole published study: 10 curves × 31 rest lengths × all frames.

    python benchmarks/assessment.py [--motion FLX01.mot]

Prints the study cell by cell beside the published tables, and the time for different numbers of frames.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from documents.interval import plus_minus
from solver.bundled import bundled_model
from solver.cuff import CuffParameters
from solver.model import Model
from solver.motion import Kinematics, decimate, differentiate, read_motion
from solver.suit.assessment import Assessment, assess
from solver.suit.cord import Condition
from solver.suit.scenarios import LoadedMotion
from solver.suit.suit import read_suit

SHARED = Path(__file__).parents[2] / "shared"

# stiffness [N/m], damping [N s/m], migration [m], as published
CUFFS = {
    "waist": (2140.0, 124.0, 0.012),
    "hand": (8520.0, 210.0, 0.012),
    "tube": (5510.0, 38.0, 0.009),
    "elbow": (2530.0, 139.0, 0.022),
}
ASSUMED_ERRORS = (0.03, 0.1, 0.05)
"""Relative; the publication has no covariance."""
# cost at 0.74 m, best rest length [m], cost there, permissible error [cm]
PUBLISHED = {
    ("rigid", None): (0.787, 0.74, 0.79, 3.9),
    ("shift", "hand"): (0.829, 0.71, 0.79, 4.1),
    ("visco_elastic", "hand"): (0.798, 0.72, 0.79, 5.2),
    ("both", "hand"): (0.858, 0.70, 0.79, 5.3),
    ("shift", "tube"): (0.829, 0.72, 0.79, 3.9),
    ("visco_elastic", "tube"): (0.803, 0.72, 0.79, 5.4),
    ("both", "tube"): (0.854, 0.70, 0.79, 5.4),
    ("shift", "elbow"): (0.869, 0.71, 0.78, 3.7),
    ("visco_elastic", "elbow"): (0.818, 0.70, 0.79, 6.0),
    ("both", "elbow"): (0.877, 0.68, 0.79, 5.8),
}
READINGS = (("at_reference", 1), ("rest_length", 1), ("lowest_cost", 1), ("permissible_error", 100))


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    arguments.add_argument("--motion", type=Path, default=SHARED / "data" / "motions" / "FLX01.mot")
    chosen = arguments.parse_args()
    model = bundled_model()
    kinematics = differentiate(read_motion(chosen.motion, model))
    study(model, decimate(kinematics, 40))  # compiles at the first call
    for every in (4, 2):
        frames = decimate(kinematics, every)
        print(f"{len(frames.time)} frames: {study(model, frames)[1]:.1f} s")
    whole, seconds = study(model, kinematics)
    print(f"{len(kinematics.time)} frames: {seconds:.1f} s, {whole.unsolved} unsolved\n")
    print_cells(whole)
    print_reductions(whole)
    ours = 1e3 * seconds / whole.scenarios / len(kinematics.time)
    print(f"a frame of a scenario: {1e3 * ours:.0f} µs of wall time, everything shared included")


def study(model: Model, kinematics: Kinematics) -> tuple[Assessment, float]:
    """The assessment of the published cuffs and the seconds it took."""
    cuffs = published_cuffs(ASSUMED_ERRORS)
    began = time.perf_counter()
    found = assess(LoadedMotion(model, kinematics), read_suit(), cuffs)
    return found, time.perf_counter() - began


def published_cuffs(relative_errors: Sequence[float]) -> list[CuffParameters]:
    """The cuffs with these standard errors of stiffness, damping and migration over the value."""
    cuffs = []
    for name, values in CUFFS.items():
        covariance = np.diag([(error * value) ** 2 for error, value in zip(relative_errors, values, strict=True)])
        cuffs.append(CuffParameters(name, "waist" if name == "waist" else "arm", *values, covariance))
    return cuffs


def print_cells(found: Assessment) -> None:
    print("| condition | arm cuff | cost at 0.74 m | best rest length [m] | cost there | width [cm] |")
    print("|---|---|---|---|---|---|")
    for curve in found.curves:
        published = zip(READINGS, PUBLISHED[curve.condition, curve.cuff], strict=True)
        figures = [(curve.figures[name], scale, known) for (name, scale), known in published]
        cells = [f"{plus_minus(one.value or np.nan, one.ci95, scale, 3)} ({known:g})" for one, scale, known in figures]
        print(f"| {curve.condition} | {curve.cuff or ''} | {' | '.join(cells)} |")


def print_reductions(found: Assessment) -> None:
    """Reduction of mean activation by group of muscles at the reference rest length, as the study's Fig. 10 has it."""
    arm = [cuff for cuff in CUFFS if cuff != "waist"]
    shown: list[tuple[Condition, str | None]] = [("rigid", None), *(("both", cuff) for cuff in arm)]
    curves = {(curve.condition, curve.cuff): curve for curve in found.curves}
    print("\nreduction of mean activation at 0.74 m [%]:  " + "  ".join(" ".join(filter(None, pair)) for pair in shown))
    for group in read_suit().groups:
        values = [curves[pair].reduction[group].value for pair in shown]
        print(f"{group:20}" + "".join("     –" if value is None else f"{100 * value:6.0f}" for value in values))


if __name__ == "__main__":
    main()
