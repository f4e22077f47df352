"""Bias, coverage and findings of whole sessions whose truth is known, over conditions that are not kind to the fit.

    python -m benchmarks.coverage [--sessions 200] [--first SEED] [--only "clean,20 Hz"] [--repeats 3]

A session is one donning of a published cuff (the four in turn), with three static and three dynamic trials of the
experiment of tests/fitting/defects.py, which shares no code with the fit. Every row has the bias and the coverage of
the quantities that are identified, with Monte-Carlo standard errors, and the findings: causes and notes of at least 5 %
of the sessions. c is identified if its standard error is below half of it, which selects sessions whose noise made it
large; another row has the others, too. Truth of k is the stiffness at rest along the rope, of a stiffening cuff the
slope of the line through its held loads; of c that of a damper at the frequency of the swing, of a tangent that at the
load; of migration the displacement that remains after the last static trial.
"""

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from benchmarks.command_line import parse_options
from fitting.cuffs.cuff_fit import CuffFit
from fitting.session import fit_session
from fitting.trial.trial import Trial, build_trial
from fitting.uncertainty import Estimate
from recordings.manifest import Timing
from tests.fitting.defects import Law, OddSession, Rig
from tests.fitting.experiment import PUBLISHED, Truth

SHOWN = 0.05
"""Share of the sessions from which a finding is printed."""
LAG_SD = 2e-3
HOOK = 2.0
"""N that hang on the cuff without weights."""
OBLIQUE = math.radians(25.0)
USUAL = {"note.not_calibrated", "note.published_damping", "sync.certificate"}
Found = tuple[Estimate, float]


@dataclass(frozen=True)
class Condition:
    """Changes of a clean session: law of the cuff, defect of the rig, and protocol or instrument.

    lag_sd  s of the lag that is drawn for every session, and declared
    """

    law: Mapping[str, Any] = field(default_factory=dict)
    rig: Rig = field(default_factory=Rig)
    truth: Mapping[str, Any] = field(default_factory=dict)
    lag_sd: float | None = None


_OF_LAW_AND_RIG = {
    "clean": Condition(),
    "20 Hz": Condition(truth={"force_rate": 20.0}),
    "50 Hz": Condition(truth={"force_rate": 50.0}),
    "holds of 3 ± 0.5 s": Condition(truth={"hold": 3.0, "hold_jitter": 0.5}),
    "holds of 1.5 ± 0.15 s": Condition(truth={"hold": 1.5, "hold_jitter": 0.15}),
    "sway 10 mm and 25 mrad": Condition(truth={"sway": 10e-3, "sway_angle": 25e-3}),
    "lag of 2 ms": Condition(lag_sd=LAG_SD),
    "friction 4 N staged": Condition({"friction": 4.0}),
    "friction 4 N at once": Condition({"friction": 4.0}, truth={"unloads_at_once": True}),
    "creep 15 % in 15 s": Condition({"slow": (0.15, 15.0)}),
    "relaxation 30 % in 0.3 s": Condition({"fast": (0.3, 0.3)}),
    "stiffening": Condition({"bend": 30.0}),
    "slip above 30 N": Condition({"slip_from": 30.0}),
    "slip above 30 N at once": Condition({"slip_from": 30.0}, truth={"unloads_at_once": True}),
    "skin 0.05 mm/N": Condition(rig=Rig(skin=0.05e-3)),
    "pull at 25°": Condition(rig=Rig(static_angle=OBLIQUE, dynamic_angle=OBLIQUE, ratio=0.5)),
}
CONDITIONS = {
    **{name: replace(one, truth={**one.truth, "has_rope_markers": True}) for name, one in _OF_LAW_AND_RIG.items()},
    "without rope markers": Condition(),
    "pull at 25° without rope markers": _OF_LAW_AND_RIG["pull at 25°"],
}
"""Two markers show the direction of the rope, unless the name says otherwise."""


@dataclass(frozen=True)
class Session:
    """A fitted session and what is true in it; at_rest is the stiffness without a load, bend its increase [1/m]."""

    fit: CuffFit
    stiffness: float
    damping: float
    migration: float
    at_rest: float
    bend: float


def main() -> None:
    options = parse_options(__doc__, sessions=200, first=0, repeats=3, only="")
    wanted = options.only.split(",") if options.only else list(CONDITIONS)
    print("| condition | quantity | identified % | bias % | coverage % | findings: % of sessions |")
    print("|---|---|---:|---:|---:|---|")
    for name in wanted:
        seeds = range(options.first, options.first + options.sessions)
        sessions = [without_pulls(run(CONDITIONS[name], seed, options.repeats)) for seed in seeds]
        for row in rows(name, sessions):
            print(row, flush=True)


