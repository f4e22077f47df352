"""The default estimate of k and c held against others that see the same record in other ways."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.signal import hilbert

from fitting.dynamic.errors_in_variables import TAU, C, K, Record, Solution
from fitting.dynamic.output_error import output_error
from fitting.dynamic.weak_form import ComplexStiffness, Lines, complex_stiffness, fit_lines, tapered_lines
from fitting.outcome import FitOutcome
from fitting.uncertainty import Estimate, normal_estimate

Method = Literal["errors in variables", "output error", "weak form", "complex stiffness"]

DISAGREE = 3.0
"""Combined standard errors."""
COLOURED = 0.12
"""Correlation of neighbouring frames' residuals from which marker noise is not white; white noise gives below 0.08."""
HARMONICS = (2, 3)
BETWEEN_HARMONICS = (1.5, 2.5, 3.5, 4.5)


@dataclass(frozen=True)
class CrossCheck:
    """k [N/m] and c [N s/m] of one record by another method, the lag as the default found it."""

    method: Method
    stiffness: Estimate
    damping: Estimate


@dataclass(frozen=True)
class Checks:
    """What else a record says.

    others               the other methods, as far as the record allows them
    lines                of the weak form, from which bands of several records can be made
    complex_stiffness    K* in bands of frequency, the lag as the default found it
    marker_correlation   of the default's residuals in neighbouring frames
    harmonics            (2,) N: residual force at twice and three times the swing's frequency
    harmonic_noise       N: the same between the harmonics
    not_converged        methods whose iteration did not converge on the record: they check nothing
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
        """Whether the noise of the markers is correlated in time, which errors in variables takes for motion."""
        return self.marker_correlation > COLOURED


def check(record: Record, solution: Solution, frequency: float) -> Checks:
    """The cross-checks of a record that swings at `frequency` [Hz]."""
    aligned = replace(record, force_time=record.force_time + solution.parameters[TAU])
    k, c = float(solution.parameters[K]), float(solution.parameters[C])
    lines = tapered_lines(aligned, solution.marker_noise)
    bands = complex_stiffness(lines, record.mass, frequency)
    simulated = output_error(aligned, k, c)
    fits: dict[Method, tuple[Estimate, Estimate] | None] = {
        "weak form": fit_lines(lines, record.mass),
        "output error": simulated.estimates,
    }
    if bands:
        main = min(bands, key=lambda band: abs(band.frequency - frequency))
        fits["complex stiffness"] = main.stiffness, main.damping
    harmonics = _residual_amplitudes(record, solution, HARMONICS, frequency)
    between = _residual_amplitudes(record, solution, BETWEEN_HARMONICS, frequency)
    return Checks(
        others=tuple(CrossCheck(method, *fit) for method, fit in fits.items() if fit),
        lines=tuple(lines),
        complex_stiffness=bands,
        marker_correlation=_neighbour_correlation(record.marker_time, solution.marker_residual),
        harmonics=tuple(harmonics),
        harmonic_noise=math.sqrt(np.mean(np.square(between))),
        not_converged=("output error",) if simulated.outcome is FitOutcome.NOT_CONVERGED else (),
    )


def without_lag(solution: Solution) -> tuple[Estimate, Estimate]:
    """k and c of the default, their errors as if the lag it found were known."""
    k_error, c_error = solution.known_lag_sd
    return (
        normal_estimate(float(solution.parameters[K]), float(k_error)),
        normal_estimate(float(solution.parameters[C]), float(c_error)),
    )


def disagreements(default: tuple[Estimate, Estimate], checks: Checks) -> tuple[str, ...]:
    """A sentence for every method that differs from the default by more than three combined standard errors."""
    found = []
    for other in checks.others:
        for name, unit, one, two in (
            ("stiffness", "N/m", default[0], other.stiffness),
            ("damping", "N s/m", default[1], other.damping),
        ):
            combined = math.hypot(one.standard_error, two.standard_error)
            if abs(one.value - two.value) > DISAGREE * combined:
                found.append(
                    f"{other.method} gives a {name} of {two.value:.0f} ± {two.standard_error:.0f} {unit}, the fit "
                    f"{one.value:.0f} ± {one.standard_error:.0f} {unit}, more than {DISAGREE:g} standard errors apart: "
                    "F = k x + c ẋ does not describe all of this record"
                )
    return tuple(found)


def _neighbour_correlation(time: NDArray[np.float64], residual: NDArray[np.float64]) -> float:
    """Of residuals (frames,) that follow each other without a hole; outliers are NaN."""
    step = np.diff(time)
    pairs = (step < 1.5 * np.median(step)) & np.isfinite(residual[1:]) & np.isfinite(residual[:-1])
    before, after = residual[:-1][pairs], residual[1:][pairs]
    return float(before @ after / math.sqrt((before @ before) * (after @ after)))


def _residual_amplitudes(record: Record, solution: Solution, orders: Sequence[float], frequency: float) -> list[float]:
    """Amplitudes [N] of what the law does not explain at so many times the phase of the swing."""
    straight = np.polyval(np.polyfit(record.force_time, solution.x, 1), record.force_time)
    phase = np.unwrap(np.angle(hilbert(solution.x - straight)))
    seen = np.isfinite(solution.marker_residual)
    at_markers = np.interp(record.marker_time[seen], record.force_time, phase)
    k, c = solution.parameters[[K, C]]
    found = []
    for order in orders:
        force = np.mean(solution.force_residual * np.exp(-1j * order * phase))
        way = np.mean(solution.marker_residual[seen] * np.exp(-1j * order * at_markers))
        found.append(2 * abs(complex(force + (k + 2j * np.pi * order * frequency * c) * way)))
    return found
