"""Damping of one dynamic trial: what may be fitted, the fit, and what the lag does to it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fitting.dynamic import cross_checks
from fitting.dynamic.cross_checks import Checks, Method
from fitting.dynamic.errors_in_variables import TAU, C, K, Record, Solution, estimate
from fitting.dynamic.magnitude import LagPosterior, lag_of_magnitude
from fitting.dynamic.output_error import output_error
from fitting.dynamic.slip import Slip, find_slip
from fitting.oscillation import Oscillation, find_oscillation
from fitting.outcome import FitOutcome, worst
from fitting.quality import REST, UnusableTrial
from fitting.trial import Trial
from fitting.uncertainty import Estimate, Repeat, normal_estimate

MIN_CYCLES = 3.0
MIN_SAMPLES_PER_CYCLE = 8.0
MIN_AMPLITUDE, GOOD_AMPLITUDE = 1.0, 3.0
"""Times the marker noise."""
FITTED_LAG_SD = 2e-3
"""Seconds of the lag's prior up to which the data may move the lag. Beyond, they know less of it than a straight line
about their best guess says: what tells τ from c is a few per cent of curvature."""
STEADY_STIFFNESS = 0.005
"""How far (relative) the stiffness of a swinging load may be from that of held ones where one serves the other."""
NEGLIGIBLE_SLIP = 0.5
"""Standard errors of c of damping that slip may add before it is looked for; they are in the error in any case."""
MAX_APPARENT_DAMPING = 0.1
"""Part of c that slip may add where the cuff never settles."""
COLOURED_NOTE = (
    "the noise of the markers is correlated in time ({:.2f} between neighbouring frames); check the mocap system's "
    "smoothing and the markers' hold on the cuff"
)
NOT_CONVERGED_NOTE = (
    "the fit of damping did not converge: its figures still changed at the limit of rounds; check that the markers are "
    "on the cuff, and record again"
)
FIT_RATE = 250.0
"""Hz to which force is averaged: 5 % of a thousandth of its swing at 3 Hz is lost, and the fit is four times faster."""


@dataclass(frozen=True)
class DampingFit:
    """What one dynamic trial says.

    damping      c [N s/m]
    noise        the part of its standard error that remains if the lag is known [N s/m]
    stiffness    k [N/m] of this record
    method       that gave c and k: errors in variables, or output error where the markers' noise is coloured
    energy       J that the cuff takes in a cycle, the loop of force over displacement
    lag          τ [s] as far as the data moved it from 0, its prior
    offset       F0 [N]
    force_noise, marker_noise  standard deviation per sample [N] (at FIT_RATE), [m], as estimated
    uses_static_stiffness      whether k was tied to that of the held loads, because the lag is too uncertain
    oscillation  the stretch that was fitted
    checks       other methods on the same record, its complex stiffness and what is left over
    notes        what a reader should know
    outcome      of all fits of the record that these figures rest on
    time, displacement, velocity, damper_force  (n,) [s, m, m/s, N]: the fitted motion, and the measured
                 F − k x − m ẍ − F0 − F1 u over it, whose slope against velocity is c
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
    notes: tuple[str, ...] = ()
    outcome: FitOutcome = FitOutcome.CONVERGED


def fit_damping(trial: Trial, displacement: NDArray[np.float64], tie: Estimate | None = None) -> DampingFit:
    """c from a dynamic trial and its displacement (frames,) [m]. Raises UnusableTrial if the record cannot tell it.

    tie is the stiffness of held loads, given where the lag alone leaves c open: a lag turns the phase of the complex
    stiffness k + iωc and keeps its magnitude, from which a known k leaves c.
    """
    oscillation = find_oscillation(trial.force_time, trial.force)
    _require_cycles(trial, oscillation)
    record = _cut(trial, displacement, oscillation)
    solution = estimate(record)
    outcomes = [solution.outcome]
    _require_amplitude(solution)
    slip = _slip_of(record, solution, oscillation)
    notes = _sign_notes(trial, oscillation)
    if slip.cycles:
        oscillation = replace(oscillation, start=oscillation.start + slip.cycles / oscillation.frequency)
        record = _cut(trial, displacement, oscillation)
        solution = estimate(record)
        outcomes.append(solution.outcome)
        cycles = "the first cycle, which is" if slip.cycles == 1 else f"the first {slip.cycles} cycles, which are"
        notes += (f"the cuff slipped or crept by {1e3 * slip.distance:.2f} mm in {cycles} left out",)
    posterior = None
    if tie is not None:
        known = replace(tie, standard_error=math.hypot(tie.standard_error, STEADY_STIFFNESS * tie.value))
        lag_sd = trial.lag.total(oscillation.middle)
        posterior = lag_of_magnitude(solution, record.mass, oscillation.frequency, known, lag_sd)
        record = replace(record, force_time=record.force_time + posterior.lag, lag_sd=0.0)
        solution = estimate(record)
    fit = _fit(trial, oscillation, record, solution, slip.damping, posterior)
    outcome = worst((*outcomes, fit.outcome))
    not_converged = () if outcome is FitOutcome.CONVERGED else (NOT_CONVERGED_NOTE,)
    return replace(fit, notes=notes + fit.notes + not_converged, outcome=outcome)


