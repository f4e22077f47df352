"""Bias, error against the Cramér-Rao bound and coverage of the fit, on cuffs and rigs whose truth is known.

    python benchmarks/fitting.py [--runs 500] [--only T1,T8] [--processes 2]

prints the tables of docs/fitting.md. Every run is a record or donning of the simulated experiments that the tests use,
which import nothing of the fitted law. T1: force at 20 Hz, lag known. T2: 1 kHz, the true lag drawn from its prior.
T9b: markers with a memory. T8: one defect a donning. T9: one law a donning. T12: five pulls, 30° apart.
T17: repeats that really differ.
"""

from __future__ import annotations

import argparse
import math
import resource
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from fitting.cross_checks import check
from fitting.errors_in_variables import C, K, estimate
from fitting.held_tensor import held_tensor
from fitting.output_error import output_error
from fitting.reduction import reduce_trials
from fitting.session import fit_session
from fitting.swung_tensor import swung_tensor
from fitting.tensor import entries_of
from fitting.trial import Trial, build_trial
from fitting.uncertainty import Repeat, combine
from tests.fitting.defects import Law, OddSession
from tests.fitting.experiment import PUBLISHED, Session, Truth, published
from tests.fitting.pulled_in_space import directions, elbow, pulled
from tests.fitting.swinging import swing
from tests.fitting.test_diagnosis import DEFECTS
from tests.fitting.test_model_class import STRONG, WEAK, Rig

LAG_SD = 0.5e-3
Row = tuple[float, ...]
"""Of one run: k, its standard error and bound, c, its standard error and bound, all over the true value."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=500)
    parser.add_argument("--only", default="")
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args()
    wanted = options.only.split(",") if options.only else ["T1", "T2", "T9b", "T8", "T9", "T12", "T17", "speed"]
    with ProcessPoolExecutor(options.processes) as pool:
        for name in wanted:
            for line in REPORTS[name](options.runs, pool):
                print(line, flush=True)


def _estimates(title: str, runs: int, pool: ProcessPoolExecutor, **settings: float) -> Iterator[str]:
    yield f"| {title} | bias k % | RMSE k / bound | cover k % | bias c % | RMSE c / bound | cover c % |"
    yield "|---|---|---|---|---|---|---|"
    for cuff in PUBLISHED:
        rows = np.array(list(pool.map(partial(_one, cuff, **settings), range(runs), chunksize=10)))
        yield f"| {cuff} | " + " | ".join(_judged(rows[:, :3]) + _judged(rows[:, 3:])) + " |"
    yield ""


def _one(cuff: str, seed: int, rate: float, lag_sd: float, colour: float = 0.0) -> Row:
    """One swing of ± 12 N at 1 Hz for 22.5 s with 0.51 N and 0.157 mm of noise, fitted with its lag's prior."""
    k, c, _ = PUBLISHED[cuff]
    record = swing(
        seed,
        k=k,
        c=c,
        rate=min(rate, 250.0),
        seconds=22.5,
        colour=colour,
        lag_sd=lag_sd,
        force_noise=0.51 / math.sqrt(max(1.0, rate / 250.0)),
    )
    solution = estimate(record)
    error = np.sqrt(np.diag(solution.covariance))
    found = (solution.parameters[K], error[K], error[K], solution.parameters[C], error[C], error[C])
    if check(record, solution, 1.0).is_coloured:
        robust = output_error(record, float(solution.parameters[K]), float(solution.parameters[C]))
        if robust:
            found = (
                robust[0].value,
                robust[0].standard_error,
                error[K],
                robust[1].value,
                robust[1].standard_error,
                error[C],
            )
    return tuple(float(value) / scale for value, scale in zip(found, (k, k, k, c, c, c), strict=True))


def _judged(rows: np.ndarray) -> list[str]:
    off = rows[:, 0] - 1
    covered = np.mean(np.abs(off) < 1.96 * rows[:, 1])
    return [
        f"{100 * off.mean():+.2f}",
        f"{np.sqrt(np.mean(off**2)) / np.sqrt(np.mean(rows[:, 2] ** 2)):.2f}",
        f"{100 * covered:.1f}",
    ]


