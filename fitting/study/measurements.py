"""Repeated measurements of a quantity of a cuff, as a study collects them over sessions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fitting.study.reml import Array
from fitting.study.variance_components import Factor

VOLUNTEER, OPERATOR, DONNING, REPEAT, INTERACTION = (
    "volunteer",
    "operator",
    "donning",
    "repeat",
    "volunteer_by_cuff",
)
"""Names of the variance components."""


@dataclass(frozen=True)
class Observation:
    """One value, its standard error of its own (noise), and the one that its session shares (lag, gain).

    donning and repeat are numbered within the session.
    """

    value: float
    noise: float
    shared: float
    volunteer: str
    operator: str
    session: str
    donning: str
    repeat: int
    cuff: str = ""

    @property
    def donning_key(self) -> str:
        """The donning, unique in the study."""
        return f"{self.session} {self.cuff} {self.donning}"


def values_of(measurements: Sequence[Observation]) -> Array:
    """(n,)"""
    return np.array([measurement.value for measurement in measurements], dtype=np.float64)


def known_covariance(measurements: Sequence[Observation]) -> Array:
    """Covariance (n, n) of the known errors of the fits: noise of each value, and common errors of a session."""
    noise = np.array([measurement.noise for measurement in measurements])
    shared = np.array([measurement.shared for measurement in measurements])
    sessions = Factor("session", [measurement.session for measurement in measurements]).incidence()
    return np.diag(noise**2) + (sessions @ sessions.T) * np.outer(shared, shared)


def study_factors(measurements: Sequence[Observation]) -> list[Factor]:
    """Random effects of a study; of those that its design does not separate, the first keeps the estimate.

    Donnings are nested in volunteers, repeats in donnings; operators are crossed with volunteers.
    """
    by_cuff = len({measurement.cuff for measurement in measurements}) > 1
    labels: dict[str, list[object]] = {VOLUNTEER: [measurement.volunteer for measurement in measurements]}
    if by_cuff:
        labels[INTERACTION] = [f"{measurement.volunteer} {measurement.cuff}" for measurement in measurements]
    labels[DONNING] = [measurement.donning_key for measurement in measurements]
    labels[REPEAT] = list(range(len(measurements)))
    labels[OPERATOR] = [measurement.operator for measurement in measurements]
    return [Factor(name, found) for name, found in labels.items()]
