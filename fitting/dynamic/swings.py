"""Fit all dynamic trials of one donning: damping, energy of a cycle, complex stiffness."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from fitting.dynamic.damping import DampingFit, fit_damping
from fitting.dynamic.weak_form import ComplexStiffness, complex_stiffness
from fitting.errors import UnusableTrial
from fitting.pull.pull import Pull, newest_first
from fitting.results.rendering import Note
from fitting.trial.oscillation import Oscillation
from fitting.uncertainty import Estimate, combine

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
