"""Compare the default estimate of k and c with other methods on the same record.

Weak form of F = k x + c ẋ + m ẍ + F0 + F1 u with tapered sines as test functions, so no sample is differentiated.

With φ(t) = sin²(π t/T) exp(−iωt) over a stretch of T seconds, φ and φ̇ vanish at both ends; integration by parts gives

    ∫φ F = k ∫φ x − c ∫φ̇ x + m ∫φ̈ x + F1 ∫φ u          (∫φ F0 = 0 from the second ω = 2πj/T on)

one complex equation (spectral line) per ω, for any sampling. Noise of x adds a known mean to the normal matrix, which
is subtracted. All lines together give k and c; the lines of a frequency band give the complex stiffness of the band.

Output error: the measured force drives m ẍ + c ẋ + k x = F − F0 − F1 u, and x is fitted to the markers. It needs
no spline and no weights between the instruments, and its covariance allows coloured residuals, by an autoregressive
model. So it is used if the marker noise is correlated in time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from documents.message import Figures
from documents.results import EqualByFields
from fitting.dynamic.errors_in_variables import TAU, C, K, Swing, SwingFit
from fitting.results.codes import FitOutcome
from fitting.results.sentences import Note
from fitting.results.trial_codes import TrialNoteCode
from fitting.uncertainty import Estimate, normal_estimate, student_estimate
from solver.cuff import KelvinVoigt

LONGEST_GAP = 0.15
"""Longest gap of the markers [s] that a cubic spline interpolates; a longer gap ends the stretch."""
MIN_STRETCH = 3.0
LOWEST_LINE, HIGHEST_LINE = 0.25, 6.0
"""Range of frequencies [Hz]."""
ABOVE_NOISE = 5.0
"""Least displacement of a line over its noise."""
MIN_LINES = 3
"""Number of lines of a pure sine."""
WIDTH = 0.25
NEIGHBOURS = (1.0, -2 / 3, 1 / 6)
"""Correlation of the noise of a line with that of the next ones, from the spectrum of the taper."""

X, V, A = range(3)


@dataclass(frozen=True, eq=False)
class Lines(EqualByFields):
    """Lines (n,) of one stretch at `frequency` [Hz].

    force ∫φF, motion (n, 3) ∫φx, −∫φ̇x, ∫φ̈x, ramp ∫φu, noise (n, 2) expected |x̂|², |v̂|² of marker noise
    """

    frequency: NDArray[np.float64]
    force: NDArray[np.complex128]
    motion: NDArray[np.complex128]
    ramp: NDArray[np.complex128]
    noise: NDArray[np.float64]


@dataclass(frozen=True)
class ComplexStiffness:
    """K*(f) = k + i 2πf c at `frequency` [Hz]: k [N/m] and c [N s/m] from the lines of a band."""

    frequency: float
    stiffness: Estimate
    damping: Estimate

    def widened(self, lag_sd: float, gain_sd: float) -> ComplexStiffness:
        """With the uncertainty of the lag [s] and of the load cell's scale (relative) added, to first order.

        A lag τ rotates K* by ωτ: k becomes k − ω²c τ and c becomes c + k τ.
        """
        k, c = abs(self.stiffness.value), abs(self.damping.value)
        by_lag = (2 * math.pi * self.frequency) ** 2 * c * lag_sd
        return ComplexStiffness(
            self.frequency,
            self.stiffness.widened({"lag": by_lag, "gain": gain_sd * k}),
            self.damping.widened({"lag": k * lag_sd, "gain": gain_sd * c}),
        )


def tapered_lines(swing: Swing, marker_noise: float) -> list[Lines]:
    """The lines of every stretch whose displacement exceeds its noise; marker_noise [m] is per frame."""
    lines = [_lines(swing, start, end, marker_noise) for start, end in _stretches(swing.marker_time)]
    return [stretch for stretch in lines if len(stretch.frequency) >= MIN_LINES]


def fit_lines(lines: Sequence[Lines], mass: float) -> tuple[Estimate, Estimate] | None:
    """k and c for a known lag, with errors from the scatter of the lines; None for too few lines."""
    count = sum(len(stretch.frequency) for stretch in lines)
    if count < MIN_LINES:
        return None
    normal, right = np.zeros((3, 3)), np.zeros(3)
    for stretch in lines:
        columns = _columns(stretch)
        normal += (columns.conj().T @ columns).real
        normal[[X, V], [X, V]] -= stretch.noise.sum(axis=0)
        right += (columns.conj().T @ (stretch.force - mass * stretch.motion[:, A])).real
    solved = np.linalg.solve(normal, right)
    residuals = [stretch.force - mass * stretch.motion[:, A] - _columns(stretch) @ solved for stretch in lines]
    variance = sum(float(np.vdot(r, r).real) for r in residuals) / (2 * count - 3)
    middle = sum(_spread(_columns(stretch)) for stretch in lines)
    covariance = variance * np.linalg.solve(normal, np.linalg.solve(normal, middle).T)
    k_error, c_error = (math.sqrt(max(0.0, float(covariance[i, i]))) for i in (X, V))
    dof = 2 * count - 3
    return student_estimate(float(solved[X]), k_error, dof), student_estimate(float(solved[V]), c_error, dof)


def complex_stiffness(lines: Sequence[Lines], mass: float, centre: float) -> tuple[ComplexStiffness, ...]:
    """K* in bands of width centre/4 [Hz], one of them around `centre` [Hz], lowest first.

    A band needs MIN_LINES lines.
    """
    if not lines:
        return ()
    highest = max(float(stretch.frequency[-1]) for stretch in lines)
    found = []
    width = WIDTH * centre
    for low in np.arange(centre - width * (0.5 + np.floor(centre / width)), highest + width, width):
        inside = [_between(stretch, low, low + width) for stretch in lines]
        fitted = fit_lines(inside, mass)
        if fitted is None:
            continue
        power = np.concatenate([np.abs(stretch.motion[:, X]) ** 2 for stretch in inside])
        frequency = np.concatenate([stretch.frequency for stretch in inside])
        found.append(ComplexStiffness(float(np.average(frequency, weights=power)), *fitted))
    return tuple(found)


def _stretches(time: NDArray[np.float64]) -> list[tuple[float, float]]:
    gaps = np.flatnonzero(np.diff(time) > LONGEST_GAP)
    starts, ends = time[np.append(0, gaps + 1)], time[np.append(gaps, len(time) - 1)]
    return [(float(a), float(b)) for a, b in zip(starts, ends, strict=True) if b - a >= MIN_STRETCH]


def _lines(swing: Swing, start: float, end: float, noise: float) -> Lines:
    step, force_step = (float(np.median(np.diff(time))) for time in (swing.marker_time, swing.force_time))
    seen = (swing.marker_time >= start) & (swing.marker_time <= end)
    inside = (swing.force_time >= start) & (swing.force_time <= end)
    start, end = max(start, float(swing.force_time[inside][0])), min(end, float(swing.force_time[inside][-1]))
    length = end - start
    highest = int(min(HIGHEST_LINE, 0.25 / max(step, force_step)) * length)
    frequency = np.arange(1, highest + 1) / length

    grid, even = np.arange(start, end, step), np.arange(start, end, force_step)
    displacement = scipy.interpolate.CubicSpline(swing.marker_time[seen], swing.displacement[seen])(grid)
    waves = [
        step * _waves(displacement, step, length, highest),
        force_step * _waves(np.interp(even, swing.force_time, swing.force), force_step, length, highest),
        force_step * _waves(2 * (even - start) / length - 1, force_step, length, highest),
    ]
    w, p = 2 * np.pi * frequency, 2 * np.pi / length
    motion = np.column_stack([_tapered(waves[0], length, order) for order in range(3)]) * [1, -1, 1]
    expected = (
        noise**2
        * step
        * length
        * np.column_stack((np.full(highest, 3 / 8), w**2 / 4 + ((w + p) ** 2 + (w - p) ** 2) / 16))
    )
    lines = Lines(frequency, _tapered(waves[1], length, 0), motion, _tapered(waves[2], length, 0), expected)
    stands_out = np.abs(motion[:, X]) ** 2 > ABOVE_NOISE**2 * expected[:, X]
    return _selected(lines, stands_out & (frequency >= LOWEST_LINE) & (frequency * length > 1.5))


def _waves(values: NDArray[np.float64], step: float, length: float, highest: int) -> NDArray[np.complex128]:
    """Σ values exp(−2πi j t/T) for j = 0 … highest + 1, by the chirp z-transform."""
    return np.asarray(scipy.signal.czt(values, highest + 2, w=np.exp(-2j * np.pi * step / length)))


def _tapered(waves: NDArray[np.complex128], length: float, order: int) -> NDArray[np.complex128]:
    """The sums with φ, or a derivative of it, for j = 1 …: sin² is 1/2 − (e^{ipt} + e^{−ipt})/4 with p = 2π/T."""
    slopes = (-2j * np.pi * np.arange(len(waves)) / length) ** order * waves
    return slopes[1:-1] / 2 - (slopes[:-2] + slopes[2:]) / 4


def _columns(lines: Lines) -> NDArray[np.complex128]:
    return np.column_stack((lines.motion[:, X], lines.motion[:, V], lines.ramp))


def _spread(columns: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Covariance of the products of columns with noise of unit variance, correlated between neighbours."""
    total = (columns.conj().T @ columns).real
    for apart, correlation in enumerate(NEIGHBOURS[1:], start=1):
        product = (columns[apart:].conj().T @ columns[:-apart]).real
        total = total + correlation * (product + product.T)
    return np.asarray(total)


