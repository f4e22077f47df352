"""Bias, error against the Cramér-Rao bound and coverage of the fit, on cuffs and rigs whose truth is known.

    python -m benchmarks.fitting [--runs 500] [--only T1,T9] [--processes 2]

prints the tables of docs/fitting.md. Every run is a record or donning of the simulated experiments of the tests,
which are independent of the fitted law. T1: force at 20 Hz, lag known. T2: 1 kHz, the true lag drawn from its prior.
T3: 20 Hz without a sync line, half a sample off. T9b: markers with correlated noise. T10, T11: hidden markers,
and ghost markers. T9: one law in every donning. T17: repeats with true differences. Runs are divided for donnings: T3,
T10 and T11 by 10, T9 by 50.
"""

import math
import resource
import time
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from benchmarks.command_line import parse_options
from fitting.dynamic.cross_checks import check, output_error
from fitting.dynamic.damping import fit_damping
from fitting.dynamic.errors_in_variables import C, K, Swing, estimate
from fitting.pull.pull import make_pulls
from fitting.session import fit_session
from fitting.trial.clocks import DRIFT_PRIOR_SD, LagUncertainty
from fitting.trial.trial import Trial, build_trial
from fitting.uncertainty import Repeat, combine
from recordings.manifest import Timing
from tests.fitting.defects import Law, OddSession
from tests.fitting.experiment import PUBLISHED, Session, Truth, published
from tests.fitting.laws.test_model_class import STRONG, WEAK, Rig
from tests.fitting.pulls import swing

LAG_SD = 0.5e-3
Row = tuple[float, ...]
"""Of one run: k, its standard error and bound, c, its standard error and bound, all over the true value."""


def main() -> None:
    options = parse_options(__doc__, runs=500, only="", processes=2)
    wanted = options.only.split(",") if options.only else list(REPORTS)
    with ProcessPoolExecutor(options.processes) as pool:
        for name in wanted:
            for line in REPORTS[name](options.runs, pool):
                print(line, flush=True)


def _table(columns: str, rows: Iterable[Iterable[str]]) -> Iterator[str]:
    yield f"| {columns} |"
    yield f"|{'---|' * (columns.count('|') + 1)}"
    yield from (f"| {' | '.join(cells)} |" for cells in rows)
    yield ""


def _estimates(title: str, runs: int, pool: ProcessPoolExecutor, **settings: Any) -> Iterator[str]:
    def row(cuff: str) -> list[str]:
        found = np.array(list(pool.map(partial(_one, cuff, **settings), range(runs), chunksize=10)))
        return [cuff, *_judged(found[:, :3]), *_judged(found[:, 3:])]

    quantities = " | ".join(f"bias {name} % | RMSE {name} / bound | cover {name} %" for name in "kc")
    yield from _table(f"{title} | {quantities}", map(row, PUBLISHED))


def _one(cuff: str, seed: int, rate: float, lag_sd: float, colour: float = 0.0) -> Row:
    """A swing, fitted with its lag's prior."""
    k, c, _ = PUBLISHED[cuff]
    record = _swing(cuff, seed, rate, lag_sd, colour)
    solution = estimate(record)
    error = np.sqrt(np.diag(solution.covariance))
    found = (solution.parameters[K], error[K], error[K], solution.parameters[C], error[C], error[C])
    if check(record, solution, 1.0).is_coloured:
        robust = output_error(record, float(solution.parameters[K]), float(solution.parameters[C])).estimates
        if robust:
            stiffness, damping = ((one.value, one.standard_error) for one in robust)
            found = (*stiffness, error[K], *damping, error[C])
    return tuple(float(value) / scale for value, scale in zip(found, (k, k, k, c, c, c), strict=True))


def _swing(cuff: str, seed: int, rate: float, lag_sd: float, colour: float) -> Swing:
    """± 12 N at 1 Hz for 22.5 s with 0.51 N and 0.157 mm of noise."""
    k, c, _ = PUBLISHED[cuff]
    force_noise = 0.51 / math.sqrt(max(1.0, rate / 250.0))
    noise = {"colour": colour, "lag_sd": lag_sd, "force_noise": force_noise}
    return swing(seed, k=k, c=c, rate=min(rate, 250.0), seconds=22.5, **noise)


def _is_flagged(colour: float, cuff: str, seed: int) -> bool:
    record = _swing(cuff, seed, 20.0, 0.0, colour)
    return check(record, estimate(record), 1.0).is_coloured


