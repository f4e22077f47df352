"""Records of a swing whose truth is written out: F = k x + c ẋ + m ẍ + offset, with noise of any colour."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from fitting.dynamic.swing import Swing

STIFFNESS, DAMPING, MASS = 5500.0, 120.0, 0.2


def swing(
    seed: int,
    *,
    k: float = STIFFNESS,
    c: float = DAMPING,
    force_noise: float = 0.25,
    marker_noise: float = 0.157e-3,
    colour: float = 0.0,
    seconds: float = 20.0,
    rate: float = 250.0,
    frequency: float = 1.0,
    lag_sd: float = 0.0,
    lag_error: float = 0.0,
) -> Swing:
    """About ± 12 N at a frequency that wanders; marker noise with a correlation time of `colour` seconds.

    The true lag is drawn from its prior, lag_sd; lag_error comes on top of it.
    """
    random = np.random.default_rng(seed)
    force_time, marker_time = np.arange(0, seconds, 1 / rate), np.arange(0.003, seconds, 0.01)
    turn = 2 * np.pi * frequency * np.array([1.0, *random.uniform(0.85, 1.15, 3)])
    size = 12.0 / k * np.array([1.0, *(0.15 * random.standard_normal(3))])
    phase = random.uniform(0, 6.28, 4)

    def motion(t: NDArray[np.float64], order: int) -> NDArray[np.float64]:
        each = size * turn**order * np.sin(np.outer(t, turn) + phase + order * np.pi / 2)
        return np.asarray(each.sum(axis=1))

    at = force_time + lag_sd * random.standard_normal() + lag_error
    force = k * motion(at, 0) + c * motion(at, 1) + MASS * motion(at, 2) + 25.0
    noise = random.standard_normal(len(marker_time) + 2000)
    if colour:
        memory = np.exp(-0.01 / colour)
        noise = lfilter([np.sqrt(1 - memory**2)], [1, -memory], noise)
    return Swing(
        force_time,
        force + force_noise * random.standard_normal(len(force_time)),
        marker_time,
        motion(marker_time, 0) + marker_noise * noise[2000:],
        MASS,
        lag_sd,
    )