def _require_cycles(trial: Trial, oscillation: Oscillation) -> None:
    if oscillation.cycles < MIN_CYCLES:
        raise UnusableTrial(
            f"the force swings {oscillation.cycles:.1f} times, expected at least {MIN_CYCLES:g}; pull longer"
        )
    per_cycle = 1 / float(np.median(np.diff(trial.force_time))) / oscillation.frequency
    if per_cycle < MIN_SAMPLES_PER_CYCLE:
        raise UnusableTrial(
            f"force has {per_cycle:.1f} samples in a cycle of {oscillation.frequency:.2f} Hz, expected at least "
            f"{MIN_SAMPLES_PER_CYCLE:g}; pull slower or raise daq.sample_rate_hz"
        )


def _sign_notes(trial: Trial, oscillation: Oscillation) -> tuple[str, ...]:
    """A note where the swing pulls less than nothing did before it: a rope only pulls."""
    at_rest = trial.force[trial.force_time < trial.force_time[0] + REST]
    inside = (trial.force_time >= oscillation.start) & (trial.force_time <= oscillation.end)
    swung = trial.force[inside]
    falls = float(np.mean(at_rest)) - float(np.mean(swung))
    if falls < oscillation.amplitude or float(np.ptp(at_rest)) > oscillation.amplitude:
        return ()
    return (
        f"the force falls by {falls:.1f} N from rest to the swing, and a rope only pulls: the load cell's sign is "
        "wrong, set load_cell.polarity to the other one; k and c of a swing do not feel it",
    )


def _require_amplitude(solution: Solution) -> tuple[str, ...]:
    """A note where the motion is small beside its noise. Raises UnusableTrial where it drowns in it."""
    amplitude = math.sqrt(2) * float(np.std(solution.x))
    if amplitude < MIN_AMPLITUDE * solution.marker_noise:
        raise UnusableTrial(
            f"the cuff moves by ± {1e3 * amplitude:.2f} mm, expected at least {MIN_AMPLITUDE:g} times the marker "
            f"noise of {1e3 * solution.marker_noise:.2f} mm; pull with more force"
        )
    if amplitude < GOOD_AMPLITUDE * solution.marker_noise:
        return (
            f"the cuff moves by ± {1e3 * amplitude:.2f} mm, only {amplitude / solution.marker_noise:.1f} times the "
            "marker noise; the error of c says what that costs, and more force would make it smaller",
        )
    return ()


def _slip_of(record: Record, solution: Solution, oscillation: Oscillation) -> Slip:
    """Slip within the record. Raises UnusableTrial if it never ends and would add much to c."""
    k, c = float(solution.parameters[K]), float(solution.parameters[C])
    offset = record.displacement - np.interp(record.marker_time, record.force_time, record.force) / k
    negligible = NEGLIGIBLE_SLIP * float(solution.known_lag_sd[1])
    slip = find_slip(record.marker_time, offset, solution.marker_noise, oscillation, k, negligible)
    if not slip.settles and slip.damping > MAX_APPARENT_DAMPING * abs(c):
        raise UnusableTrial(
            f"the cuff slips by {1e3 * slip.distance:.2f} mm while it swings and never settles, which looks like "
            f"damping of {slip.damping:.0f} N s/m; fasten it tighter or pull with less force"
        )
    return slip