def _judged(rows: np.ndarray) -> list[str]:
    off = rows[:, 0] - 1
    covered = np.mean(np.abs(off) < 1.96 * rows[:, 1])
    return [
        f"{100 * off.mean():+.2f}",
        f"{np.sqrt(np.mean(off**2)) / np.sqrt(np.mean(rows[:, 2] ** 2)):.2f}",
        f"{100 * covered:.1f}",
    ]


def _coloured(runs: int, pool: ProcessPoolExecutor) -> Iterator[str]:
    for memory in (0.05, 0.5):
        title = f"T9b: correlation time {memory:g} s"
        yield from _estimates(title, runs, pool, rate=20.0, lag_sd=0.0, colour=memory)
    for memory in (0.0, 0.05, 0.5):
        flagged = [pool.map(partial(_is_flagged, memory, cuff), range(max(2, runs // 5))) for cuff in PUBLISHED]
        rates = (f"{cuff} {100 * np.mean(list(each)):.0f} %" for cuff, each in zip(PUBLISHED, flagged, strict=True))
        yield f"called coloured with a memory of {memory:g} s: {', '.join(rates)}"
    yield ""


def _half_a_sample(runs: int, pool: ProcessPoolExecutor) -> Iterator[str]:
    def row(cuff: str) -> list[str]:
        found = list(pool.map(partial(_unsynchronised, cuff), range(max(2, runs // 10))))
        called, width, cover = np.mean(found, axis=0)
        return [cuff, f"{100 * called:.0f}", f"{width:.2f}", f"{100 * cover:.0f}"]

    columns = "T3: 20 Hz, no sync line, lag 25 ms | c identified % | interval over k · 25 ms/√3 | cover %"
    yield from _table(columns, map(row, PUBLISHED))


def _unsynchronised(cuff: str, seed: int) -> Row:
    """Of c: whether identified, its interval over that of a lag spread over ± 25 ms, whether it holds the truth."""
    truth = published(cuff, friction=1e9, migration=0.0)
    session, half = Session(truth, 3000 + seed), 0.025
    lag = LagUncertainty(0.0, half / math.sqrt(3), DRIFT_PRIOR_SD)  # what `station import` takes of such files
    trials = []
    for test in (session.static, session.dynamic):
        trial = build_trial(*test(), test.__name__, "")
        slow = slice(seed % 50, None, 50)
        late = trial.force_time[slow] + half * (-1) ** seed
        trials.append(replace(trial, force_time=late, force=trial.force[slow], lag=lag))
    (fit,) = fit_session(trials).cuffs.values()
    if fit.damping is None:
        raise ValueError("a dynamic trial gives a damping, however open")
    low, high = fit.damping.ci95
    spread = 2 * 1.96 * truth.stiffness * half / math.sqrt(3)
    return float("damping" not in fit.missing), (high - low) / spread, float(low < truth.damping < high)


def _seen(runs: int, pool: ProcessPoolExecutor) -> Iterator[str]:
    def rows() -> Iterator[list[str]]:
        for cuff in PUBLISHED:
            found = np.array(list(pool.map(partial(_through_markers, cuff), range(max(2, runs // 10)))))
            whole = np.sqrt(np.mean(found[:, 0, 0] ** 2))
            for kind, (off, is_covered) in zip(SIGHTS, found.transpose(1, 2, 0), strict=True):
                ratio = np.sqrt(np.mean(off**2)) / whole
                yield [f"{cuff}, {kind}", f"{100 * off.mean():+.2f}", f"{ratio:.2f}", f"{100 * is_covered.mean():.0f}"]

    yield from _table("T10, T11: 1 kHz, lag known | bias c % | RMSE c / that of whole records | cover c %", rows())


def _through_markers(cuff: str, seed: int) -> list[tuple[float, float]]:
    """Of the same swing seen whole, with markers hidden and with ghosts: relative error of c, and whether covered."""
    truth = published(cuff, friction=1e9, migration=0.0)
    manifest, tracks = Session(truth, 4000 + seed).dynamic()
    manifest = replace(manifest, timing=Timing(lag_sd_s=0.0, stop_edge="end_of_frame"))
    found = []
    for spoil in SIGHTS.values():
        markers = tracks["/markers"]
        values = spoil(markers.values.copy(), np.random.default_rng(seed))
        trial = build_trial(manifest, {**tracks, "/markers": replace(markers, values=values)}, "d", "d")
        ((pull,), _) = make_pulls([trial])
        damping = fit_damping(pull).damping.estimate
        low, high = damping.ci95
        found.append((damping.value / truth.damping - 1, float(low < truth.damping < high)))
    return found


def _hidden(values: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """30 times a minute each marker, for up to 0.2 s."""
    for marker, frame in _moments(values, 30.0, random):
        values[frame : frame + random.integers(2, 21), marker] = np.nan
    return values


def _ghosts(values: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """5 times a minute each marker, 15 mm away for 1 to 5 frames."""
    for marker, frame in _moments(values, 5.0, random):
        away = random.standard_normal(3)
        values[frame : frame + random.integers(1, 6), marker, :3] += 15.0 * away / np.linalg.norm(away)
    return values


def _moments(values: np.ndarray, a_minute: float, random: np.random.Generator) -> list[tuple[int, int]]:
    """(marker, frame) of what happens to each marker so many times a minute, at 100 Hz."""
    frames, markers = values.shape[:2]
    counts = random.poisson(a_minute * frames / 6000, markers)
    return [(i, int(frame)) for i, count in enumerate(counts) for frame in random.integers(0, frames, count)]


SIGHTS = {"whole": lambda values, _: values, "hidden (T10)": _hidden, "ghosts (T11)": _ghosts}


def _laws(runs: int, pool: ProcessPoolExecutor) -> Iterator[str]:
    def share(name: str, law: Law | None) -> str:
        chosen = pool.map(partial(_is_chosen, name, law), range(max(1, runs // 50))) if law else ()
        return f"{100 * np.mean(list(chosen)):.0f}" if law else ""

    laws = {"Kelvin-Voigt": Law(), **STRONG}
    rows = ([name, share(name, law), share(name, WEAK.get(name))] for name, law in laws.items())
    yield from _table("T9 law | chosen, full effect % | chosen, 20 % of the effect %", rows)


def _is_chosen(name: str, law: Law, seed: int) -> bool:
    (fit,) = fit_session(_donning(law, Rig(), 2000 + seed, 3)).cuffs.values()
    return fit.classes is not None and fit.classes.name.split(" + ")[0] == name


def _donning(law: Law, rig: Rig, seed: int, repeats: int) -> list[Trial]:
    return session_trials(OddSession(law, rig, seed, Truth(friction=1e9, migration=0.0, hold=6.0)), repeats)


def session_trials(session: Session, repeats: int, cuff: str = "") -> list[Trial]:
    """Static and dynamic trials in turn."""
    trials = []
    for repeat in range(1, repeats + 1):
        trials.append(build_trial(*session.static(repeat), f"{cuff}s{repeat}", "s"))
        trials.append(build_trial(*session.dynamic(repeat), f"{cuff}d{repeat}", "d"))
    return trials


def _repeats(runs: int, _pool: ProcessPoolExecutor) -> Iterator[str]:
    random = np.random.default_rng(17)

    def cover(spread: float, count: int) -> str:
        means = np.hypot(1.0, spread) * random.standard_normal((4 * runs, count))
        intervals = [combine([Repeat(value, 1.0) for value in row]).ci95 for row in means]
        return f"{100 * np.mean([low < 0 < high for low, high in intervals]):.1f}"

    rows = ([f"{spread:g}", *(cover(spread, count) for count in (2, 3, 5))] for spread in (0, 0.5, 1, 2, 4, 8))
    yield from _table("T17 spread between repeats / noise | cover, 2 repeats % | 3 repeats % | 5 repeats %", rows)


def _speed(_runs: int, _pool: ProcessPoolExecutor) -> Iterator[str]:
    trials = [trial for cuff in PUBLISHED for trial in session_trials(Session(published(cuff), 3), 3, cuff)]
    fit_session(trials[:2])
    for what, count in (("one static and one dynamic trial, 30 s at 1 kHz", 2), ("a session of 24 trials", 24)):
        began, used = time.perf_counter(), time.process_time()
        fit_session(trials[:count])
        yield f"{what}: {time.perf_counter() - began:.2f} s, {time.process_time() - used:.2f} s of processor"
    yield f"largest memory of the process: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB"


REPORTS = {
    "T1": lambda runs, pool: _estimates("T1: 20 Hz, lag known", runs, pool, rate=20.0, lag_sd=0.0),
    "T2": lambda runs, pool: _estimates("T2: 1 kHz, lag ± 0.5 ms", runs, pool, rate=1000.0, lag_sd=LAG_SD),
    "T3": _half_a_sample,
    "T9b": _coloured,
    "T10": _seen,
    "T9": _laws,
    "T17": _repeats,
    "speed": _speed,
}

if __name__ == "__main__":
    main()