def run(condition: Condition, seed: int, repeats: int = 3) -> Session:
    """Simulate and fit one donning of a published cuff."""
    cuff = list(PUBLISHED)[seed % len(PUBLISHED)]
    k, c, _ = PUBLISHED[cuff]
    law = replace(Law(stiffness=k, damping=c), **condition.law)
    truth = replace(Truth(cuff=cuff, friction=1e9, migration=0.0), **condition.truth)
    lag_sd = condition.lag_sd
    if lag_sd:
        truth = replace(truth, lag=lag_sd * float(np.random.default_rng((seed, 1)).standard_normal()))
    session = OddSession(law, condition.rig, 7000 + seed, truth)
    trials, migration = [], 0.0
    for trial in _trials(session, repeats, lag_sd):
        trials.append(trial)
        if trial.test == "static":
            migration = session.migration
    (fit,) = fit_session(trials).cuffs.values()
    along = _along(condition.rig)
    omega = 2 * math.pi * truth.frequency
    relaxing, time = law.fast[0] * k, law.fast[1]
    damping = c + relaxing * time / (1 + (omega * time) ** 2)
    return Session(fit, _line(law, truth) * along, damping * along, migration, k, law.bend)


def _line(law: Law, truth: Truth) -> float:
    """Slope [N/m] of the line through the held loads of a cuff whose stiffness grows with the load, else k."""
    if law.bend == 0.0:
        return law.stiffness
    up = np.array([0.0, *truth.weights]) + HOOK
    load = np.concatenate((up, up[-2::-1]))
    return float(np.polyfit(np.log1p(law.bend * load / law.stiffness) / law.bend, load, 1)[0])


def without_pulls(session: Session) -> Session:
    """A session without its arrays, which take 10 MB."""
    return replace(session, fit=replace(session.fit, pulls={}))


def _trials(session: OddSession, repeats: int, lag_sd: float | None) -> Iterator[Trial]:
    for repeat in range(1, repeats + 1):
        for test in (session.static, session.dynamic):
            manifest, tracks = test(repeat)
            if lag_sd:
                manifest = replace(manifest, timing=Timing(stop_edge="end_of_frame", lag_sd_s=lag_sd))
            yield build_trial(manifest, tracks, f"{test.__name__}-{repeat}", "")


def _along(rig: Rig) -> float:
    """Stiffness along the rope over that along the cuff's first axis."""
    cos2 = math.cos(rig.static_angle) ** 2
    return 1 / (cos2 + (1 - cos2) / rig.ratio)


def rows(name: str, sessions: Sequence[Session]) -> Iterator[str]:
    """Markdown rows of a condition, one for each quantity."""
    findings = Counter(code for session in sessions for code in reported_codes(session.fit))
    shown = [f"{code} {100 * count / len(sessions):.0f}" for code, count in findings.most_common()]
    shown = shown[: sum(count >= SHOWN * len(sessions) for count in findings.values())]
    for quantity, found in _quantities(sessions).items():
        estimates = [pair for pair in found if pair is not None]
        cells = [name, quantity, f"{100 * len(estimates) / len(found):.0f}", *_judged(estimates)]
        cells.append(", ".join(shown) if quantity == "k" else "")
        yield f"| {' | '.join(cells)} |"


def reported_codes(fit: CuffFit) -> set[str]:
    """Causes, and notes of the donning and its trials, except those of every session of this rig."""
    notes = {note.code.value for note in fit.notes} | {note.code.value for trial in fit.trials for note in trial.notes}
    causes = {cause.code.value for cause in fit.diagnosis.causes} if fit.diagnosis else set()
    return causes | notes - USUAL


def _quantities(sessions: Sequence[Session]) -> dict[str, list[Found | None]]:
    """Quantity → estimate and truth of every session, None where it is not identified."""
    found: dict[str, list[Found | None]] = {"k": [], "c": [], "migration": []}
    for session in sessions:
        for quantity, name, truth in (
            ("k", "stiffness", session.stiffness),
            ("c", "damping", session.damping),
            ("migration", "migration", session.migration),
        ):
            estimate = getattr(session.fit, name)
            held = session.fit.held
            if quantity == "k" and held and held.creep and held.creep.is_measured:
                estimate = held.creep.stiffness_at_rest
            found[quantity].append(None if name in session.fit.missing else (estimate, truth))
        if (damping := session.fit.damping) and ("damping" not in session.fit.missing or damping.is_too_wide):
            found.setdefault("c, also where too wide", []).append((damping, session.damping))
        if session.bend and session.fit.held:
            for load, tangent in session.fit.held.tangents:
                true = session.at_rest + session.bend * (HOOK + load)
                found.setdefault("tangents", []).append((tangent, true))
    return found


def _judged(found: Sequence[Found]) -> list[str]:
    """Bias with its standard error [%, mm for a truth of 0], and coverage with its Monte-Carlo error."""
    if not found:
        return ["–", "–"]
    is_relative = all(truth > 1.0 for _, truth in found)
    off = np.array([(e.value - truth) * (100 / truth if is_relative else 1e3) for e, truth in found])
    covered = np.mean([e.ci95[0] <= truth <= e.ci95[1] for e, truth in found])
    unit = "" if is_relative else " mm"
    error = np.std(off) / math.sqrt(len(off))
    spread = 100 * math.sqrt(covered * (1 - covered) / len(off))
    return [f"{np.mean(off):+.2f} ± {error:.2f}{unit}", f"{100 * covered:.0f} ± {spread:.0f}"]


if __name__ == "__main__":
    main()
