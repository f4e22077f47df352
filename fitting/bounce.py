"""The load cell calibrated by a weight that bounces under it on a steel spring, with a marker on the weight.

What the cell carries is known from Newton alone, whatever the spring does: with x downward, weight m and spring m_s,

    F(t + τ) = G [(m + m_s) g − (m + m_s/2) ẍ(t)] + F0       a spring that hangs straight moves half as its lower end

Nothing noisy is differentiated. Against smooth windows w_j, a few swings long and turning with the bounce, two
integrations by parts leave

    P_j = ∫ w_j F dt = c Q_j,   Q_j = −∫ ẅ_j x dt,   |c| = G (m + m_s/2),   arg c = ω τ

so gain and lag are the length and the phase of one complex number, and the zero is what the mean force leaves over.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.constants import g

from fitting.calibration import MAX_GAIN_ERROR, Calibration, blame
from fitting.oscillation import Oscillation, find_oscillation
from fitting.outcome import FitOutcome, NotConverged
from fitting.quality import UnusableTrial
from fitting.spline import Spline, grounded, solve_banded
from fitting.timing.clocks import LagUncertainty
from fitting.uncertainty import Repeat, combine
from recordings.manifest import BounceRig, DataOrigin

WINDOW_CYCLES = 4
MIN_CYCLES = 10.0
MIN_SAMPLES_PER_CYCLE = 8.0
MIN_VISIBLE = 0.7
FIT_SAMPLES_PER_CYCLE = 200
"""To so many force is averaged: 0.00004 of its swing is lost."""
MIN_AMPLITUDE = 5.0
"""Times the noise of one marker position."""
LEAST_NOISE = 1e-5
KNOTS_PER_CYCLE = 10
OUTLIER = 6.0
LONGEST_GAP = 0.15
"""Cycles for which the marker may be hidden and its displacement still be interpolated by the spline."""
ROUNDS, MAX_ROUNDS = 4, 20
"""Of the lag: at least so many, and then until it rests; and of the outlying frames at most."""
LAG_TOLERANCE = 1e-7
"""Seconds by which the last round may still move the lag: a thousandth of what a bounce can tell."""
POLARITY, TARED = -2.0, -1.0
"""Zero over weight if the load cell's sign is wrong, and if it was zeroed with the weight on."""
NEAR = 0.3


