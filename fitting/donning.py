"""All trials of one cuff in one donning → its stiffness, damping and migration."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from fitting.curves import TrialCurves
from fitting.donning_notes import donning_notes, interval_notes, migration_notes, origin_notes
from fitting.dynamic.damping import DampingFit, fit_damping
from fitting.dynamic.weak_form import ComplexStiffness, complex_stiffness
from fitting.held_loads import fit_held_loads, held_load_notes, plain_held_loads
from fitting.identification import judge_damping, judge_migration, judge_stiffness
from fitting.quality import UnusableTrial
from fitting.result import CuffFit, Lag, TrialFit
from fitting.results.codes import Verdict
from fitting.spatial.held_tensor import held_tensor
from fitting.spatial.reduction import ReducedTrial, reduce_trials
from fitting.spatial.swung_tensor import swung_tensor
from fitting.spatial.tensor import NoTensor, Tensor, Tensors
from fitting.static.migration import fit_migration
from fitting.static.stiffness import StaticFit, StiffnessFit, trial_stiffness
from fitting.trial import RejectedTrial, Trial
from fitting.uncertainty import Estimate, combine
from fitting.wearable_cuff import covariance_of
from recordings.manifest import DataOrigin

TESTS = ("static", "dynamic")
TIE_ABOVE, TIE_BELOW = 0.15, 0.1
"""Relative standard error of c on its own from which the static stiffness is called to help, and what it must reach:
beyond, c by its magnitude is far from normal, since that holds c only by its square."""


ONE_WAY_BACK = (
    "all weights come off at once, which shows one way back: the loads alone cannot tell whether the cuff slipped or "
    "rubs; take them off one by one",
)


def fit_donning(
    trials: Sequence[Trial], rejected: Sequence[RejectedTrial] = ()
) -> tuple[CuffFit, dict[str, TrialCurves]]:
    """The fit of one donning from its trials in time order, and by file the curves of those that were used.

    Of a repeat that was recorded again, the highest run that can be used counts. Migration is measured from the first
    static trial of the donning, even one that was recorded again; rejected are recordings of the donning that are no
    trials, and leave migration open if a static one of them started earlier still.
    """
    moved, reasons = reduce_trials(trials)
    reduced = [each for each in moved if not each.is_elsewhere]
    all_static = [each for each in reduced if each.trial.test == "static"]
    static = [runs[0] for runs in _newest_first(all_static)]
    stiffness, held = fit_held_loads(static, max(trial.gain_sd for trial in trials))
    lines = dict(zip([each.trial.file for each in static], stiffness.trials, strict=True))
    swings = _fit_dampings([each for each in reduced if each.trial.test == "dynamic"], stiffness.stiffness, reasons)
    used = {each.trial.file: each for each in reduced if each.trial.file in lines or each.trial.file in swings}
    elsewhere = [runs[0] for test in TESTS for runs in _newest_first(_of(moved, test)) if runs[0].is_elsewhere]
    every = used | {each.trial.file: each for each in elsewhere}

    before = _started_before(all_static, trials, rejected, reasons)
    judged = (
        judge_stiffness(static, stiffness),
        judge_damping(list(swings.values())),
        judge_migration(all_static, held.creep if held and static == all_static else None, before),
    )
    estimates = [estimate for estimate, _ in judged]
    cuff = trials[0].cuff
    fit = CuffFit(
        name=cuff.name,
        site=cuff.site,
        donning=trials[0].donning,
        stiffness=estimates[0],
        damping=estimates[1],
        migration=estimates[2],
        verdicts=tuple(verdict for _, verdict in judged if verdict) or (Verdict.IDENTIFIED,),
        covariance=covariance_of(estimates),
        sources={each.trial.file: each.trial.sha256 for each in (*every.values(), *all_static[:1])}
        | _calibrated_by(trials),
        lag=_lag([each.trial for each in used.values()] or trials),
        trials=_list_trials(
            trials, every, {each.trial.file: each.pull for each in moved}, lines, stiffness.if_rubs, swings, reasons
        ),
        notes=donning_notes(stiffness, list(swings.values()))
        + interval_notes(None if judged[1][1] else estimates[1])
        + held_load_notes(held, stiffness)
        + origin_notes(trials, set(_origins(trials)))
        + migration_notes(all_static, before),
        held=plain_held_loads(held, stiffness),
        diagnostics=_diagnostics(stiffness, list(swings.values())),
        energy=_energy(list(swings.values())),
        complex_stiffness=_complex_stiffness(list(swings.values()), trials[0]),
        tensors=_tensors(list(every.values()), swings),
        origin=DataOrigin.joined(_origins(trials)),
    )
    return fit, {file: _draw(each, lines.get(file), swings.get(file)) for file, each in used.items()}


def _of(trials: Sequence[ReducedTrial], test: str) -> list[ReducedTrial]:
    return [each for each in trials if each.trial.test == test]


def _tensors(trials: Sequence[ReducedTrial], swings: Mapping[str, DampingFit]) -> Tensors:
    """K and C in three dimensions, or why there are none."""
    gain_sd = max((each.trial.gain_sd for each in trials), default=0.0)
    stretches = {file: fit.oscillation for file, fit in swings.items()}
    found: dict[str, Tensor] = {}
    refused = {}
    for test in TESTS:
        pulled = _of(trials, test)
        try:
            found[test] = held_tensor(pulled, gain_sd) if test == "static" else swung_tensor(pulled, stretches, gain_sd)
        except NoTensor as error:
            refused[test] = str(error)
    return Tensors(found.get("static"), found.get("dynamic"), refused.get("static", ""), refused.get("dynamic", ""))


def _calibrated_by(trials: Sequence[Trial]) -> dict[str, str]:
    return {file: sha for trial in trials if trial.calibration for file, sha in trial.calibration.sources.items()}


def _origins(trials: Sequence[Trial]) -> Iterator[DataOrigin]:
    """Of the trials and of the bounces that calibrate them."""
    for trial in trials:
        yield trial.origin
        if trial.calibration is not None:
            yield trial.calibration.origin


def _lag(trials: Sequence[Trial]) -> Lag:
    """What is taken for the lag of force against markers, from where, and what is not known of it."""
    lag = trials[0].lag
    edge = max(trial.lag.edge for trial in trials)
    return Lag(lag.value, lag.declared, edge, max(trial.lag.drift for trial in trials), lag.source)


def _newest_first(trials: Sequence[ReducedTrial]) -> list[list[ReducedTrial]]:
    """The trials of one test by repeat, in the order of their newest runs; of a repeat the newest run comes first.

    Every direction of the pull has repeats of its own.
    """
    repeats: dict[tuple[int, int], list[ReducedTrial]] = {}
    for each in sorted(trials, key=lambda each: each.trial.run, reverse=True):
        repeats.setdefault((each.pull, each.trial.repeat), []).append(each)
    return sorted(repeats.values(), key=lambda runs: (runs[0].trial.start_utc_ns, runs[0].trial.file))


def _fit_dampings(
    dynamic: Sequence[ReducedTrial], stiffness: Estimate | None, reasons: dict[str, str]
) -> dict[str, DampingFit]:
    """c of every dynamic trial by file; tied to the static stiffness where the lag leaves c open and the tie tells it.

    Decided for the donning as a whole: single trials that happened to come out well would be picked.
    """
    free = {}
    for runs in _newest_first(dynamic):
        for each in runs:
            try:
                free[each.trial.file] = fit_damping(each.trial, each.displacement)
                break
            except UnusableTrial as error:
                reasons[each.trial.file] = str(error)
    if stiffness is None or not free or _relative_error(free) < TIE_ABOVE:
        return free
    try:
        tied = {
            each.trial.file: fit_damping(each.trial, each.displacement, stiffness)
            for each in dynamic
            if each.trial.file in free
        }
    except UnusableTrial:  # with the stiffness given, another c may be left that slip explains
        return free
    return tied if _relative_error(tied) < TIE_BELOW else free


def _relative_error(fits: Mapping[str, DampingFit]) -> float:
    damping = combine([fit.damping for fit in fits.values()])
    return damping.standard_error / abs(damping.value)


def _started_before(
    static: Sequence[ReducedTrial],
    trials: Sequence[Trial],
    rejected: Sequence[RejectedTrial],
    reasons: Mapping[str, str],
) -> list[str]:
    """The static recordings of which nothing can be read, although the cuff migrated in them before the first trial."""
    if not static:
        return []
    first = static[0].trial.start_utc_ns
    begun = [(trial.file, trial.test, trial.start_utc_ns) for trial in trials if trial.file in reasons]
    begun += [
        (each.file, each.capture.test, each.capture.start_utc_ns) for each in rejected if each.capture is not None
    ]
    return [file for file, test, start in begun if test == "static" and start < first]


def _list_trials(
    trials: Sequence[Trial],
    reduced: Mapping[str, ReducedTrial],
    pulls: Mapping[str, int],
    static: Mapping[str, StaticFit],
    if_rubs: Estimate | None,
    damping: Mapping[str, DampingFit],
    reasons: Mapping[str, str],
) -> tuple[TrialFit, ...]:
    """Every recording of the donning with its part in the fit."""
    counting = {(each.trial.test, each.trial.repeat, each.pull): file for file, each in reduced.items()}
    listed = []
    for trial in trials:
        file = trial.file
        is_used = file in reduced
        again = counting.get((trial.test, trial.repeat, pulls.get(file, 0)), file)
        listed.append(
            TrialFit(
                file=file,
                sha256=trial.sha256,
                test=trial.test,
                repeat=trial.repeat,
                run=trial.run,
                state="used" if is_used else "unusable" if file in reasons else "superseded",
                reason=reasons.get(file, "" if is_used else f"recorded again as {again}"),
                notes=(reduced[file].notes if is_used else trial.notes)
                + (damping[file].notes if file in damping else ())
                + (ONE_WAY_BACK if if_rubs and file in static else ()),
                stiffness=trial_stiffness(static[file], if_rubs) if file in static else None,
                damping=damping[file].damping.estimate if file in damping else None,
                swing=damping.get(file),
                sync=trial.sync,
                zero_drift=trial.zero_drift,
                origin=trial.origin,
                migration=fit_migration([reduced[file].plateaus]) if is_used else None,
            )
        )
    return tuple(listed)


def _diagnostics(stiffness: StiffnessFit, damping: Sequence[DampingFit]) -> dict[str, float]:
    found = {"slip_m": stiffness.slip} if stiffness.stiffness else {}
    if damping:
        for key, values in {
            "dynamic_stiffness_n_per_m": [fit.stiffness.value for fit in damping],
            "frequency_hz": [fit.oscillation.frequency for fit in damping],
            "force_amplitude_n": [fit.oscillation.amplitude for fit in damping],
            "lag_s": [fit.lag for fit in damping],
            "force_noise_n": [fit.force_noise for fit in damping],
            "marker_noise_m": [fit.marker_noise for fit in damping],
        }.items():
            found[key] = float(np.mean(values))
    return found


def _energy(damping: Sequence[DampingFit]) -> Estimate | None:
    """Of a cycle as swung on average: c times the mean of ∮ ẋ dx."""
    if not damping:
        return None
    loops = [float(np.mean(fit.velocity**2)) / fit.oscillation.frequency for fit in damping]
    return combine([fit.damping for fit in damping]).scaled(float(np.mean(loops)))


def _complex_stiffness(damping: Sequence[DampingFit], trial: Trial) -> tuple[ComplexStiffness, ...]:
    """From the lines of all dynamic trials, in bands about their mean frequency; trial is any of the donning."""
    if not damping:
        return ()
    frequency = float(np.mean([fit.oscillation.frequency for fit in damping]))
    bands = complex_stiffness([line for fit in damping for line in fit.checks.lines], trial.cuff_mass, frequency)
    lag_sd = _lag_sd(damping)
    return tuple(band.widened(lag_sd, trial.gain_sd) for band in bands)


def _lag_sd(damping: Sequence[DampingFit]) -> float:
    """What is not known [s] of the lag in the trials' mean: what they share, and each one's own edge."""
    shared = [
        math.hypot(fit.damping.causes["lag"], fit.damping.causes["drift"]) / fit.stiffness.value for fit in damping
    ]
    edges = [max(0.0, fit.damping.noise**2 - fit.noise**2) / fit.stiffness.value**2 for fit in damping]
    return math.hypot(max(map(abs, shared)), math.sqrt(sum(edges)) / len(edges))


def _draw(each: ReducedTrial, static: StaticFit | None, dynamic: DampingFit | None) -> TrialCurves:
    trial = each.trial
    return TrialCurves(
        trial,
        trial.force_time,
        trial.force,
        trial.marker_time,
        each.displacement,
        static,
        dynamic,
        each.motion,
        each.markers,
    )