def _between(lines: Lines, low: float, high: float) -> Lines:
    return _selected(lines, (lines.frequency >= low) & (lines.frequency < high))


def _selected(lines: Lines, kept: NDArray[np.bool_]) -> Lines:
    return Lines(lines.frequency[kept], lines.force[kept], lines.motion[kept], lines.ramp[kept], lines.noise[kept])


Method = Literal["errors in variables", "output error", "weak form", "complex stiffness"]

DISAGREE = 3.0
"""Combined standard errors."""
COLOURED = 0.12
"""Correlation of residuals of neighbouring frames from which marker noise is coloured; for white noise it is < 0.08."""
HARMONICS = (2, 3)
BETWEEN_HARMONICS = (1.5, 2.5, 3.5, 4.5)
SETTLING = 0.5
"""Seconds left out at the start, because the simulation starts at rest under the first force."""
STEP = 0.01
ORDER = 8
"""Order of the autoregressive model of the residuals."""
OUTLIER = 5.0
ROUNDS = 20
HIGHEST = 10.0
SWING_POWER, CUTOFF_FACTOR = 0.95, 3.0
"""The force is low-pass filtered at three times the frequency below which 95 % of its power lie, at most 10 Hz, because
noise at the resonance of the model would bias the damping."""


@dataclass(frozen=True)
class CrossCheck:
    """k [N/m] and c [N s/m] of one record by another method, with the lag of the default method."""

    method: Method
    stiffness: Estimate
    damping: Estimate


