"""Weak form of F = k x + c ẋ + m ẍ + F0 + F1 u with tapered sines as test functions, so no sample is differentiated.

With φ(t) = sin²(π t/T) exp(−iωt) over a stretch of T seconds, φ and φ̇ vanish at both ends; integration by parts gives

    ∫φ F = k ∫φ x − c ∫φ̇ x + m ∫φ̈ x + F1 ∫φ u          (∫φ F0 = 0 from the second ω = 2πj/T on)

one complex equation (spectral line) per ω, for any sampling. Noise of x adds a known mean to the normal matrix, which
is subtracted. All lines together give k and c; the lines of a frequency band give the complex stiffness of the band.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from documents.results import EqualByFields
from fitting.dynamic.errors_in_variables import Swing
from fitting.uncertainty import Estimate, student_estimate

LONGEST_GAP = 0.15
"""Longest gap of the markers [s] that a cubic spline interpolates; a longer gap ends the stretch."""
MIN_STRETCH = 3.0
LOWEST, HIGHEST = 0.25, 6.0
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
    highest = int(min(HIGHEST, 0.25 / max(step, force_step)) * length)
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
    return _selected(lines, stands_out & (frequency >= LOWEST) & (frequency * length > 1.5))


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
