"""The lag from the magnitude of the complex stiffness, where the stiffness is known from held loads.

A lag turns K = k − m ω² + iωc by e^(iωτ) and keeps its magnitude: of all τ that its prior allows, those count at which
the k that is left is the known one. What they leave of c is far from a normal distribution where ωc is small against k,
so its mean and spread are taken over all τ.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fitting.dynamic.errors_in_variables import TAU, C, K, Solution
from fitting.uncertainty import Estimate

REACH, STEPS = 4.0, 801
"""Of the prior, in standard deviations, and how finely it is cut."""


@dataclass(frozen=True)
class LagPosterior:
    """The lag [s] that the magnitude tells, its standard uncertainty, and that of the damping [N s/m]."""

    lag: float
    lag_sd: float
    damping_sd: float


def lag_of_magnitude(solution: Solution, mass: float, frequency: float, known: Estimate, lag_sd: float) -> LagPosterior:
    """From a record that swings at `frequency` [Hz], a known stiffness [N/m] and the lag's prior, 0 ± lag_sd [s].

    A cuff takes energy: a lag that leaves c < 0 does not count.
    """
    omega = 2 * math.pi * frequency
    k, c, found = (float(solution.parameters[each]) for each in (K, C, TAU))
    lags = np.linspace(-REACH, REACH, STEPS) * lag_sd
    turned = complex(k - mass * omega**2, omega * c) * np.exp(1j * omega * (found - lags))
    stiffness, damping = turned.real + mass * omega**2, turned.imag / omega
    error = math.hypot(known.standard_error, float(solution.known_lag_sd[0]))
    cost = ((stiffness - known.value) / error) ** 2 + (lags / lag_sd) ** 2
    cost[damping < 0] = np.inf
    weight = np.exp(-0.5 * (cost - cost.min())) if np.isfinite(cost).any() else np.ones(STEPS)
    weight /= weight.sum()
    lag, mean = float(weight @ lags), float(weight @ damping)
    return LagPosterior(
        lag,
        math.sqrt(float(weight @ (lags - lag) ** 2)),
        math.sqrt(float(weight @ (damping - mean) ** 2)),
    )