@dataclass(frozen=True)
class BounceTrial:
    """One bounce. Session time 0 is the rising edge of /sync.

    rig             the weight, its marker, the spring
    force_time, force  (n,) s, N by the configured scale
    marker_time, position  (frames,) s, (frames, 3) m in the mocap frame, NaN where the marker was not seen
    lag             as configured, and what is not known of it
    origin          measured or simulated, as the devices said of themselves
    marks           number of moments that the operator marked
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
    """What one bounce says: lag [s], gain (newtons read for one newton), zero [N]; it bounced by ± amplitude [m]."""

    lag: Repeat
    gain: Repeat
    zero: Repeat
    oscillation: Oscillation
    amplitude: float
    notes: tuple[str, ...]


def calibrate(trials: Sequence[BounceTrial]) -> tuple[Calibration | None, dict[str, str]]:
    """What all bounces of a session say together, None if none can be used, and by file why one cannot.

    Of a repeat that was recorded again the newest run counts.
    """
    fits: dict[int, tuple[BounceTrial, BounceFit]] = {}
    refused = {}
    for trial in sorted(trials, key=lambda trial: (trial.run, trial.file)):
        try:
            fits[trial.repeat] = trial, fit_bounce(trial)
        except UnusableTrial as error:
            refused[trial.file] = str(error)
    if not fits:
        return None, refused
    used, found = zip(*fits.values(), strict=True)
    calibration = Calibration(
        lag=combine([fit.lag for fit in found]),
        gain=combine([fit.gain for fit in found]),
        zero=combine([fit.zero for fit in found]),
        middle=float(np.mean([fit.oscillation.middle for fit in found])),
        recorded_utc_ns=max(trial.start_utc_ns for trial in used),
        sources={trial.file: trial.sha256 for trial in used},
        origin=DataOrigin.joined(trial.origin for trial in used),
        notes=tuple(f"{trial.file}: {note}" for trial, fit in zip(used, found, strict=True) for note in fit.notes),
    )
    return calibration, refused


def fit_bounce(trial: BounceTrial) -> BounceFit:
    """Lag, gain and zero of the load cell. Raises UnusableTrial if the bounce cannot tell them."""
    oscillation = find_oscillation(trial.force_time, trial.force)
    _require_cycles(trial, oscillation)
    motion = _motion(trial, oscillation)
    answer = _compare(trial, motion, oscillation)
    if not motion.outcome is answer.outcome is FitOutcome.CONVERGED:
        raise NotConverged(
            "the lag of the bounce is not identified: the fit did not converge; let the weight bounce freely in view "
            "of the cameras, and record again"
        )
    omega, rig = 2 * math.pi * oscillation.frequency, trial.rig
    gain = answer.mass / (rig.mass_kg + rig.spring_mass_kg / 2)
    lag = trial.lag.value + answer.lag
    # A filter that delays also damps: a first-order one by (ω delay)²/2, others by less.
    scale_sd = math.hypot(rig.mass_relative_sd, (omega * min(0.0, answer.lag)) ** 2 / 2 / math.sqrt(3))
    zero = _zero(trial, motion, answer, gain)
    weight = (rig.mass_kg + rig.spring_mass_kg) * g
    return BounceFit(
        # Where between two samples the edge was is this trial's own and no delay of the load cell's.
        lag=Repeat(lag, math.hypot(answer.phase_sd / omega, trial.lag.edge)),
        gain=Repeat(gain, answer.length_sd * gain, scale_sd * gain),
        zero=Repeat(zero, weight * answer.length_sd * gain, weight * scale_sd * gain),
        oscillation=oscillation,
        amplitude=math.sqrt(2) * float(np.std(motion.displacement)),
        notes=_judge(gain, zero / weight, rig),
    )


def _require_cycles(trial: BounceTrial, oscillation: Oscillation) -> None:
    if oscillation.cycles < MIN_CYCLES:
        raise UnusableTrial(
            f"the weight bounces {oscillation.cycles:.1f} times, expected at least {MIN_CYCLES:g}; let it bounce for "
            "half a minute"
        )
    per_cycle = 1 / float(np.median(np.diff(trial.force_time))) / oscillation.frequency
    if per_cycle < MIN_SAMPLES_PER_CYCLE:
        raise UnusableTrial(
            f"force has {per_cycle:.1f} samples in a bounce of {oscillation.frequency:.2f} Hz, expected at least "
            f"{MIN_SAMPLES_PER_CYCLE:g}; use a heavier weight or a softer spring, or raise daq.sample_rate_hz"
        )


@dataclass(frozen=True)
class _Motion:
    """Downward displacement of the weight (frames,) [m] at time [s]; short gaps are filled, long ones not is_known."""

    time: NDArray[np.float64]
    displacement: NDArray[np.float64]
    is_known: NDArray[np.bool_]
    noise: float
    outcome: FitOutcome


def _motion(trial: BounceTrial, oscillation: Oscillation) -> _Motion:
    """Marker displacement along the line in which it follows the force: downward, and free of swinging sideways."""
    inside = (trial.marker_time >= oscillation.start) & (trial.marker_time <= oscillation.end)
    time, position = trial.marker_time[inside], trial.position[inside]
    seen = np.isfinite(position).all(axis=1)
    if np.mean(seen) < MIN_VISIBLE:
        raise UnusableTrial(
            f"marker {trial.rig.marker} is seen in {100 * np.mean(seen):.0f} % of the bounce, expected at least "
            f"{100 * MIN_VISIBLE:g} %; check the cameras' view and bounce.marker"
        )
    force = np.interp(time, trial.force_time, trial.force)
    follows = (force[seen] - force[seen].mean()) @ (position[seen] - position[seen].mean(axis=0))
    displacement = (position - position[seen].mean(axis=0)) @ (follows / max(float(np.linalg.norm(follows)), 1e-30))
    spline = Spline(float(time[0]), float(time[-1]), 1 / KNOTS_PER_CYCLE / oscillation.frequency)
    design = spline.design(time)[0]
    outcome = FitOutcome.NOT_CONVERGED
    for _ in range(MAX_ROUNDS):
        rows = design[np.flatnonzero(seen)]
        smooth = np.asarray(design @ solve_banded(grounded(rows.T @ rows), rows.T @ displacement[seen]))
        noise = 1.4826 * float(np.median(np.abs(displacement[seen] - smooth[seen])))
        before, seen = seen, np.isfinite(displacement) & (np.abs(displacement - smooth) < OUTLIER * max(noise, 1e-6))
        if np.array_equal(before, seen):
            outcome = FitOutcome.CONVERGED
            break
    if np.sqrt(2) * np.std(smooth) < MIN_AMPLITUDE * max(noise, LEAST_NOISE):
        raise UnusableTrial(
            f"marker {trial.rig.marker} moves by ± {1e3 * np.sqrt(2) * np.std(smooth):.2f} mm with the force, expected "
            f"at least {MIN_AMPLITUDE:g} times its noise of {1e3 * noise:.2f} mm; check that it is on the weight"
        )
    is_known = _is_near(time, np.asarray(seen), LONGEST_GAP / oscillation.frequency)
    return _Motion(time, np.where(seen, displacement, smooth), is_known, noise, outcome)


def _is_near(time: NDArray[np.float64], seen: NDArray[np.bool_], longest: float) -> NDArray[np.bool_]:
    """Whether each of time (frames,) lies between two seen frames that are at most `longest` [s] apart."""
    known = np.flatnonzero(seen)
    after = np.minimum(np.searchsorted(known, np.arange(len(time))), len(known) - 1)
    before = np.maximum(after - 1, 0)
    return np.asarray(seen | (time[known[after]] - time[known[before]] <= longest))


@dataclass(frozen=True)
class _Answer:
    """c as a mass [kg] and a lag [s], with the standard errors of its length (relative) and phase [rad]."""

    mass: float
    lag: float
    length_sd: float
    phase_sd: float
    outcome: FitOutcome


def _compare(trial: BounceTrial, motion: _Motion, oscillation: Oscillation) -> _Answer:
    """The windows' P_j against their Q_j, each weighted by how far the weight moved in it."""
    omega, length = 2 * math.pi * oscillation.frequency, WINDOW_CYCLES / oscillation.frequency
    starts = _whole_windows(trial, motion, oscillation, length)
    force_time, force = _averaged(trial, oscillation)
    of_displacement = np.array([-_window(motion.time, start, length, omega)[1] for start in starts]) * _step(
        motion.time
    )
    displacement = of_displacement @ motion.displacement
    matched = displacement.conj() / float(np.sum(np.abs(displacement) ** 2))
    load = force - force.mean()
    lag, outcome = 0.0, FitOutcome.NOT_CONVERGED
    for count in range(1, MAX_ROUNDS + 1):
        time = force_time + lag
        of_force = np.array([_window(time, start, length, omega)[0] for start in starts]) * _step(time)
        answer = complex(matched @ (of_force @ load))
        change = math.atan2(answer.imag, answer.real) / omega
        lag += change
        if count >= ROUNDS and abs(change) <= LAG_TOLERANCE:
            outcome = FitOutcome.CONVERGED
            break
    noise = _roughness(load)
    from_force = (matched @ of_force) * noise / answer
    from_displacement = (matched @ of_displacement) * motion.noise
    # What the windows scatter beyond white noise (a spring that sings, a floor that shakes) widens the errors.
    expected = (noise * np.linalg.norm(of_force, axis=1)) ** 2
    expected += (abs(answer) * motion.noise * np.linalg.norm(of_displacement, axis=1)) ** 2
    misfit = 2 * float(np.sum(np.abs(of_force @ load - answer * displacement) ** 2 / expected))
    widened = math.sqrt(max(1.0, misfit / (2 * len(starts) - 2)))
    errors = [
        widened * math.hypot(float(np.linalg.norm(part(from_force))), float(np.linalg.norm(part(from_displacement))))
        for part in (np.real, np.imag)
    ]
    return _Answer(abs(answer), lag, errors[0], errors[1], outcome)


