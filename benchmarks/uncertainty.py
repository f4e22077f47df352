"""The uncertainty budget of the published cuffs on the bundled body: table, indices, processor time and memory.

    python -m benchmarks.uncertainty [--motion FLX01.mot] [--people 1000] [--indices 128] [--picture uncertainty.svg]

Prints the figures of docs/uncertainty.md: Tables 3 and 4 of the paper with intervals of total uncertainty, the
probabilities of the statements on the cuffs, Sobol indices, and time and memory. `--folder` keeps finished tasks, so
that an interrupted run continues.
"""

from __future__ import annotations

import argparse
import resource
import sys
import time
from pathlib import Path

import numpy as np

from benchmarks.assessment import CUFFS, PUBLISHED
from documents.interval import plus_minus
from solver.bundled import bundled_model
from solver.cuff import CuffParameters
from solver.motion import differentiate
from solver.suit.assessment import Assessment, assess
from solver.suit.scenarios import LoadedMotion
from solver.suit.suit import read_suit
from solver.uncertainty.indices import SobolIndices
from solver.uncertainty.total import DrawnPeople, IndexedFigure
from station.assessment.budget_file import read_budget
from station.assessment.case import AssessedCase
from station.assessment.decision_json import plain_decision
from station.assessment.people_run import PeopleRun, assess_people
from station.sources import motion_of

RELATIVE_ERRORS = (0.01, 0.05, 0.02)
"""Of stiffness, damping and migration: the fit of one donning; the publication has none."""


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    arguments.add_argument("--motion", type=Path)
    arguments.add_argument("--people", type=int, default=1000)
    arguments.add_argument("--indices", type=int, default=0)
    arguments.add_argument("--picture", type=Path)
    arguments.add_argument("--folder", type=Path)
    chosen = arguments.parse_args()
    model, suit = bundled_model(), read_suit()
    kinematics = differentiate(motion_of(chosen.motion, model))
    motion, cuffs = LoadedMotion(model, kinematics), published_cuffs()
    assessment = assess(motion, suit, cuffs)
    case = AssessedCase(model, kinematics, suit)
    run = PeopleRun(read_budget(people=chosen.people), chosen.folder, index_blocks=chosen.indices)
    began = time.perf_counter(), time.process_time()
    found, people = assess_people(run, case, motion, cuffs, assessment, Clock().report)
    wall, processor = time.perf_counter() - began[0], time.process_time() - began[1]
    if people is None or found.uncertainty is None:
        raise SystemExit("no source of uncertainty varies")
    print_tables(found)
    for basis, entry in plain_decision(found.uncertainty, people.indices, assessment.reference_rest_length).items():
        if isinstance(entry, dict) and "text" in entry:
            print(f"\n{basis}: {entry['text']}")
            for pair in entry.get("pairs", ()):
                print(f"  {pair}")
    print_indices(people)
    if chosen.picture and people.indices:
        draw_indices(people, chosen.picture)
    unit = 1e6 if sys.platform == "darwin" else 1e3
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit
    print(f"\ntogether: {wall:.0f} s, {processor:.0f} s of processor, {memory:.0f} MB")


class Clock:
    """Prints the processor time of every stage, one after the other."""

    def __init__(self) -> None:
        self.began = time.perf_counter(), time.process_time()

    def report(self, stage: str, done: int, total: int) -> None:
        if done == total:
            wall, processor = time.perf_counter() - self.began[0], time.process_time() - self.began[1]
            self.began = time.perf_counter(), time.process_time()
            print(f"{stage}: {total} in {wall:.0f} s, {processor:.0f} s of processor", flush=True)


def published_cuffs() -> list[CuffParameters]:
    return [
        CuffParameters(
            name,
            "waist" if name == "waist" else "arm",
            *values,
            np.diag([(error * value) ** 2 for error, value in zip(RELATIVE_ERRORS, values, strict=True)]),
        )
        for name, values in CUFFS.items()
    ]


def print_tables(found: Assessment) -> None:
    if found.uncertainty:
        print(f"{found.uncertainty.people} people, {found.uncertainty.solved} solved; ± is half of the 95 % interval\n")
    print("| condition | arm cuff | cost at 0.74 m | best rest length [m] | cost there | width [cm] |")
    print("|---|---|---|---|---|---|")
    for curve in found.curves:
        figures = curve.figures
        cells = [
            f"{plus_minus(figures[name].value or np.nan, figures[name].ci95, scale, 3)} ({published:g})"
            for (name, scale), published in zip(
                (("at_reference", 1.0), ("rest_length", 1.0), ("lowest_cost", 1.0), ("permissible_error", 100.0)),
                PUBLISHED[curve.condition, curve.cuff],
                strict=True,
            )
        ]
        print(f"| {curve.condition} | {curve.cuff or ''} | {' | '.join(cells)} |")


def group_names_of(people: DrawnPeople) -> tuple[str, ...]:
    return next((found.groups for found in people.indices.values() if found), ())


def print_indices(people: DrawnPeople) -> None:
    groups = group_names_of(people)
    if groups:
        print(f"\n| figure | sd | {' | '.join(groups)} |\n|---|---|{'---|' * len(groups)}")
    for (figure, cuffs), found in people.indices.items():
        if found is not None:
            cells = [
                f"{first:.2f} ± {half:.2f}, {all_:.2f} ± {all_half:.2f}"
                for first, half, all_, all_half in zip(
                    found.first, found.first_half_width, found.total, found.total_half_width, strict=True
                )
            ]
            print(f"| {figure} {' − '.join(cuffs)} | {np.sqrt(found.variance):.4f} | {' | '.join(cells)} |")


def draw_indices(people: DrawnPeople, path: Path) -> None:
    """Bars of first-order (full) and total indices (outline) with their intervals."""
    import matplotlib.pyplot as plt

    shown: dict[str, SobolIndices] = {
        label: found for figure, label in FIGURE_LABELS.items() if (found := people.indices.get(figure)) is not None
    }
    figure, panels = plt.subplots(1, len(shown), figsize=(3.1 * len(shown), 3.0), sharey=True, layout="constrained")
    for panel, (label, found) in zip(np.atleast_1d(panels), shown.items(), strict=True):
        places = np.arange(len(found.groups))
        panel.bar(places - 0.2, found.first, 0.4, yerr=found.first_half_width, color="#0072b2", label="first order")
        panel.bar(places + 0.2, found.total, 0.4, yerr=found.total_half_width, color="#e69f00", label="total")
        panel.set_xticks(places, found.groups, rotation=40)
        panel.set_title(label, fontsize=9)
        panel.axhline(0.0, color="0.4", linewidth=0.6)
    np.atleast_1d(panels)[0].set_ylabel("share of the variance")
    np.atleast_1d(panels)[-1].legend(fontsize=8, frameon=False)
    figure.savefig(path, metadata={"Date": None} if path.suffix == ".svg" else None)


FIGURE_LABELS: dict[IndexedFigure, str] = {
    ("effort_at_reference", ("tube",)): "effort with tube at 0.74 m",
    ("best_rest_length", ("tube",)): "best rest length, tube",
    ("difference_at_reference", ("tube", "elbow")): "tube − elbow at 0.74 m",
    ("difference_at_best", ("tube", "elbow")): "tube − elbow, each at its best",
}

if __name__ == "__main__":
    main()