def _causes(runs: int, pool: ProcessPoolExecutor) -> Iterator[str]:
    seeds = range(max(1, runs // 50))
    yield "| T8 defect | named first or second % |"
    yield "|---|---|"
    for name in (*DEFECTS, "none"):
        found = list(pool.map(partial(_is_named, name), seeds))
        yield f"| {name} | {100 * np.mean(found):.0f} |"
    yield ""


def _is_named(name: str, seed: int) -> bool:
    law, rig = DEFECTS.get(name, (Law(), Rig()))
    fitted = fit_session(_donning(law, rig, 1000 + seed, 1))
    (fit,) = fitted.cuffs.values()
    named = [cause.name for cause in fit.diagnosis.causes[:2]] if fit.diagnosis else []
    return name in named or (name == "none" and not named)


def _laws(runs: int, pool: ProcessPoolExecutor) -> Iterator[str]:
    seeds = range(max(1, runs // 50))
    yield "| T9 law | chosen, whole effect % | chosen, a fifth of it % |"
    yield "|---|---|---|"
    for name in ("Kelvin-Voigt", *STRONG):
        shares = [
            f"{100 * np.mean(list(pool.map(partial(_is_chosen, name, law), seeds))):.0f}"
            for law in (STRONG.get(name, Law()), WEAK.get(name))
            if law is not None
        ]
        yield f"| {name} | {' | '.join((*shares, '')[:2])} |"
    yield ""


def _is_chosen(name: str, law: Law, seed: int) -> bool:
    (fit,) = fit_session(_donning(law, Rig(), 2000 + seed, 3)).cuffs.values()
    return fit.classes is not None and fit.classes.name.split(" + ")[0] == name


def _donning(law: Law, rig: Rig, seed: int, repeats: int) -> list[Trial]:
    session = OddSession(law, rig, seed, Truth(friction=1e9, migration=0.0, hold=6.0))
    trials = []
    for repeat in range(1, repeats + 1):
        trials.append(build_trial(*session.static(repeat), f"s{repeat}", "s"))
        trials.append(build_trial(*session.dynamic(repeat), f"d{repeat}", "d"))
    return trials


def _space(runs: int, pool: ProcessPoolExecutor) -> Iterator[str]:
    rows = np.array(list(pool.map(_in_space, range(max(1, 2 * runs // 25)))))
    yield "| T12 tensor | rms error of an entry over the largest % | cover % |"
    yield "|---|---|---|"
    for name, (error, cover) in zip(("K", "C"), rows.transpose(1, 2, 0), strict=True):
        yield f"| {name} | {100 * math.sqrt(np.mean(error)):.2f} | {100 * np.mean(cover):.0f} |"
    yield ""


def _in_space(seed: int) -> list[Row]:
    """Of K and C: mean square error of an entry over the largest, and the part of the entries in their intervals."""
    random = np.random.default_rng(seed)
    space = elbow(random)
    space = replace(space, lag=space.lag_sd * random.standard_normal())
    pulls = enumerate(directions(30), 1)
    trials = [pulled(space, u, test, i, random) for i, u in pulls for test in ("static", "dynamic")]
    reduced, _ = reduce_trials(trials)
    stiffness = held_tensor([each for each in reduced if each.trial.test == "static"], 0.0)
    damping = swung_tensor([each for each in reduced if each.trial.test == "dynamic"], {}, 0.0)
    rows = []
    for tensor, true in ((stiffness, space.stiffness), (damping, space.damping)):
        off = tensor.value - true
        inside = entries_of(np.abs(off)) < tensor.factor * entries_of(tensor.standard_error)
        rows.append((float(np.mean(off**2)) / np.abs(true).max() ** 2, float(np.mean(inside))))
    return rows


def _repeats(runs: int, _pool: ProcessPoolExecutor) -> Iterator[str]:
    yield "| T17 spread between repeats / noise | cover, 2 repeats % | 3 repeats % | 5 repeats % |"
    yield "|---|---|---|---|"
    random = np.random.default_rng(17)
    for spread in (0.0, 0.5, 1.0, 2.0, 4.0, 8.0):
        shares = []
        for count in (2, 3, 5):
            means = np.hypot(1.0, spread) * random.standard_normal((4 * runs, count))
            intervals = [combine([Repeat(value, 1.0) for value in row]).ci95 for row in means]
            shares.append(f"{100 * np.mean([low < 0 < high for low, high in intervals]):.1f}")
        yield f"| {spread:g} | {' | '.join(shares)} |"
    yield ""


def _speed(_runs: int, _pool: ProcessPoolExecutor) -> Iterator[str]:
    trials = []
    for cuff in PUBLISHED:
        session = Session(published(cuff), 3)
        for repeat in (1, 2, 3):
            trials.append(build_trial(*session.static(repeat), f"{cuff}-static-{repeat}", "s"))
            trials.append(build_trial(*session.dynamic(repeat), f"{cuff}-dynamic-{repeat}", "d"))
    fit_session(trials[:2])
    for what, some in (
        ("one static and one dynamic trial, 30 s at 1 kHz", trials[:2]),
        ("a session of 24 trials", trials),
    ):
        began, used = time.perf_counter(), time.process_time()
        fit_session(some)
        yield f"{what}: {time.perf_counter() - began:.2f} s, {time.process_time() - used:.2f} s of processor"
    yield f"largest memory of the process: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB"


REPORTS = {
    "T1": lambda runs, pool: _estimates("T1: 20 Hz, lag known", runs, pool, rate=20.0, lag_sd=0.0),
    "T2": lambda runs, pool: _estimates("T2: 1 kHz, lag ± 0.5 ms", runs, pool, rate=1000.0, lag_sd=LAG_SD),
    "T9b": lambda runs, pool: _estimates(
        "T9b: markers' memory 0.05 s", runs // 2, pool, rate=20.0, lag_sd=0.0, colour=0.05
    ),
    "T8": _causes,
    "T9": _laws,
    "T12": _space,
    "T17": _repeats,
    "speed": _speed,
}

if __name__ == "__main__":
    main()
