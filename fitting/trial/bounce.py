"""Calibrate the load cell with a weight that bounces under it on a steel spring, with a marker on the weight.

The force on the cell is that of Newton's law for any spring: with x downward, weight m and spring mass m_s,

    F(t + τ) = G [(m + m_s) g − (m + m_s/2) ẍ(t)] + F0       the mean acceleration of the spring is half that of its end

No noisy signal is differentiated. With smooth windows w_j of a few cycles, modulated at the frequency of the bounce,
integration by parts (twice) gives

    P_j = ∫ w_j F dt = c Q_j,   Q_j = −∫ ẅ_j x dt,   |c| = G (m + m_s/2),   arg c = ω τ

so gain and lag are modulus and phase of one complex number, and the zero is found from the mean force.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from documents.message import Figures
from fitting.errors import NotConverged, UnusableTrial
from fitting.results.codes import FitOutcome, worst
from fitting.results.sentences import Note
from fitting.results.trial_codes import RejectionCode, TrialNoteCode
from fitting.spline import Spline, regularised, solve_banded
from fitting.trial.calibration import MAX_GAIN_ERROR, Calibration, find_mistake
from fitting.trial.clocks import LagUncertainty
from fitting.uncertainty import Repeat, combine
from recordings.manifest import BounceRig, DataOrigin
from recordings.standard_gravity import g

BIN = 0.05
WINDOW = 2.0
"""Seconds over which the standard deviation of the force is computed."""
TRANSIENT = 1.5
"""Seconds left out at both ends, in which the weight is added or removed."""


@dataclass(frozen=True)
class Oscillation:
    """The stretch from start to end [s] in which the force oscillates at `frequency` [Hz] with `amplitude` [N]."""

    start: float
    end: float
    frequency: float
    amplitude: float

    @property
    def middle(self) -> float:
        """Session time [s]."""
        return (self.start + self.end) / 2

    @property
    def cycles(self) -> float:
        return self.frequency * (self.end - self.start)


def find_oscillation(time: NDArray[np.float64], force: NDArray[np.float64]) -> Oscillation:
    """The longest stretch of force (n,) [N] at time [s] that oscillates. Raises UnusableTrial without one."""
    width = max(BIN, 1.01 * float(np.median(np.diff(time))))
    grid = np.arange(time[0], time[-1], width)
    side = round(WINDOW / 2 / width)
    if len(grid) < 4 * side:
        raise UnusableTrial(RejectionCode.SHORT, {"duration_s": float(time[-1] - time[0])})
    index = np.minimum(((time - time[0]) / width).astype(np.intp), len(grid) - 1)
    count = np.bincount(index, minlength=len(grid))
    means = np.bincount(index, force, minlength=len(grid))[count > 0] / count[count > 0]
    binned = np.interp(grid, grid[count > 0], means)
    swing = _moving_deviation(binned, side)
    is_swinging = swing > 0.5 * float(np.percentile(swing, 75))
    if not is_swinging.any():
        raise UnusableTrial(RejectionCode.NO_SWING)
    bounds = np.flatnonzero(np.diff(np.concatenate(([0], is_swinging.astype(np.int8), [0])))).reshape(-1, 2)
    first, last = bounds[np.argmax(bounds[:, 1] - bounds[:, 0])]
    start, end = float(grid[first]), float(grid[last - 1])
    start = time[0] if first == 0 else start + TRANSIENT
    end = time[-1] if last == len(grid) else end - TRANSIENT
    inside = binned[(grid >= start) & (grid <= end)]
    if len(inside) < 4 * side:
        raise UnusableTrial(RejectionCode.NO_SWING)
    return Oscillation(float(start), float(end), *_main_swing(inside, width))


def _moving_deviation(values: NDArray[np.float64], side: int) -> NDArray[np.float64]:
    """Moving standard deviation (n,) over `side` values on both sides, fewer at the ends."""
    centred = values - values.mean()
    sums = np.concatenate(([[0.0, 0.0]], np.cumsum(np.column_stack((centred, centred**2)), axis=0)))
    here = np.arange(len(values))
    low, high = np.maximum(here - side, 0), np.minimum(here + side + 1, len(values))
    mean, square = ((sums[high] - sums[low]) / (high - low)[:, None]).T
    return np.asarray(np.sqrt(np.maximum(square - mean**2, 0.0)))


def _main_swing(values: NDArray[np.float64], width: float) -> tuple[float, float]:
    """Frequency [Hz] of the spectral maximum, and √2 × standard deviation as amplitude."""
    straight = np.polyval(np.polyfit(np.arange(len(values)), values, 1), np.arange(len(values)))
    swing = values - straight
    spectrum = np.abs(np.fft.rfft(swing * np.hanning(len(swing)), 4 * len(swing)))
    frequency = float(np.fft.rfftfreq(4 * len(swing), width)[np.argmax(spectrum)])
    return frequency, float(np.sqrt(2) * np.std(swing))


WINDOW_CYCLES = 4
MIN_CYCLES = 10.0
MIN_SAMPLES_PER_CYCLE = 8.0
MIN_VISIBLE = 0.7
FIT_SAMPLES_PER_CYCLE = 200
"""Rate to which force is averaged; this attenuates its amplitude by 0.004 %."""
MIN_AMPLITUDE = 5.0
"""Amplitude of the weight over the noise of a marker position."""
LEAST_NOISE = 1e-5
KNOTS_PER_CYCLE = 10
OUTLIER = 6.0
LONGEST_GAP = 0.15
"""Cycles for which the marker may be hidden; the spline interpolates its displacement."""
ROUNDS, MAX_ROUNDS = 4, 20
"""Least and largest number of rounds of the lag; the second also of the outlier rejection."""
LAG_TOLERANCE = 1e-7
"""Change of the lag [s] in the last round: a thousandth of the standard error of a bounce."""
POLARITY, TARED = -2.0, -1.0
"""Zero over weight if the sign of the load cell is wrong, and if it was tared with the weight on."""
NEAR = 0.3


@dataclass(frozen=True)
class BounceTrial:
    """One bounce. Session time 0 is the rising edge of /sync.

    rig             the weight, its marker, the spring
    force_time, force  (n,) s, N by the configured scale
    marker_time, position  (frames,) s, (frames, 3) m in the mocap frame, NaN if the marker was not seen
    lag             as configured, with its uncertainty
    origin          measured or simulated, as the devices report
    marks           number of marks set by the operator
    """

    rig: BounceRig
    repeat: int
    run: int
    start_utc_ns: int
    file: str
    sha256: str
    force_time: NDArray[np.float64]
    force: NDArray[np.float64]
    marker_time: NDArray[np.float64]
    position: NDArray[np.float64]
    lag: LagUncertainty
    origin: DataOrigin = DataOrigin.UNKNOWN
    marks: int = 0


@dataclass(frozen=True)
class BounceFit:
    """Result of one bounce: lag [s], gain (newtons read per newton), zero [N], amplitude [m] of the weight."""

    lag: Repeat
    gain: Repeat
    zero: Repeat
    oscillation: Oscillation
    amplitude: float
    notes: tuple[Note, ...]


def calibrate(trials: Sequence[BounceTrial]) -> tuple[Calibration | None, dict[str, Note]]:
    """The calibration from all bounces of a session (None without a usable one), and by file why one is unusable.

    If a repeat was recorded several times, the newest usable run is used.
    """
    fits: dict[int, tuple[BounceTrial, BounceFit]] = {}
    refused = {}
    for trial in sorted(trials, key=lambda trial: (trial.run, trial.file)):
        try:
            fits[trial.repeat] = trial, fit_bounce(trial)
        except UnusableTrial as error:
            refused[trial.file] = error.reason
    if not fits:
        return None, refused
    used, found = zip(*fits.values(), strict=True)
    lag, gain, zero = (combine([getattr(fit, name) for fit in found]) for name in ("lag", "gain", "zero"))
    is_converged = worst((lag.outcome, gain.outcome, zero.outcome)) is FitOutcome.CONVERGED
    calibration = Calibration(
        lag=lag,
        gain=gain,
        zero=zero,
        middle=float(np.mean([fit.oscillation.middle for fit in found])),
        recorded_utc_ns=max(trial.start_utc_ns for trial in used),
        sources={trial.file: trial.sha256 for trial in used},
        origin=DataOrigin.joined(trial.origin for trial in used),
        notes=(
            *(note for fit in found for note in fit.notes),
            *(() if is_converged else (Note(TrialNoteCode.BOUNCES_NOT_CONVERGED),)),
        ),
    )
    return calibration, refused


def fit_bounce(trial: BounceTrial) -> BounceFit:
    """Lag, gain and zero of the load cell. Raises UnusableTrial if the bounce does not determine them."""
    oscillation = find_oscillation(trial.force_time, trial.force)
    _require_cycles(trial, oscillation)
    motion = _motion(trial, oscillation)
    response = _fit_response(trial, motion, oscillation)
    if not motion.outcome is response.outcome is FitOutcome.CONVERGED:
        raise NotConverged(RejectionCode.BOUNCE_NOT_CONVERGED)
    omega, rig = 2 * math.pi * oscillation.frequency, trial.rig
    gain = response.mass / (rig.mass_kg + rig.spring_mass_kg / 2)
    lag = trial.lag.value + response.lag
    # A filter that delays also attenuates: a first-order filter by (ω delay)²/2, others by less.
    scale_sd = math.hypot(rig.mass_relative_sd, (omega * min(0.0, response.lag)) ** 2 / 2 / math.sqrt(3))
    zero = _zero(trial, motion, response, gain)
    weight = (rig.mass_kg + rig.spring_mass_kg) * g
    return BounceFit(
        # The position of the edge between two samples is independent in every trial.
        lag=Repeat(lag, math.hypot(response.phase_sd / omega, trial.lag.edge)),
        gain=Repeat(gain, response.modulus_sd * gain, scale_sd * gain),
        zero=Repeat(zero, weight * response.modulus_sd * gain, weight * scale_sd * gain),
        oscillation=oscillation,
        amplitude=math.sqrt(2) * float(np.std(motion.displacement)),
        notes=_judge(gain, zero / weight, trial),
    )


def _require_cycles(trial: BounceTrial, oscillation: Oscillation) -> None:
    if oscillation.cycles < MIN_CYCLES:
        figures = {"cycles": oscillation.cycles, "expected": MIN_CYCLES}
        raise UnusableTrial(RejectionCode.BOUNCE_FEW_CYCLES, figures)
    per_cycle = 1 / float(np.median(np.diff(trial.force_time))) / oscillation.frequency
    if per_cycle < MIN_SAMPLES_PER_CYCLE:
        figures = {"samples": per_cycle, "frequency_hz": oscillation.frequency, "expected": MIN_SAMPLES_PER_CYCLE}
        raise UnusableTrial(RejectionCode.BOUNCE_FEW_SAMPLES, figures)


@dataclass(frozen=True)
class _Motion:
    """Downward displacement of the weight (frames,) [m] at time [s]; only short gaps are filled (is_known)."""

    time: NDArray[np.float64]
    displacement: NDArray[np.float64]
    is_known: NDArray[np.bool_]
    noise: float
    outcome: FitOutcome


def _motion(trial: BounceTrial, oscillation: Oscillation) -> _Motion:
    """Marker displacement along its covariance with the force: downward, without sideways swing."""
    inside = (trial.marker_time >= oscillation.start) & (trial.marker_time <= oscillation.end)
    time, position = trial.marker_time[inside], trial.position[inside]
    seen = np.isfinite(position).all(axis=1)
    if np.mean(seen) < MIN_VISIBLE:
        figures: Figures = {"marker": trial.rig.marker, "seen": float(np.mean(seen)), "expected": MIN_VISIBLE}
        raise UnusableTrial(RejectionCode.BOUNCE_HIDDEN, figures)
    force = np.interp(time, trial.force_time, trial.force)
    centred = position - position[seen].mean(axis=0)
    covariance = (force[seen] - force[seen].mean()) @ centred[seen]
    displacement = centred @ (covariance / max(float(np.linalg.norm(covariance)), 1e-30))
    spline = Spline(float(time[0]), float(time[-1]), 1 / KNOTS_PER_CYCLE / oscillation.frequency)
    design = spline.design(time)[0]
    outcome = FitOutcome.NOT_CONVERGED
    for _ in range(MAX_ROUNDS):
        rows = design[np.flatnonzero(seen)]
        smooth = np.asarray(design @ solve_banded(regularised(rows.T @ rows), rows.T @ displacement[seen]))
        noise = 1.4826 * float(np.median(np.abs(displacement[seen] - smooth[seen])))
        previous, seen = seen, np.isfinite(displacement) & (np.abs(displacement - smooth) < OUTLIER * max(noise, 1e-6))
        if np.array_equal(previous, seen):
            outcome = FitOutcome.CONVERGED
            break
    if np.sqrt(2) * np.std(smooth) < MIN_AMPLITUDE * max(noise, LEAST_NOISE):
        figures = {
            "marker": trial.rig.marker,
            "amplitude_m": math.sqrt(2) * float(np.std(smooth)),
            "noise_m": noise,
            "expected": MIN_AMPLITUDE,
        }
        raise UnusableTrial(RejectionCode.BOUNCE_STILL, figures)
    is_known = _is_near(time, np.asarray(seen), LONGEST_GAP / oscillation.frequency)
    return _Motion(time, np.where(seen, displacement, smooth), is_known, noise, outcome)


def _is_near(time: NDArray[np.float64], seen: NDArray[np.bool_], longest: float) -> NDArray[np.bool_]:
    """Whether a time (frames,) is between two seen frames that are at most `longest` [s] apart."""
    known = np.flatnonzero(seen)
    after = np.minimum(np.searchsorted(known, np.arange(len(time))), len(known) - 1)
    before = np.maximum(after - 1, 0)
    return np.asarray(seen | (time[known[after]] - time[known[before]] <= longest))


@dataclass(frozen=True)
class _Response:
    """c as a mass [kg] and a lag [s], with standard errors of its modulus (relative) and phase [rad]."""

    mass: float
    lag: float
    modulus_sd: float
    phase_sd: float
    outcome: FitOutcome


def _fit_response(trial: BounceTrial, motion: _Motion, oscillation: Oscillation) -> _Response:
    """Regression of P_j on Q_j over all windows."""
    omega, length = 2 * math.pi * oscillation.frequency, WINDOW_CYCLES / oscillation.frequency
    starts = _whole_windows(trial, motion, oscillation, length)
    force_time, force = _averaged(trial, oscillation)
    of_displacement = np.array([-_window(motion.time, start, length, omega)[1] for start in starts]) * _step(
        motion.time
    )
    displacement = of_displacement @ motion.displacement
    weights = displacement.conj() / float(np.sum(np.abs(displacement) ** 2))
    load = force - force.mean()
    lag, outcome = 0.0, FitOutcome.NOT_CONVERGED
    for count in range(1, MAX_ROUNDS + 1):
        time = force_time + lag
        of_force = np.array([_window(time, start, length, omega)[0] for start in starts]) * _step(time)
        response = complex(weights @ (of_force @ load))
        change = math.atan2(response.imag, response.real) / omega
        lag += change
        if count >= ROUNDS and abs(change) <= LAG_TOLERANCE:
            outcome = FitOutcome.CONVERGED
            break
    noise = _roughness(load)
    from_force = (weights @ of_force) * noise / response
    from_displacement = (weights @ of_displacement) * motion.noise
    # Scatter of the windows beyond white noise (vibration of spring or floor) increases the standard errors.
    expected = (noise * np.linalg.norm(of_force, axis=1)) ** 2
    expected += (abs(response) * motion.noise * np.linalg.norm(of_displacement, axis=1)) ** 2
    misfit = 2 * float(np.sum(np.abs(of_force @ load - response * displacement) ** 2 / expected))
    widened = math.sqrt(max(1.0, misfit / (2 * len(starts) - 2)))
    errors = [
        widened * math.hypot(float(np.linalg.norm(part(from_force))), float(np.linalg.norm(part(from_displacement))))
        for part in (np.real, np.imag)
    ]
    return _Response(abs(response), lag, errors[0], errors[1], outcome)


def _averaged(trial: BounceTrial, oscillation: Oscillation) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Block means of the force, (n,) s and N."""
    per_block = max(1, int(1 / _step(trial.force_time) / oscillation.frequency / FIT_SAMPLES_PER_CYCLE))
    whole = len(trial.force) // per_block * per_block
    time, force = (values[:whole].reshape(-1, per_block).mean(axis=1) for values in (trial.force_time, trial.force))
    return time, force