@dataclass(frozen=True, eq=False)
class Checks(EqualByFields):
    """Cross-checks of a record.

    others               estimates of the other methods that can be applied to the record
    lines                spectral lines of the weak form, which can be combined over several records
    complex_stiffness    K* in bands of frequency, with the lag of the default method
    marker_correlation   correlation of the default method's marker residuals in neighbouring frames
    harmonics            (2,) N: residual force at two and three times the swing's frequency
    harmonic_noise       N: residual force between the harmonics
    not_converged        methods that did not converge on the record, and so are not compared
    """

    others: tuple[CrossCheck, ...]
    lines: tuple[Lines, ...]
    complex_stiffness: tuple[ComplexStiffness, ...]
    marker_correlation: float
    harmonics: tuple[float, ...]
    harmonic_noise: float
    not_converged: tuple[Method, ...] = ()

    @property
    def is_coloured(self) -> bool:
        """Whether marker noise is correlated in time; errors in variables would treat it as motion."""
        return self.marker_correlation > COLOURED


def check(swing: Swing, solution: SwingFit, frequency: float) -> Checks:
    """Cross-checks of a record whose force oscillates at `frequency` [Hz]."""
    aligned = swing.delayed(float(solution.parameters[TAU]))
    k, c = float(solution.parameters[K]), float(solution.parameters[C])
    lines = tapered_lines(aligned, solution.marker_noise)
    bands = complex_stiffness(lines, swing.mass, frequency)
    simulated = output_error(aligned, k, c)
    fits: dict[Method, tuple[Estimate, Estimate] | None] = {
        "weak form": fit_lines(lines, swing.mass),
        "output error": simulated.estimates,
    }
    if bands:
        main = min(bands, key=lambda band: abs(band.frequency - frequency))
        fits["complex stiffness"] = main.stiffness, main.damping
    harmonics = _residual_amplitudes(swing, solution, HARMONICS, frequency)
    between = _residual_amplitudes(swing, solution, BETWEEN_HARMONICS, frequency)
    return Checks(
        others=tuple(CrossCheck(method, *fit) for method, fit in fits.items() if fit),
        lines=tuple(lines),
        complex_stiffness=bands,
        marker_correlation=_neighbour_correlation(swing.marker_time, solution.marker_residual),
        harmonics=tuple(harmonics),
        harmonic_noise=math.sqrt(np.mean(np.square(between))),
        not_converged=("output error",) if simulated.outcome is FitOutcome.NOT_CONVERGED else (),
    )


