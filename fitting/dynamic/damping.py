"""Fit the damping of a dynamic trial, and of all of a donning: requirements, fit, and uncertainty due to the lag.

Slip during the oscillation is detected, with its apparent damping. Averaged over a whole cycle, x − F/k is constant if
the cuff does not slip. If it increases by s per cycle, the peak of the force, A above its mean, does the work A s,
which a damper of A s / (π ω X²) dissipates in a swing of ± X.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from documents.results import EqualByFields
from fitting.dynamic.cross_checks import (
    Checks,
    ComplexStiffness,
    Method,
    check,
    complex_stiffness,
    disagreements,
    output_error,
    without_lag,
)
from fitting.dynamic.errors_in_variables import (
    KNOT_STEP,
    TAU,
    C,
    K,
    LagPosterior,
    Swing,
    SwingFit,
    cut_swing,
    estimate,
    lag_from_magnitude,
)
from fitting.errors import UnusableTrial
from fitting.pull.pull import Pull, newest_first
from fitting.results.codes import FitOutcome, worst
from fitting.results.sentences import Note
from fitting.results.trial_codes import RejectionCode, TrialNoteCode
from fitting.trial.bounce import Oscillation, find_oscillation
from fitting.trial.timeline import REST
from fitting.uncertainty import Estimate, Repeat, combine, normal_estimate
from solver.cuff import KelvinVoigt

MIN_CYCLES = 3.0
MIN_SAMPLES_PER_CYCLE = 8.0
MIN_FRAME_RATE = 1.01 / KNOT_STEP
"""Frames a second; with fewer frames than knots, the spline of the motion would follow the force alone."""
MIN_AMPLITUDE, GOOD_AMPLITUDE = 1.0, 3.0
"""Amplitude over marker noise."""
FITTED_LAG_SD = 2e-3
"""Largest prior standard deviation [s] with which the lag is estimated from the record. The record constrains τ
separately from c only through a small curvature, so the linearised error is too small for a wider prior."""
STEADY_STIFFNESS = 0.005
"""Relative standard uncertainty of static stiffness as an estimate of dynamic stiffness."""
NEGLIGIBLE_SLIP = 0.5
"""Apparent damping due to slip, in standard errors of c, below which slip is not removed; it is in the error anyway."""
MAX_APPARENT_DAMPING = 0.1
"""Largest apparent damping, as part of c, if the cuff slips throughout the record."""
SMOOTH = 0.5
"""Differences of frames over √2 standard deviations, below which a displacement is a motion; white noise has 1."""
MIN_SETTLED = 4
"""Least number of cycles without slip."""
SIGNIFICANCE = 3.0


@dataclass(frozen=True, eq=False)
class DampingFit(EqualByFields):
    """Result of one dynamic trial.

    damping      c [N s/m]
    noise        part of its standard error for a known lag [N s/m]
    stiffness    k [N/m] of this record
    method       errors in variables, or output error if the marker noise is coloured
    energy       J dissipated in a cycle, the area of the loop of force over displacement
    lag          τ [s], estimated with a prior of mean 0
    offset       F0 [N]
    force_noise, marker_noise  estimated standard deviation per sample [N] (at FIT_RATE), [m]
    uses_static_stiffness      whether k of the held loads was used, because the lag is too uncertain
    oscillation  the fitted stretch
    checks       other methods on the same record, complex stiffness, harmonics of the residual
    notes        remarks on the fit
    outcome      of all fits of the record that these figures depend on
    time, displacement, velocity, damper_force  (n,) [s, m, m/s, N]: the fitted motion, and the measured
                 F − k x − m ẍ − F0 − F1 u, whose slope over velocity is c
    """

    damping: Repeat
    noise: float
    stiffness: Estimate
    method: Method
    energy: Estimate
    lag: float
    offset: float
    force_noise: float
    marker_noise: float
    uses_static_stiffness: bool
    oscillation: Oscillation
    checks: Checks
    time: NDArray[np.float64]
    displacement: NDArray[np.float64]
    velocity: NDArray[np.float64]
    damper_force: NDArray[np.float64]
    notes: tuple[Note, ...] = ()
    outcome: FitOutcome = FitOutcome.CONVERGED


def fit_damping(pull: Pull, tie: Estimate | None = None) -> DampingFit:
    """c of the pull of a dynamic trial: (1), (3) and (4) of the source study, F = k x + c ẋ, without differences of
    noisy frames. Raises UnusableTrial if it cannot be identified.

    tie is the static stiffness, given if the lag is too uncertain to determine c: a lag changes the phase of the
    complex stiffness k + iωc but not its magnitude, which together with a known k determines c.
    """
    oscillation = find_oscillation(pull.force_time, pull.force)
    _require_cycles(pull, oscillation)
    swing = _cut(pull, oscillation)
    solution = estimate(swing)
    outcomes = [solution.outcome]
    _require_common_motion(swing, solution)
    _require_amplitude(solution)
    slip = _find_slip(swing, solution, oscillation)
    notes = _sign_notes(pull, oscillation)
    if slip.cycles:
        oscillation = replace(oscillation, start=oscillation.start + slip.cycles / oscillation.frequency)
        swing = _cut(pull, oscillation)
        solution = estimate(swing)
        outcomes.append(solution.outcome)
        figures = {"distance_m": slip.distance, "cycles": slip.cycles}
        notes += (Note(TrialNoteCode.START_LEFT_OUT, figures),)
    posterior = None
    if tie is not None:
        known = replace(tie, standard_error=math.hypot(tie.standard_error, STEADY_STIFFNESS * tie.value))
        lag_sd = pull.trial.lag.total(oscillation.middle)
        posterior = lag_from_magnitude(solution, swing.mass, oscillation.frequency, known, lag_sd)
        swing = replace(swing.delayed(posterior.lag), lag_sd=0.0)
        solution = estimate(swing)
    fit = _fit(pull, oscillation, swing, solution, slip.damping, posterior)
    outcome = worst((*outcomes, fit.outcome))
    not_converged = () if outcome is FitOutcome.CONVERGED else (Note(TrialNoteCode.NOT_CONVERGED),)
    return replace(fit, notes=notes + fit.notes + not_converged, outcome=outcome)


def _cut(pull: Pull, oscillation: Oscillation) -> Swing:
    return cut_swing(pull, oscillation, min(pull.trial.lag.total(oscillation.middle), FITTED_LAG_SD))


def _require_cycles(pull: Pull, oscillation: Oscillation) -> None:
    if oscillation.cycles < MIN_CYCLES:
        raise UnusableTrial(RejectionCode.FEW_CYCLES, {"cycles": oscillation.cycles, "expected": MIN_CYCLES})
    per_cycle = 1 / float(np.median(np.diff(pull.force_time))) / oscillation.frequency
    if per_cycle < MIN_SAMPLES_PER_CYCLE:
        figures = {"samples": per_cycle, "frequency_hz": oscillation.frequency, "expected": MIN_SAMPLES_PER_CYCLE}
        raise UnusableTrial(RejectionCode.FEW_SAMPLES, figures)
    frame_rate = 1 / float(np.median(np.diff(pull.marker_time)))
    if frame_rate < MIN_FRAME_RATE:
        raise UnusableTrial(RejectionCode.FEW_FRAMES, {"rate_hz": frame_rate, "expected_hz": MIN_FRAME_RATE})


def _sign_notes(pull: Pull, oscillation: Oscillation) -> tuple[Note, ...]:
    """A note if the mean force of the swing is below that at rest, which is impossible for a rope."""
    at_rest = pull.force[pull.force_time < pull.force_time[0] + REST]
    inside = (pull.force_time >= oscillation.start) & (pull.force_time <= oscillation.end)
    swung = pull.force[inside]
    falls = float(np.mean(at_rest)) - float(np.mean(swung))
    if falls < oscillation.amplitude or float(np.ptp(at_rest)) > oscillation.amplitude:
        return ()
    return (Note(TrialNoteCode.POLARITY, {"fall_n": falls}),)


def _require_common_motion(swing: Swing, solution: SwingFit) -> None:
    """Raise UnusableTrial if the cuff does not move as the force does.

    If it moves at other times, the fit takes its motion for noise, although the motion is smooth. If it swings a
    quarter to half a period out of phase, k is below zero and c above. (A wrong sign of the force makes both negative.)
    """
    stiffness, damping = solution.parameters[[K, C]]
    is_noise = _amplitude(solution) < MIN_AMPLITUDE * solution.marker_noise
    is_smooth = np.std(np.diff(swing.displacement)) < SMOOTH * math.sqrt(2) * np.std(swing.displacement)
    is_out_of_phase = stiffness < -SIGNIFICANCE * math.sqrt(solution.covariance[K, K]) and damping > 0
    if is_out_of_phase or (is_noise and is_smooth):
        raise UnusableTrial(RejectionCode.INDISTINCT)


def _require_amplitude(solution: SwingFit) -> tuple[Note, ...]:
    """A note if the motion is small compared with its noise; raises UnusableTrial if it is below the noise."""
    amplitude = _amplitude(solution)
    if amplitude < MIN_AMPLITUDE * solution.marker_noise:
        figures = {"amplitude_m": amplitude, "noise_m": solution.marker_noise, "expected": MIN_AMPLITUDE}
        raise UnusableTrial(RejectionCode.SMALL_MOTION, figures)
    if amplitude < GOOD_AMPLITUDE * solution.marker_noise:
        figures = {"amplitude_m": amplitude, "ratio": amplitude / solution.marker_noise}
        return (Note(TrialNoteCode.SMALL_MOTION, figures),)
    return ()


def _amplitude(solution: SwingFit) -> float:
    """Amplitude [m] of a sine with the variance of the fitted motion."""
    return math.sqrt(2) * float(np.std(solution.x))


def _find_slip(swing: Swing, solution: SwingFit, oscillation: Oscillation) -> Slip:
    """Slip during the swing. Raises UnusableTrial if it does not end and its apparent damping is large."""
    k, c = float(solution.parameters[K]), float(solution.parameters[C])
    force = np.interp(swing.marker_time, swing.force_time, swing.force)
    offset = swing.displacement - KelvinVoigt(k, c).equilibrium(force)
    negligible = NEGLIGIBLE_SLIP * float(solution.known_lag_sd[1])
    slip = find_slip(swing.marker_time, offset, solution.marker_noise, oscillation, k, negligible)
    if not slip.settles and slip.damping > MAX_APPARENT_DAMPING * abs(c):
        figures = {"distance_m": slip.distance, "damping_n_s_per_m": slip.damping}
        raise UnusableTrial(RejectionCode.SLIPS_ON, figures)
    return slip


def _fit(
    pull: Pull,
    oscillation: Oscillation,
    swing: Swing,
    solution: SwingFit,
    apparent_damping: float,
    posterior: LagPosterior | None,
) -> DampingFit:
    """The result of a record; apparent_damping [N s/m] due to slip is added to the noise of c."""
    _require_common_motion(swing, solution)  # both again, as the stretch may have been cut
    small = _require_amplitude(solution)
    checks = check(swing, solution, oscillation.frequency)
    notes = small + disagreements(without_lag(solution), checks)
    notes += tuple(Note(TrialNoteCode.CHECK_NOT_CONVERGED, {"method": method}) for method in checks.not_converged)
    lag_sd = posterior.lag_sd if posterior else pull.trial.lag.total(oscillation.middle)
    method, stiffness, free, outcome = _estimates(swing, solution, checks, oscillation.frequency, lag_sd)
    notes += (Note(TrialNoteCode.COLOURED, {"correlation": checks.marker_correlation}),) if checks.is_coloured else ()
    damping = _damping(pull, oscillation, solution, stiffness.value, free, apparent_damping, posterior)
    loop = float(np.mean(solution.velocity**2)) / oscillation.frequency
    return DampingFit(
        damping=damping,
        noise=math.hypot(free.standard_error, apparent_damping),
        stiffness=stiffness,
        method=method,
        energy=damping.estimate.scaled(loop),
        lag=posterior.lag if posterior else float(solution.parameters[TAU]),
        offset=float(solution.parameters[2]),
        force_noise=solution.force_noise,
        marker_noise=solution.marker_noise,
        uses_static_stiffness=posterior is not None,
        oscillation=oscillation,
        checks=checks,
        time=swing.force_time,
        displacement=solution.x,
        velocity=solution.velocity,
        damper_force=solution.damper_force,
        notes=notes,
        outcome=outcome,
    )


def _estimates(
    swing: Swing, solution: SwingFit, checks: Checks, frequency: float, lag_sd: float
) -> tuple[Method, Estimate, Estimate, FitOutcome]:
    """The method, k and c with their errors (that of c for a known lag), and the outcome.

    Output error is used if the marker noise is correlated in time and it has a solution.
    """
    _, damping = without_lag(solution)
    outcome = solution.outcome
    if checks.is_coloured:
        simulated = output_error(swing, float(solution.parameters[K]), float(solution.parameters[C]))
        if simulated.estimates is not None:
            return "output error", *simulated.estimates, outcome
        if simulated.outcome is FitOutcome.NOT_CONVERGED:
            outcome = simulated.outcome
    return "errors in variables", _stiffness(solution, frequency, lag_sd), damping, outcome


def _stiffness(solution: SwingFit, frequency: float, lag_sd: float) -> Estimate:
    """k [N/m] with its uncertainty due to the lag [s], to first order ω² c τ."""
    by_lag = (2 * math.pi * frequency) ** 2 * abs(float(solution.parameters[C])) * lag_sd
    return normal_estimate(float(solution.parameters[K]), math.hypot(float(solution.known_lag_sd[0]), by_lag))


def _damping(
    pull: Pull,
    oscillation: Oscillation,
    solution: SwingFit,
    k: float,
    free: Estimate,
    apparent_damping: float,
    posterior: LagPosterior | None,
) -> Repeat:
    """Separate the errors that are independent in every trial from the common ones: lag, drift, gain, static k.

    free is c with its error for a known lag. To first order c_app = c + k τ; information on τ of higher order depends
    on harmonics and is not used.
    """
    error, bound, gain = free.standard_error, float(solution.known_lag_sd[1]), pull.trial.gain_sd * abs(free.value)
    if posterior is None:
        lag, common = k * pull.trial.lag.declared, k * pull.trial.lag.common(oscillation.middle)
        drift = math.sqrt(max(0.0, common**2 - lag**2))
        error, bound = math.hypot(error, k * pull.trial.lag.edge), math.hypot(bound, k * pull.trial.lag.edge)
    else:
        lag, drift = posterior.damping_sd, 0.0
    return Repeat(
        value=free.value,
        noise=math.hypot(error, apparent_damping),
        common=math.hypot(lag, drift, gain),
        causes={"lag": lag, "drift": drift, "gain": gain},
        bound=bound,
    )


@dataclass(frozen=True)
class Slip:
    """Slip by `distance` [m] in the first `cycles`, after which it ends if `settles`.

    damping [N s/m] is the apparent damping in the other cycles. If slip does not end, cycles is 0.
    """

    settles: bool
    cycles: int
    distance: float
    damping: float


def find_slip(
    time: NDArray[np.float64],
    offset: NDArray[np.float64],
    noise: float,
    oscillation: Oscillation,
    stiffness: float,
    negligible: float,
) -> Slip:
    """Slip in the offsets x − F/k (frames,) [m] at time [s]; noise is that of one frame [m], stiffness k [N/m].

    Slip with an apparent damping below `negligible` [N s/m] is ignored.
    """
    means, error = _cycle_means(time, offset, noise, oscillation)
    if len(means) < MIN_SETTLED:
        return Slip(settles=True, cycles=0, distance=0.0, damping=0.0)
    amplitude = oscillation.amplitude / stiffness
    apparent_damping = oscillation.amplitude / (2 * math.pi**2 * oscillation.frequency * amplitude**2)
    for first in range(len(means) - MIN_SETTLED + 1):
        slope, slope_sd = _slope(means[first:], error)
        if slope < SIGNIFICANCE * slope_sd or apparent_damping * slope < negligible:
            moved = float(np.mean(means[first:]) - means[0]) if first else 0.0
            return Slip(settles=True, cycles=first, distance=moved, damping=apparent_damping * abs(slope))
    slope, _ = _slope(means, error)
    return Slip(settles=False, cycles=0, distance=float(means[-1] - means[0]), damping=apparent_damping * slope)


def _cycle_means(
    time: NDArray[np.float64], offset: NDArray[np.float64], noise: float, oscillation: Oscillation
) -> tuple[NDArray[np.float64], float]:
    """Means of the offset over whole cycles (cycles,), and their standard deviation from differences of neighbours."""
    whole = int(oscillation.cycles)
    cycle = ((time - oscillation.start) * oscillation.frequency).astype(np.intp)
    inside = cycle < whole
    count = np.bincount(cycle[inside], minlength=whole)
    means = np.bincount(cycle[inside], offset[inside], minlength=whole) / np.maximum(count, 1)
    is_seen = count > 0.5 * count.max(initial=1)
    means = np.interp(np.arange(whole), np.flatnonzero(is_seen), means[is_seen])
    white = noise / math.sqrt(max(1.0, float(np.median(count))))
    rough = 1.4826 * float(np.median(np.abs(np.diff(means, 2)))) / math.sqrt(6) if whole > 2 else 0.0
    return means, max(white, rough)


def _slope(values: NDArray[np.float64], error: float) -> tuple[float, float]:
    """Slope of the line through values (n,) at 0, 1, …, and its standard error."""
    u = np.arange(len(values)) - (len(values) - 1) / 2
    return float(u @ values / (u @ u)), error / math.sqrt(float(u @ u))


TIE_ABOVE, TIE_BELOW = 0.15, 0.1
"""Relative standard error of c from which the static stiffness is used, and largest one then accepted: beyond it, the
error of c is not normal, because the magnitude of the complex stiffness depends on c²."""


@dataclass(frozen=True)
class Swings:
    """Results of the dynamic trials of one donning.

    by_file            fit of every used pull
    refused            file → reason why the trial is unusable
    energy             J dissipated in a cycle of the average swing; None without a fit
    complex_stiffness  K* in bands of frequency from all swings
    """

    by_file: Mapping[str, DampingFit] = field(default_factory=dict)
    refused: Mapping[str, Note] = field(default_factory=dict)
    energy: Estimate | None = None
    complex_stiffness: tuple[ComplexStiffness, ...] = ()

    @property
    def fits(self) -> list[DampingFit]:
        return list(self.by_file.values())

    @property
    def means(self) -> dict[str, float]:
        """Means over the fits, in SI with the unit in the key; empty without a fit."""
        if not self.by_file:
            return {}
        return {
            key: float(np.mean(values))
            for key, values in {
                "dynamic_stiffness_n_per_m": [fit.stiffness.value for fit in self.fits],
                "frequency_hz": [fit.oscillation.frequency for fit in self.fits],
                "force_amplitude_n": [fit.oscillation.amplitude for fit in self.fits],
                "lag_s": [fit.lag for fit in self.fits],
                "force_noise_n": [fit.force_noise for fit in self.fits],
                "marker_noise_m": [fit.marker_noise for fit in self.fits],
            }.items()
        }

    @property
    def oscillations(self) -> dict[str, Oscillation]:
        """File → the stretch that was fitted."""
        return {file: fit.oscillation for file, fit in self.by_file.items()}


def fit_swings(dynamic: Sequence[Pull], stiffness: Estimate | None, cuff_mass: float, gain_sd: float) -> Swings:
    """Fit the dynamic pulls of a donning in time order; of every repeat the newest run that can be fitted is used.

    The static stiffness [N/m] is used if the lag is too uncertain to determine c and the static stiffness does.
    """
    by_file, refused = _fit_dampings(dynamic, stiffness)
    fits = list(by_file.values())
    if not fits:
        return Swings(refused=refused)
    loops = [float(np.mean(fit.velocity**2)) / fit.oscillation.frequency for fit in fits]
    energy = combine([fit.damping for fit in fits]).scaled(float(np.mean(loops)))
    return Swings(by_file, refused, energy, _complex_stiffness(fits, cuff_mass, gain_sd))


def _fit_dampings(dynamic: Sequence[Pull], stiffness: Estimate | None) -> tuple[dict[str, DampingFit], dict[str, Note]]:
    """Fits by file and refusals. The use of static stiffness is decided for the whole donning, to avoid a selection."""
    free: dict[str, DampingFit] = {}
    refused: dict[str, Note] = {}
    for runs in newest_first(dynamic):
        for pull in runs:
            try:
                free[pull.trial.file] = fit_damping(pull)
                break
            except UnusableTrial as error:
                refused[pull.trial.file] = error.reason
    if stiffness is None or not free or _relative_error(free) < TIE_ABOVE:
        return free, refused
    try:
        tied = {pull.trial.file: fit_damping(pull, stiffness) for pull in dynamic if pull.trial.file in free}
    except UnusableTrial:  # with the given stiffness, slip may explain the remaining c
        return free, refused
    return (tied if _relative_error(tied) < TIE_BELOW else free), refused


def _relative_error(fits: Mapping[str, DampingFit]) -> float:
    damping = combine([fit.damping for fit in fits.values()])
    return damping.standard_error / abs(damping.value)


def _complex_stiffness(fits: Sequence[DampingFit], cuff_mass: float, gain_sd: float) -> tuple[ComplexStiffness, ...]:
    """Complex stiffness from the spectral lines of all fits, in bands about their mean frequency."""
    frequency = float(np.mean([fit.oscillation.frequency for fit in fits]))
    bands = complex_stiffness([line for fit in fits for line in fit.checks.lines], cuff_mass, frequency)
    lag_sd = _lag_sd(fits)
    return tuple(band.widened(lag_sd, gain_sd) for band in bands)


def _lag_sd(fits: Sequence[DampingFit]) -> float:
    """Standard uncertainty [s] of the lag in the mean of the trials: common part, and independent edges."""
    common = [math.hypot(fit.damping.causes["lag"], fit.damping.causes["drift"]) / fit.stiffness.value for fit in fits]
    edges = [max(0.0, fit.damping.noise**2 - fit.noise**2) / fit.stiffness.value**2 for fit in fits]
    return math.hypot(max(map(abs, common)), math.sqrt(sum(edges)) / len(edges))