def _whole_windows(trial: BounceTrial, motion: _Motion, oscillation: Oscillation, length: float) -> NDArray[np.float64]:
    """Starts (windows,) [s] of half-overlapping windows without gaps in force or marker."""
    margin = 2 * _step(motion.time)
    starts = np.arange(oscillation.start + margin, oscillation.end - length - margin, length / 2)
    lost = trial.force_time[:-1][np.diff(trial.force_time) > 2 * _step(trial.force_time)]
    lost = np.concatenate((lost, motion.time[~motion.is_known]))
    whole = np.array([start for start in starts if not np.any((lost >= start) & (lost <= start + length))])
    if len(whole) < 2:
        raise UnusableTrial(RejectionCode.BOUNCE_GAPS, {"count": len(whole), "length_s": length})
    return whole


def _window(
    time: NDArray[np.float64], start: float, length: float, omega: float
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """sin⁴(π s / length) e^(−iωs) of s = time − start, 0 outside, and its second time derivative."""
    response, curved = np.zeros((2, len(time)), dtype=np.complex128)
    inside = slice(*np.searchsorted(time, (start, start + length)))
    s = time[inside] - start
    rate = math.pi / length
    sine, cosine = np.sin(rate * s), np.cos(rate * s)
    bump = sine**4
    slope = 4 * rate * sine**3 * cosine
    curvature = 4 * rate**2 * sine**2 * (3 * cosine**2 - sine**2)
    turn = np.exp(-1j * omega * s)
    response[inside] = bump * turn
    curved[inside] = (curvature - 2j * omega * slope - omega**2 * bump) * turn
    return response, curved


def _zero(trial: BounceTrial, motion: _Motion, response: _Response, gain: float) -> float:
    """F0 [N]: the mean force in one window over the whole bounce, minus weight and inertia."""
    start, length = float(motion.time[0]), float(motion.time[-1] - motion.time[0])
    time = trial.force_time + response.lag
    bump = _window(time, start, length, 0.0)[0].real * _step(time)
    curvature = _window(motion.time, start, length, 0.0)[1].real * _step(motion.time)
    mean = (bump @ trial.force + response.mass * (curvature @ motion.displacement)) / bump.sum()
    return float(mean - gain * (trial.rig.mass_kg + trial.rig.spring_mass_kg) * g)


def _judge(gain: float, zero_over_weight: float, trial: BounceTrial) -> tuple[Note, ...]:
    """Notes on a gain or zero that indicates a mistake. Raises UnusableTrial for a wrong sign."""
    mass = trial.rig.mass_kg
    if abs(zero_over_weight / gain - POLARITY) < NEAR:
        force = (1 + zero_over_weight / gain) * gain * mass * g
        raise UnusableTrial(RejectionCode.BOUNCE_POLARITY, {"force_n": force, "mass_kg": mass})
    notes = []
    if abs(gain - 1) > MAX_GAIN_ERROR:
        figures: Figures = {"file": trial.file, "gain": gain, "mass_kg": mass, "mistake": find_mistake(gain)}
        notes.append(Note(TrialNoteCode.BOUNCE_GAIN, figures))
    if abs(zero_over_weight / gain - TARED) < NEAR:
        notes.append(Note(TrialNoteCode.BOUNCE_TARED, {"file": trial.file}))
    return tuple(notes)


def _step(time: NDArray[np.float64]) -> float:
    return float(np.median(np.diff(time)))


def _roughness(values: NDArray[np.float64]) -> float:
    """Standard deviation of white noise on a smooth curve (n,), from its third differences."""
    return float(np.std(np.diff(values, 3))) / math.sqrt(20)