def without_lag(solution: SwingFit) -> tuple[Estimate, Estimate]:
    """k and c of the default method, with their errors for a known lag."""
    k_error, c_error = solution.known_lag_sd
    return (
        normal_estimate(float(solution.parameters[K]), float(k_error)),
        normal_estimate(float(solution.parameters[C]), float(c_error)),
    )


def disagreements(default: tuple[Estimate, Estimate], checks: Checks) -> tuple[Note, ...]:
    """A note for every method that differs from the default method by more than DISAGREE combined standard errors."""
    found = []
    for other in checks.others:
        for name, unit, one, two in (
            ("stiffness", "N/m", default[0], other.stiffness),
            ("damping", "N s/m", default[1], other.damping),
        ):
            combined = math.hypot(one.standard_error, two.standard_error)
            if abs(one.value - two.value) > DISAGREE * combined:
                figures: Figures = {
                    "method": other.method,
                    "quantity": name,
                    "unit": unit,
                    "value": one.value,
                    "standard_error": one.standard_error,
                    "other": two.value,
                    "other_standard_error": two.standard_error,
                    "limit": DISAGREE,
                }
                found.append(Note(TrialNoteCode.DISAGREES, figures))
    return tuple(found)


def _neighbour_correlation(time: NDArray[np.float64], residual: NDArray[np.float64]) -> float:
    """Correlation of neighbouring residuals (frames,), without pairs across gaps; outliers are NaN."""
    step = np.diff(time)
    pairs = (step < 1.5 * np.median(step)) & np.isfinite(residual[1:]) & np.isfinite(residual[:-1])
    before, after = residual[:-1][pairs], residual[1:][pairs]
    return float(before @ after / math.sqrt((before @ before) * (after @ after)))


def _residual_amplitudes(swing: Swing, solution: SwingFit, orders: Sequence[float], frequency: float) -> list[float]:
    """Amplitudes [N] of the residual at `orders` times the frequency of the swing."""
    straight = np.polyval(np.polyfit(swing.force_time, solution.x, 1), swing.force_time)
    phase = np.unwrap(np.angle(scipy.signal.hilbert(solution.x - straight)))
    seen = np.isfinite(solution.marker_residual)
    at_markers = np.interp(swing.marker_time[seen], swing.force_time, phase)
    k, c = solution.parameters[[K, C]]
    found = []
    for order in orders:
        force = np.mean(solution.force_residual * np.exp(-1j * order * phase))
        displacement = np.mean(solution.marker_residual[seen] * np.exp(-1j * order * at_markers))
        found.append(2 * abs(complex(force + (k + 2j * np.pi * order * frequency * c) * displacement)))
    return found


@dataclass(frozen=True)
class OutputErrorFit:
    """k [N/m] and c [N s/m] of a record for a known lag; both None unless the outcome is CONVERGED.

    The outcome is NO_SOLUTION if no k, c > 0 describe the swing.
    """

    outcome: FitOutcome
    stiffness: Estimate | None = None
    damping: Estimate | None = None

    @property
    def estimates(self) -> tuple[Estimate, Estimate] | None:
        """k and c, or None."""
        return None if self.stiffness is None or self.damping is None else (self.stiffness, self.damping)


NO_SOLUTION = OutputErrorFit(FitOutcome.NO_SOLUTION)