def _averaged(trial: BounceTrial, oscillation: Oscillation) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Means of neighbouring force samples, (n,) s and N."""
    together = max(1, int(1 / _step(trial.force_time) / oscillation.frequency / FIT_SAMPLES_PER_CYCLE))
    whole = len(trial.force) // together * together
    time, force = (values[:whole].reshape(-1, together).mean(axis=1) for values in (trial.force_time, trial.force))
    return time, force


def _whole_windows(trial: BounceTrial, motion: _Motion, oscillation: Oscillation, length: float) -> NDArray[np.float64]:
    """Starts (windows,) [s] of windows that overlap by half and lie where neither force nor marker is missing."""
    margin = 2 * _step(motion.time)
    starts = np.arange(oscillation.start + margin, oscillation.end - length - margin, length / 2)
    lost = trial.force_time[:-1][np.diff(trial.force_time) > 2 * _step(trial.force_time)]
    lost = np.concatenate((lost, motion.time[~motion.is_known]))
    whole = np.array([start for start in starts if not np.any((lost >= start) & (lost <= start + length))])
    if len(whole) < 2:
        raise UnusableTrial(
            f"the bounce has {len(whole)} stretches of {length:.1f} s without a gap in force or marker, expected at "
            "least 2; let it bounce longer in view of the cameras"
        )
    return whole


def _window(
    time: NDArray[np.float64], start: float, length: float, omega: float
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """sin⁴(π s / length) e^(−iωs) of s = time − start, 0 outside, and its second time derivative."""
    answer, curved = np.zeros((2, len(time)), dtype=np.complex128)
    inside = slice(*np.searchsorted(time, (start, start + length)))
    s = time[inside] - start
    rate = math.pi / length
    sine, cosine = np.sin(rate * s), np.cos(rate * s)
    bump = sine**4
    slope = 4 * rate * sine**3 * cosine
    curvature = 4 * rate**2 * sine**2 * (3 * cosine**2 - sine**2)
    turn = np.exp(-1j * omega * s)
    answer[inside] = bump * turn
    curved[inside] = (curvature - 2j * omega * slope - omega**2 * bump) * turn
    return answer, curved


def _zero(trial: BounceTrial, motion: _Motion, answer: _Answer, gain: float) -> float:
    """F0 [N]: the mean force under one window over the whole bounce, less the weight and what still accelerates it."""
    start, length = float(motion.time[0]), float(motion.time[-1] - motion.time[0])
    time = trial.force_time + answer.lag
    bump = _window(time, start, length, 0.0)[0].real * _step(time)
    curvature = _window(motion.time, start, length, 0.0)[1].real * _step(motion.time)
    mean = (bump @ trial.force + answer.mass * (curvature @ motion.displacement)) / bump.sum()
    return float(mean - gain * (trial.rig.mass_kg + trial.rig.spring_mass_kg) * g)


def _judge(gain: float, zero_over_weight: float, rig: BounceRig) -> tuple[str, ...]:
    """Notes on a gain or zero that is a mistake rather than a calibration. Raises UnusableTrial for a wrong sign."""
    if abs(zero_over_weight / gain - POLARITY) < NEAR:
        raise UnusableTrial(
            f"the load cell reads {(1 + zero_over_weight / gain) * gain * rig.mass_kg * g:.1f} N under "
            f"{rig.mass_kg:g} kg, expected a positive force; set load_cell.polarity to the other sign"
        )
    notes = []
    if abs(gain - 1) > MAX_GAIN_ERROR:
        notes.append(
            f"the load cell reads {gain:.3f} times what {rig.mass_kg:g} kg exert on it, {blame(gain)}; the lag is "
            "used, the gain is not"
        )
    if abs(zero_over_weight / gain - TARED) < NEAR:
        notes.append("the load cell was zeroed with the weight on; zero it with nothing on")
    return tuple(notes)


def _step(time: NDArray[np.float64]) -> float:
    return float(np.median(np.diff(time)))


def _roughness(values: NDArray[np.float64]) -> float:
    """Standard deviation of white noise on a smooth curve (n,), from its third differences."""
    return float(np.std(np.diff(values, 3))) / math.sqrt(20)
