"""Which repeat of a donning does not agree with the others, and in which trial the cuff slipped."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from fitting.result import TrialFit
from fitting.uncertainty import Estimate

COMPARED: tuple[Literal["stiffness", "damping"], ...] = ("stiffness", "damping")
OUTLYING = 3.0
"""Combined standard errors from which a repeat is called different from the others."""
SLIPPED = 0.025
"""Metres of migration in one trial; no published cuff has shown more than 22 mm in a session."""
LEAST_ERROR = 1e-12


@dataclass(frozen=True)
class Outlier:
    """A quantity of one repeat [SI], the mean of the other repeats, and their distance in combined standard errors."""

    quantity: Literal["stiffness", "damping"]
    value: float
    mean: float
    distance: float


def find_outliers(trial: TrialFit, others: Sequence[TrialFit]) -> tuple[Outlier, ...]:
    """Stiffness and damping of a trial that differ from those of the other repeats of the donning."""
    found = []
    for quantity in COMPARED:
        this = getattr(trial, quantity)
        rest = [estimate for other in others if (estimate := getattr(other, quantity)) is not None]
        if this is None or not rest:
            continue
        mean, error = _pooled(rest)
        distance = abs(this.value - mean) / max(math.hypot(this.standard_error, error), LEAST_ERROR)
        if distance > OUTLYING:
            found.append(Outlier(quantity, this.value, mean, distance))
    return tuple(found)


def has_slipped(trial: TrialFit) -> bool:
    """Whether the cuff migrated further in this trial than a cuff that holds."""
    return trial.migration is not None and trial.migration.value > SLIPPED


def _pooled(estimates: Sequence[Estimate]) -> tuple[float, float]:
    """Mean of some estimates and its standard error, from their spread or their own errors, whichever is larger."""
    values = np.array([estimate.value for estimate in estimates])
    own = float(np.sqrt(np.mean([estimate.standard_error**2 for estimate in estimates])))
    spread = float(values.std(ddof=1)) if len(values) > 1 else 0.0
    return float(values.mean()), max(own, spread)
