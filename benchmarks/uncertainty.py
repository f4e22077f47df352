"""The uncertainty budget of the published cuffs on the bundled body: table, indices, processor time and memory.

    python -m benchmarks.uncertainty [--motion FLX01.mot] [--people 1000] [--indices 128] [--picture uncertainty.svg]
    python -m benchmarks.uncertainty --people 0 [--motion FLX01.mot]
    python -m benchmarks.uncertainty --persons 200 [--first SEED] [--live]

Prints the figures of docs/uncertainty.md: Tables 3 and 4 of the paper with intervals of total uncertainty, the
probabilities of the statements on the cuffs, Sobol indices, and time and memory. With `--people 0`, the tables without
intervals beside the published ones, as in docs/assessment.md.

With `--persons`, the part of simulated persons (tests/solver/personalisation/measured_person.py) whose true angles,
effort and best rest length lie in their 95 % intervals, from body, motion and points of the cord alone: rigid cuffs,
muscles as the model has them. Standard errors are those between persons. "live" is the second raise as a stream, on the
body of the pose and the first raise; with `--live` it is alone.
"""

import resource
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from operator import attrgetter
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.command_line import parse_options
from documents.interval import plus_minus
from fitting.uncertainty import NORMAL_95
from solver.bundled import bundled_model
from solver.inverse_kinematics.solve import assemble, solve_inverse_kinematics
from solver.model import Model
from solver.motion import Kinematics, Motion, differentiate
from solver.personalisation.estimate import BodyEstimate, estimate_body, within_ranges
from solver.personalisation.segment_masses import set_arm_masses
from solver.personalisation.wearer_motion import WearerMotion, smooth_wearer
from solver.redundancy.motion_solution import LoadedMotion
from solver.scaling import Scaling, scale_model
from solver.stream.stream_solver import StreamSolver
from solver.suit.assessment import Assessment, assess
from solver.suit.cord import Condition
from solver.suit.digitised_points import fitted_to, suit_from_markers
from solver.suit.suit import Suit, read_suit
from solver.uncertainty.factors import normal_scores, unit_sample
from solver.uncertainty.indices import SobolIndices
from solver.uncertainty.people import PeopleCase, solve_people
from solver.uncertainty.sources import BodySpread, UncertaintySources
from solver.uncertainty.total import INFEASIBLE_MOTION, DrawnPeople, IndexedFigure, mark_infeasible
from solver.uncertainty.varied_motion import DrawnMotion
from station.assessment.budget_file import read_budget
from station.assessment.case import AssessedCase
from station.assessment.people_run import PeopleRun, assess_people
from station.assessment.uncertainty_json import decision_entry
from station.defaults import LEAST_DRAWS
from station.sources import resolve_motion
from tests.fitting.experiment import PUBLISHED
from tests.solver.personalisation.measured_person import MARKERS, RATE, MeasuredPerson, measure_person
from tests.solver.published import STUDY, study_cuffs

Array = NDArray[np.float64]
BEGAN = time.perf_counter()

RELATIVE_ERRORS = (0.01, 0.05, 0.02)
"""Of stiffness, damping and migration: the fit of one donning; the publication has none."""
READINGS = (("at_reference", 1), ("rest_length", 1), ("lowest_cost", 1), ("permissible_error", 100))


def main() -> None:
    chosen = parse_options(__doc__, motion=Path, people=1000, indices=0, picture=Path, persons=0, first=0, live=False)
    if chosen.persons:
        print_coverage(range(chosen.first, chosen.first + chosen.persons), cover_live if chosen.live else cover_person)
        return
    model, suit = bundled_model(), read_suit()
    kinematics = differentiate(resolve_motion(chosen.motion, model))
    motion, cuffs = LoadedMotion(model, kinematics), study_cuffs(RELATIVE_ERRORS)
    assessment = assess(motion, suit, cuffs)
    if not chosen.people:
        print_cells(assessment)
        print_reductions(assessment)
        print(f"\n{len(kinematics.time)} frames, {assessment.unsolved} unsolved: {spent()}")
        return
    case = AssessedCase(model, kinematics, suit)
    run = PeopleRun(read_budget(people=chosen.people), index_blocks=chosen.indices)
    found, people = assess_people(run, case, motion, cuffs, assessment, report)
    end = spent()
    if people is None or found.uncertainty is None:
        raise SystemExit("no source of uncertainty varies")
    print(f"{found.uncertainty.people} people, {found.uncertainty.solved} solved; ± is half of the 95 % interval\n")
    print_cells(found)
    decision = decision_entry(found.uncertainty, people.indices, assessment.reference_rest_length)
    for basis, entry in (("at_reference", decision.at_reference), ("at_best", decision.at_best)):
        print(f"\n{basis}: {entry.text}")
        for pair in entry.pairs:
            print(f"  {pair}")
    print_indices(people)
    if chosen.picture and people.indices:
        draw_indices(people, chosen.picture)
    unit = 1e6 if sys.platform == "darwin" else 1e3
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit
    print(f"\ntogether: {end}, {memory:.0f} MB")


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