def output_error(swing: Swing, stiffness: float, damping: float) -> OutputErrorFit:
    """Fit k and c by Gauss-Newton, starting at a stiffness [N/m] and a damping [N s/m]."""
    if stiffness <= 0:
        return NO_SOLUTION  # the simulation would diverge
    time = np.arange(swing.force_time[0], swing.force_time[-1], STEP)
    force = _without_noise(scipy.interpolate.CubicSpline(swing.force_time, swing.force)(time))
    u = (2 * time - time[0] - time[-1]) / (time[-1] - time[0])
    compared = (swing.marker_time >= time[0] + SETTLING) & (swing.marker_time <= time[-1])
    at, seen = swing.marker_time[compared], swing.displacement[compared]
    k, c = stiffness, max(damping, 0.01 * stiffness / (2 * math.pi))
    kept = np.ones(len(at), bool)
    for _ in range(ROUNDS):
        model = _motion(time, force, k, c, swing.mass)
        by_k = (_motion(time, force, 1.001 * k, c, swing.mass) - model) / (0.001 * k)
        by_c = (_motion(time, force, k, 1.001 * c, swing.mass) - model) / (0.001 * c)
        design = np.column_stack([np.interp(at, time, column) for column in (by_k, by_c, np.ones(len(time)), u)])
        error = seen - np.interp(at, time, model)
        change = np.linalg.lstsq(design[kept], error[kept], rcond=None)[0]
        residual = error - design @ change
        kept = np.abs(residual) < OUTLIER * 1.4826 * float(np.median(np.abs(residual))) + 1e-12
        k, c = k + float(change[0]), c + float(change[1])
        if not (k > 0 and c > 0):
            return NO_SOLUTION
        if abs(change[0]) < 1e-5 * k and abs(change[1]) < 1e-5 * c:
            break
    else:
        return OutputErrorFit(FitOutcome.NOT_CONVERGED)
    try:
        covariance = _covariance(design, np.where(kept, residual, 0.0))
    except np.linalg.LinAlgError:
        return NO_SOLUTION  # the frames that are not outliers do not determine k and c
    k_error, c_error = (math.sqrt(max(0.0, float(covariance[i, i]))) for i in range(2))
    if k_error > k:
        return NO_SOLUTION
    return OutputErrorFit(FitOutcome.CONVERGED, normal_estimate(k, k_error), normal_estimate(c, c_error))


def _without_noise(force: NDArray[np.float64]) -> NDArray[np.float64]:
    """The force (n,) at STEP, low-pass filtered above its swing."""
    power = np.abs(np.fft.rfft((force - force.mean()) * np.hanning(len(force)))) ** 2
    swing = float(np.fft.rfftfreq(len(force), STEP)[np.searchsorted(np.cumsum(power), SWING_POWER * power.sum())])
    low_pass = scipy.signal.butter(4, min(HIGHEST, max(CUTOFF_FACTOR * swing, 1.0)), fs=1 / STEP, output="sos")
    return np.asarray(scipy.signal.sosfiltfilt(low_pass, force))


def _motion(
    time: NDArray[np.float64], force: NDArray[np.float64], k: float, c: float, mass: float
) -> NDArray[np.float64]:
    """x (n,) [m] under a force (n,) [N] that is linear between the samples."""
    continuous = np.array([mass, c, k] if mass > 0 else [c, k])
    numerator, denominator, _ = scipy.signal.cont2discrete((np.ones(1), continuous), float(time[1] - time[0]), "foh")
    start = force[0]
    return np.asarray(
        KelvinVoigt(k, c).equilibrium(start) + scipy.signal.lfilter(np.ravel(numerator), denominator, force - start)
    )


def _covariance(design: NDArray[np.float64], residual: NDArray[np.float64]) -> NDArray[np.float64]:
    """(JᵀJ)⁻¹ Jᵀ R J (JᵀJ)⁻¹ with R from an autoregressive model of the residuals."""
    inverse = np.linalg.inv(design.T @ design)
    correlation = _autocovariance(residual, design.shape[1])
    both = np.concatenate((correlation[:0:-1], correlation))
    coloured = np.column_stack(
        [scipy.signal.fftconvolve(column, both, "valid") for column in _padded(design, len(correlation) - 1)]
    )
    return np.asarray(inverse @ (design.T @ coloured) @ inverse)


def _padded(design: NDArray[np.float64], side: int) -> NDArray[np.float64]:
    return np.pad(design, ((side, side), (0, 0))).T


def _autocovariance(residual: NDArray[np.float64], parameters: int) -> NDArray[np.float64]:
    """(n,) autocovariance of the autoregressive model that has the residuals' first ORDER ones (Yule-Walker)."""
    n = len(residual)
    first = np.array([residual[lag:] @ residual[: n - lag] for lag in range(ORDER + 1)]) / (n - parameters)
    weights = scipy.linalg.solve_toeplitz(first[:-1], first[1:])
    # Further autocovariances follow from the recursion of the model.
    rest = scipy.signal.lfilter(
        [1.0], np.concatenate(([1.0], -weights)), np.zeros(n - ORDER - 1), zi=_memory(first, weights)
    )[0]
    return np.concatenate((first, rest))


def _memory(first: NDArray[np.float64], weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """State of the recursive filter after the values `first`."""
    last = first[::-1]
    return np.array([weights[i:] @ last[: len(weights) - i] for i in range(len(weights))])
