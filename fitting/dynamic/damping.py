"""Fit the damping of one dynamic trial: requirements, fit, and uncertainty due to the lag.

Slip during the oscillation is detected, with its apparent damping. Averaged over a whole cycle, x − F/k is constant if
the cuff does not slip. If it increases by s per cycle, the peak of the force, A above its mean, does the work A s,
which a damper of A s / (π ω X²) dissipates in a swing of ± X.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fitting.dynamic.cross_checks import Checks, Method, check, disagreements, output_error, without_lag
from fitting.dynamic.errors_in_variables import TAU, C, K, LagPosterior, Solution, estimate, lag_from_magnitude
from fitting.dynamic.swing import Swing, cut_swing
from fitting.errors import UnusableTrial
from fitting.pull.pull import Pull
from fitting.results.codes import RejectionCode, TrialNoteCode
from fitting.results.outcome import FitOutcome, worst
from fitting.results.rendering import Note
from fitting.trial.force_quality import REST
from fitting.trial.oscillation import Oscillation, find_oscillation
from fitting.uncertainty import Estimate, Repeat, normal_estimate
from solver.cuff import KelvinVoigt

MIN_CYCLES = 3.0
MIN_SAMPLES_PER_CYCLE = 8.0
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
MIN_SETTLED = 4
"""Least number of cycles without slip."""
SIGNIFICANCE = 3.0


@dataclass(frozen=True)
class DampingFit:
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
    _require_amplitude(solution)
    slip = _slip_of(swing, solution, oscillation)
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
        figures = {
            "samples": per_cycle,
            "frequency_hz": oscillation.frequency,
            "expected": MIN_SAMPLES_PER_CYCLE,
        }
        raise UnusableTrial(RejectionCode.FEW_SAMPLES, figures)


def _sign_notes(pull: Pull, oscillation: Oscillation) -> tuple[Note, ...]:
    """A note if the mean force of the swing is below that at rest, which is impossible for a rope."""
    at_rest = pull.force[pull.force_time < pull.force_time[0] + REST]
    inside = (pull.force_time >= oscillation.start) & (pull.force_time <= oscillation.end)
    swung = pull.force[inside]
    falls = float(np.mean(at_rest)) - float(np.mean(swung))
    if falls < oscillation.amplitude or float(np.ptp(at_rest)) > oscillation.amplitude:
        return ()
    return (Note(TrialNoteCode.POLARITY, {"fall_n": falls}),)


def _require_amplitude(solution: Solution) -> tuple[Note, ...]:
    """A note if the motion is small compared with its noise. Raises UnusableTrial if it is below the noise."""
    amplitude = math.sqrt(2) * float(np.std(solution.x))
    if amplitude < MIN_AMPLITUDE * solution.marker_noise:
        figures = {"amplitude_m": amplitude, "noise_m": solution.marker_noise, "expected": MIN_AMPLITUDE}
        raise UnusableTrial(RejectionCode.SMALL_MOTION, figures)
    if amplitude < GOOD_AMPLITUDE * solution.marker_noise:
        figures = {"amplitude_m": amplitude, "ratio": amplitude / solution.marker_noise}
        return (Note(TrialNoteCode.SMALL_MOTION, figures),)
    return ()


def _slip_of(swing: Swing, solution: Solution, oscillation: Oscillation) -> Slip:
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
    solution: Solution,
    apparent_damping: float,
    posterior: LagPosterior | None,
) -> DampingFit:
    """The result of a record; apparent_damping [N s/m] due to slip is added to the noise of c."""
    small = _require_amplitude(solution)  # again, as the stretch may have been cut
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
    swing: Swing, solution: Solution, checks: Checks, frequency: float, lag_sd: float
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


def _stiffness(solution: Solution, frequency: float, lag_sd: float) -> Estimate:
    """k [N/m] with its uncertainty due to the lag [s], to first order ω² c τ."""
    by_lag = (2 * math.pi * frequency) ** 2 * abs(float(solution.parameters[C])) * lag_sd
    return normal_estimate(float(solution.parameters[K]), math.hypot(float(solution.known_lag_sd[0]), by_lag))


def _damping(
    pull: Pull,
    oscillation: Oscillation,
    solution: Solution,
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