def spent() -> str:
    """Wall and processor time since the start."""
    return f"{time.perf_counter() - BEGAN:.0f} s, {time.process_time():.0f} s of processor"


def report(stage: str, done: int, total: int) -> None:
    if done == total:
        print(f"{stage}: {total}, {spent()} since the start", flush=True)


def print_indices(people: DrawnPeople) -> None:
    groups = next((found.groups for found in people.indices.values() if found), ())
    if groups:
        print(f"\n| figure | sd | {' | '.join(groups)} |\n|---|---|{'---|' * len(groups)}")
    for (figure, cuffs), found in people.indices.items():
        if found is not None:
            first, total = (found.first, found.first_half_width), (found.total, found.total_half_width)
            parts = ([f"{one:.2f} ± {half:.2f}" for one, half in zip(*part, strict=True)] for part in (first, total))
            cells = map(", ".join, zip(*parts, strict=True))
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


Covered = dict[str, tuple[float, float, float]]
"""Of one person, by figure: whether its interval holds the truth, or the part of frames in which it does; the standard
deviation, as root mean square over frames, and that of the error [deg for an angle].
"""


def print_coverage(seeds: Sequence[int], cover: Callable[[int], Covered]) -> None:
    found = []
    for seed in seeds:
        found.append(cover(seed))
        if len(found) % 50 == 0 or len(found) == len(seeds):
            print_covered(found)


def print_covered(found: Sequence[Covered]) -> None:
    print(f"\n{len(found)} persons\n\n| figure | held by 95 % intervals | standard deviation | RMS error |")
    print("|---|---|---|---|")
    for name in found[0]:
        held, *sizes = np.array([one[name] for one in found]).T
        held = held[np.isfinite(held)]
        if len(held):
            error = np.std(held) / np.sqrt(len(held))
            known = (size[np.isfinite(size)] for size in sizes)
            cells = [f"{np.sqrt(np.mean(size**2)):.3g}" if len(size) else "" for size in known]
            print(f"| {name} | {100 * held.mean():.1f} ± {100 * error:.1f} % ({len(held)}) | {' | '.join(cells)} |")


def cover_person(seed: int) -> Covered:
    """Estimate a simulated person's body and motion from the markers, and assess the suit on draws and on the truth."""
    person, generic = measure_person(seed), bundled_model()
    body, smoothed = estimate_wearer(person.trials)
    drawn = list(smoothed.draw(PERSON_DRAWS, seed))
    angles, efforts = Covered(), Covered()
    for name in person.shoulder.coordinate_names:
        if not name.startswith("ground"):
            truth = np.degrees(person.coordinates[-1][:, person.shoulder.index(name)])
            samples = np.degrees([coordinates[:, generic.coordinate_index(name)] for _, coordinates in drawn])
            low, high = order_statistics(samples)
            error = float(np.sqrt(np.mean((samples.mean(axis=0) - truth) ** 2)))
            is_held = float(np.mean((low < truth) & (truth < high)))
            angles[name] = is_held, float(np.sqrt(np.var(samples, axis=0).mean())), error
    assessed = assess_person(person, scale_model(body.model, smoothed.scaling), smoothed.coordinates, drawn)
    for name, (true, samples) in assessed.items():
        known = samples[np.isfinite(samples)]
        is_enough = np.isfinite(true) and len(known) >= LEAST_DRAWS
        least, most = order_statistics(known) if is_enough else (np.nan, np.nan)
        is_held = float(least < true < most) if is_enough else np.nan
        efforts[name] = is_held, float(np.std(known)), float(known.mean() - true)
    mean = float(np.mean([is_held for is_held, *_ in angles.values()]))
    infeasible = float(np.mean(~np.isfinite(assessed["effort"][1])))
    whole: Covered = {"all angles": (mean, np.nan, np.nan), **angles, **efforts, **cover_live(seed)}
    return whole | {"infeasible draws": (infeasible, np.nan, np.nan)}


def estimate_wearer(trials: Sequence[Array]) -> tuple[BodyEstimate, WearerMotion]:
    """Body and motion of a person from the markers of the trials."""
    generic = bundled_model()
    markers = tuple(generic.marker(name) for name in MARKERS)
    body = estimate_body(generic, markers, trials)
    model, tasks = within_ranges(body.model, body.tasks)
    solved = [(observed, solve_inverse_kinematics(model, observed, tasks)) for observed in trials]
    return body, smooth_wearer(generic, markers, body, solved, solved[-1][1].coordinates)


