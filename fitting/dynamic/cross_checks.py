"""Compare the default estimate of k and c with other methods on the same record.

Output error: the measured force drives m ẍ + c ẋ + k x = F − F0 − F1 u, and x is fitted to the markers.

The method needs no spline and no weights between the instruments, and its covariance allows coloured residuals, by an
autoregressive model. So it is used if the marker noise is correlated in time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from documents.results import EqualByFields
from fitting.dynamic.errors_in_variables import TAU, C, K, Solution, Swing
from fitting.dynamic.weak_form import ComplexStiffness, Lines, complex_stiffness, fit_lines, tapered_lines
from fitting.results.codes import TrialNoteCode
from fitting.results.outcome import FitOutcome
from fitting.results.rendering import Figures, Note
from fitting.uncertainty import Estimate, normal_estimate
from solver.cuff import KelvinVoigt

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


def check(swing: Swing, solution: Solution, frequency: float) -> Checks:
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


def without_lag(solution: Solution) -> tuple[Estimate, Estimate]:
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


def _residual_amplitudes(swing: Swing, solution: Solution, orders: Sequence[float], frequency: float) -> list[float]:
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
