"""Compare the default estimate of k and c with other methods on the same record."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from fitting.dynamic.errors_in_variables import TAU, C, K, Solution
from fitting.dynamic.output_error import output_error
from fitting.dynamic.swing import Swing
from fitting.dynamic.weak_form import ComplexStiffness, Lines, complex_stiffness, fit_lines, tapered_lines
from fitting.results.codes import TrialNoteCode
from fitting.results.outcome import FitOutcome
from fitting.results.rendering import Figures, Note
from fitting.uncertainty import Estimate, normal_estimate

Method = Literal["errors in variables", "output error", "weak form", "complex stiffness"]

DISAGREE = 3.0
"""Combined standard errors."""
COLOURED = 0.12
"""Correlation of residuals of neighbouring frames from which marker noise is coloured; for white noise it is < 0.08."""
HARMONICS = (2, 3)
BETWEEN_HARMONICS = (1.5, 2.5, 3.5, 4.5)


@dataclass(frozen=True)
class CrossCheck:
    """k [N/m] and c [N s/m] of one record by another method, with the lag of the default method."""

    method: Method
    stiffness: Estimate
    damping: Estimate


@dataclass(frozen=True)
class Checks:
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