def cover_live(seed: int) -> Covered:
    """Angles of the raise that is assessed, as a stream on the body of the earlier trials; also by the elevation."""
    person = measure_person(seed)
    *earlier, raised = person.trials
    body, wearer = estimate_wearer(earlier)
    stream = StreamSolver(wearer.skeleton, wearer.tasks, {}, errors=wearer.errors)
    frames = [frame for k, seen in enumerate(raised) for frame in stream.push(k / RATE, seen)] + stream.finish()
    live, stated = np.degrees([(frame.coordinates, frame.standard_deviations[0]) for frame in frames]).swapaxes(0, 1)
    truth = np.degrees(person.coordinates[-1])
    elevation = truth[:, person.shoulder.index("shoulder_elv")]
    covered = Covered()
    for low, high in ((-np.inf, np.inf), *pairwise(ELEVATIONS)):
        is_meant = (elevation >= low) & (elevation < high)
        for name in ("plane_elv", "shoulder_elv", "axial_rot"):
            place = body.model.coordinate_index(name)
            error = (live[:, place] - truth[:, person.shoulder.index(name)])[is_meant]
            deviation = stated[is_meant, place]
            title = f"live, {name}" + (f" from {low} to {high} degrees" if np.isfinite(low) else "")
            covered[title] = (np.nan, np.nan, np.nan)
            if is_meant.any():
                is_held = float(np.mean(np.abs(error) < NORMAL_95 * deviation))
                covered[title] = is_held, float(np.sqrt(np.mean(deviation**2))), float(np.sqrt(np.mean(error**2)))
    return covered


def assess_person(
    person: MeasuredPerson, body: Model, coordinates: Array, drawn: Sequence[tuple[Scaling, Array]]
) -> dict[str, tuple[float, Array]]:
    """Effort at the reference rest length and best rest length [m]: of the truth, and of the draws (draws,)."""
    generic = bundled_model()
    true_body = scale_model(generic, Scaling(person.factors, keeps_masses=True))
    truth = np.tile(generic.default_coordinates, (len(coordinates), 1))
    truth[:, [generic.coordinate_index(name) for name in person.shoulder.coordinate_names]] = person.coordinates[-1]
    suits, cases = list[Suit](), []
    for model, motion, cord in ((true_body, truth, person.cord), (body, coordinates, person.cord_markers)):
        worn = suit_from_markers(read_suit(), model, motion, cord).suit
        if not suits:
            suits.append(fitted_to(worn, model, motion[0], (read_suit(), generic, assemble(generic))))
        known = suits[0]
        suits.append(replace(worn, rest_lengths=known.rest_lengths, reference_rest_length=known.reference_rest_length))
        kinematics = smoothed_kinematics(motion)
        motions = () if motion is truth else tuple(DrawnMotion(size, smoothed_kinematics(one)) for size, one in drawn)
        loaded = LoadedMotion(set_arm_masses(model, MASS), kinematics)
        cases.append(PeopleCase(loaded, suits[-1], None, (), PERSON_SOURCES, EVERY, motions))
    count = len(drawn)
    scores = np.zeros((count + 1, sum(factor.size for factor in cases[1].factors)))
    scores[1:] = normal_scores(unit_sample(cases[1].factors, count, "latin_hypercube", seed=1))
    true_scores = np.zeros((1, sum(factor.size for factor in cases[0].factors)))
    ((at_truth,), (of_draws,)) = (
        mark_infeasible(solve_people(case, rows, workers=1), has_assessed=True).values()
        for case, rows in zip(cases, (true_scores, scores), strict=True)
    )
    is_left_out = of_draws.outcome[1:] == INFEASIBLE_MOTION
    figures = (
        (float(part(at_truth)[0]), np.where(is_left_out, np.nan, part(of_draws)[1:]))
        for part in (attrgetter("at_reference"), attrgetter("rest_length"))
    )
    return dict(zip(("effort", "best rest length"), figures, strict=True))


def smoothed_kinematics(coordinates: Array) -> Kinematics:
    return differentiate(Motion(bundled_model().coordinate_names, np.arange(len(coordinates)) / RATE, coordinates))


def order_statistics(samples: Array) -> tuple[Array, Array]:
    """Between which the next draw lies with 95 %, along the first axis."""
    low, high = np.quantile(samples, (0.025, 0.975), axis=0, method="weibull")
    return low, high


ELEVATIONS = (0, 30, 55, 80, 120)
"""Degrees of elevation between which the live angles are judged apart."""
PERSON_DRAWS, EVERY, MASS = 59, 5, 75.0  # kg
PERSON_SOURCES = replace(UncertaintySources().fit_only, body=BodySpread(0.0, 0.0, 0.01, 0.0))
"""Points of the cord; the rest is drawn with the motion."""

FIGURE_LABELS: dict[IndexedFigure, str] = {
    ("effort_at_reference", ("tube",)): "effort with tube at 0.74 m",
    ("best_rest_length", ("tube",)): "best rest length, tube",
    ("difference_at_reference", ("tube", "elbow")): "tube − elbow at 0.74 m",
    ("difference_at_best", ("tube", "elbow")): "tube − elbow, each at its best",
}

if __name__ == "__main__":
    main()
