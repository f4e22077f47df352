"""Time of the whole published study: 10 curves × 31 rest lengths × all frames.

    python -m benchmarks.assessment [--motion FLX01.mot]

Prints the study cell by cell beside the published tables, and its time.
"""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from benchmarks.command_line import parse_options
from documents.interval import plus_minus
from solver.bundled import bundled_model
from solver.model import Model
from solver.motion import Kinematics, decimate, differentiate, read_motion
from solver.suit.assessment import Assessment, assess
from solver.suit.cord import Condition
from solver.suit.scenarios import LoadedMotion
from solver.suit.suit import read_suit
from tests.fitting.experiment import PUBLISHED
from tests.solver.published import STUDY, study_cuffs
from tests.solver.references import SHARED

ASSUMED_ERRORS = (0.03, 0.1, 0.05)
"""Relative; the publication has no covariance."""
READINGS = (("at_reference", 1), ("rest_length", 1), ("lowest_cost", 1), ("permissible_error", 100))


def main() -> None:
    options = parse_options(__doc__, motion=Path)
    model = bundled_model()
    kinematics = differentiate(read_motion(options.motion or SHARED / "motions" / "FLX01.mot", model))
    study(model, decimate(kinematics, 40))  # compiles at the first call
    whole, seconds = study(model, kinematics)
    print(f"{len(kinematics.time)} frames: {seconds:.1f} s, {whole.unsolved} unsolved\n")
    print_cells(whole)
    print_reductions(whole)
    ours = 1e3 * seconds / whole.scenarios / len(kinematics.time)
    print(f"a frame of a scenario: {1e3 * ours:.0f} µs of wall time, everything shared included")


def study(model: Model, kinematics: Kinematics) -> tuple[Assessment, float]:
    """The assessment of the published cuffs and the seconds it took."""
    began = time.perf_counter()
    found = assess(LoadedMotion(model, kinematics), read_suit(), study_cuffs(ASSUMED_ERRORS))
    return found, time.perf_counter() - began


def print_cells(found: Assessment) -> None:
    print("| condition | arm cuff | cost at 0.74 m | best rest length [m] | cost there | width [cm] |")
    print("|---|---|---|---|---|---|")
    for curve in found.curves:
        published = zip(READINGS, STUDY[curve.condition, curve.cuff], strict=True)
        figures = [(curve.figures[name], scale, known) for (name, scale), known in published]
        cells = [f"{plus_minus(one.value or np.nan, one.ci95, scale, 3)} ({known:g})" for one, scale, known in figures]
        print(f"| {curve.condition} | {curve.cuff or ''} | {' | '.join(cells)} |")


def print_reductions(found: Assessment) -> None:
    """Reduction of mean activation by group of muscles at the reference rest length, as the study's Fig. 10 has it."""
    arm = [cuff for cuff in PUBLISHED if cuff != "waist"]
    shown: list[tuple[Condition, str | None]] = [("rigid", None), *(("both", cuff) for cuff in arm)]
    curves = {(curve.condition, curve.cuff): curve for curve in found.curves}
    print("\nreduction of mean activation at 0.74 m [%]:  " + "  ".join(" ".join(filter(None, pair)) for pair in shown))
    for group in read_suit().groups:
        values = [curves[pair].reduction[group].value for pair in shown]
        print(f"{group:20}" + "".join("     –" if value is None else f"{100 * value:6.0f}" for value in values))


if __name__ == "__main__":
    main()