def _cut(trial: Trial, displacement: NDArray[np.float64], oscillation: Oscillation) -> Record:
    in_force = (trial.force_time >= oscillation.start) & (trial.force_time <= oscillation.end)
    seen = (trial.marker_time >= oscillation.start) & (trial.marker_time <= oscillation.end)
    seen &= np.isfinite(displacement)
    expected = (oscillation.end - oscillation.start) / float(np.median(np.diff(trial.marker_time)))
    if np.count_nonzero(seen) < 0.5 * expected:
        raise UnusableTrial("the markers are hidden or missing in most of the dynamic pull; check the cameras' view")
    time, force = _averaged(trial.force_time[in_force], trial.force[in_force])
    return Record(
        time,
        force,
        trial.marker_time[seen],
        displacement[seen],
        trial.cuff_mass,
        min(trial.lag.total(oscillation.middle), FITTED_LAG_SD),
    )


def _averaged(time: NDArray[np.float64], force: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Means of as many neighbouring samples as leave at least FIT_RATE."""
    together = max(1, int(1 / float(np.median(np.diff(time))) / FIT_RATE + 1e-6))
    whole = len(time) // together * together
    return time[:whole].reshape(-1, together).mean(axis=1), force[:whole].reshape(-1, together).mean(axis=1)


def _fit(
    trial: Trial,
    oscillation: Oscillation,
    record: Record,
    solution: Solution,
    apparent_damping: float,
    posterior: LagPosterior | None,
) -> DampingFit:
    """The result of a record; apparent_damping [N s/m] is what slip may add to c, and counts as noise."""
    small = _require_amplitude(solution)  # a stretch that was cut may have led the fit astray
    checks = cross_checks.check(record, solution, oscillation.frequency)
    default = cross_checks.without_lag(solution)
    notes = small + cross_checks.disagreements(default, checks)
    notes += tuple(f"{method} did not converge and checks nothing here" for method in checks.not_converged)
    outcome, robust = solution.outcome, None
    if checks.is_coloured:
        notes += (COLOURED_NOTE.format(checks.marker_correlation),)
        simulated = output_error(record, default[0].value, default[1].value)
        robust = simulated.estimates
        if simulated.outcome is FitOutcome.NOT_CONVERGED:  # without a solution the default stands
            outcome = simulated.outcome
    method: Method = "errors in variables"
    lag_sd = posterior.lag_sd if posterior else trial.lag.total(oscillation.middle)
    stiffness, free = _stiffness(solution, oscillation.frequency, lag_sd), default[1]
    if robust is not None:
        method, (stiffness, free) = "output error", robust
    damping = _damping(trial, oscillation, solution, stiffness.value, free, apparent_damping, posterior)
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
        time=record.force_time,
        displacement=solution.x,
        velocity=solution.velocity,
        damper_force=solution.damper_force,
        notes=notes,
        outcome=outcome,
    )


def _stiffness(solution: Solution, frequency: float, lag_sd: float) -> Estimate:
    """k [N/m] with what the lag [s] leaves open of it, to first order ω² c τ."""
    by_lag = (2 * math.pi * frequency) ** 2 * abs(float(solution.parameters[C])) * lag_sd
    return normal_estimate(float(solution.parameters[K]), math.hypot(float(solution.known_lag_sd[0]), by_lag))


def _damping(
    trial: Trial,
    oscillation: Oscillation,
    solution: Solution,
    k: float,
    free: Estimate,
    apparent_damping: float,
    posterior: LagPosterior | None,
) -> Repeat:
    """Splits what is uncertain into what is new in every trial and what all share: lag, drift, gain, static k.

    free is c with its error as if the lag were known. To first order c_app = c + k τ; what the data say of τ beyond
    that hangs on harmonics, and is not counted.
    """
    error, bound, gain = free.standard_error, float(solution.known_lag_sd[1]), trial.gain_sd * abs(free.value)
    if posterior is None:
        lag, common = k * trial.lag.declared, k * trial.lag.common(oscillation.middle)
        drift = math.sqrt(max(0.0, common**2 - lag**2))
        error, bound = math.hypot(error, k * trial.lag.edge), math.hypot(bound, k * trial.lag.edge)
    else:
        lag, drift = posterior.damping_sd, 0.0
    return Repeat(
        value=free.value,
        noise=math.hypot(error, apparent_damping),
        common=math.hypot(lag, drift, gain),
        causes={"lag": lag, "drift": drift, "gain": gain},
        bound=bound,
    )
