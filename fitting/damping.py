"""Damping of one dynamic trial: what may be fitted, the fit, and what the lag does to it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fitting.errors_in_variables import TAU, C, K, Record, Solution, estimate
from fitting.oscillation import Oscillation, find_oscillation
from fitting.quality import UnusableTrial
from fitting.trial import Trial
from fitting.uncertainty import NORMAL_95, Estimate, Repeat

MIN_CYCLES = 3.0
MIN_SAMPLES_PER_CYCLE = 8.0
MIN_AMPLITUDE = 3.0
"""Times the marker noise."""
LAG_SHARE = 0.25
STEADY_STIFFNESS = 0.005
"""How far (relative) the stiffness of a swinging load may be from that of held ones where one serves the other."""
FIT_RATE = 250.0
"""Hz to which force is averaged: 5 % of a thousandth of its swing at 3 Hz is lost, and the fit is four times faster."""


@dataclass(frozen=True)
class DampingFit:
    """What one dynamic trial says.

    damping      c [N s/m]
    stiffness    k [N/m] of this record, on its own
    lag          τ [s] as far as the data moved it from 0, its prior
    offset       F0 [N]
    force_noise, marker_noise  standard deviation per sample [N] (at FIT_RATE), [m], as estimated
    uses_static_stiffness      whether k was tied to that of the held loads, because the lag is too uncertain
    oscillation  the stretch that was fitted
    time, displacement, velocity, damper_force  (n,) [s, m, m/s, N]: the fitted motion, and the measured
                 F − k x − m ẍ − F0 − F1 u over it, whose slope against velocity is c
    """

    damping: Repeat
    stiffness: Estimate
    lag: float
    offset: float
    force_noise: float
    marker_noise: float
    uses_static_stiffness: bool
    oscillation: Oscillation
    time: NDArray[np.float64]
    displacement: NDArray[np.float64]
    velocity: NDArray[np.float64]
    damper_force: NDArray[np.float64]


def fit_damping(trial: Trial, displacement: NDArray[np.float64], static_stiffness: Estimate | None) -> DampingFit:
    """c from a dynamic trial and its displacement (frames,) [m]. Raises UnusableTrial if the record cannot tell it.

    static_stiffness serves only where the lag alone would leave c uncertain by a quarter: a lag turns the phase of
    the complex stiffness k + iωc and keeps its magnitude, from which a known k leaves c.
    """
    oscillation = find_oscillation(trial.force_time, trial.force)
    _require_cycles(trial, oscillation)
    record = _cut(trial, displacement, oscillation)
    free = estimate(record)
    _require_amplitude(free)
    lag_share = free.parameters[K] * record.lag_sd / abs(free.parameters[C])
    if static_stiffness is None or lag_share < LAG_SHARE:
        return _fit(trial, oscillation, record, free, free)
    error = math.hypot(static_stiffness.standard_error, STEADY_STIFFNESS * static_stiffness.value)
    tied = estimate(
        Record(
            record.force_time,
            record.force,
            record.marker_time,
            record.displacement,
            record.mass,
            record.lag_sd,
            (static_stiffness.value, error),
        )
    )
    return _fit(trial, oscillation, record, free, tied)


def _require_cycles(trial: Trial, oscillation: Oscillation) -> None:
    if oscillation.cycles < MIN_CYCLES:
        raise UnusableTrial(
            f"the force swings {oscillation.cycles:.1f} times, expected at least {MIN_CYCLES:g}; pull longer"
        )
    per_cycle = 1 / float(np.median(np.diff(trial.force_time))) / oscillation.frequency
    if per_cycle < MIN_SAMPLES_PER_CYCLE:
        raise UnusableTrial(
            f"force has {per_cycle:.1f} samples in a cycle of {oscillation.frequency:.2f} Hz, expected at least "
            f"{MIN_SAMPLES_PER_CYCLE:g}; pull slower or raise daq.sample_rate_hz"
        )


def _require_amplitude(solution: Solution) -> None:
    amplitude = math.sqrt(2) * float(np.std(solution.x))
    if amplitude < MIN_AMPLITUDE * solution.marker_noise:
        raise UnusableTrial(
            f"the cuff moves by ± {1e3 * amplitude:.2f} mm, expected at least {MIN_AMPLITUDE:g} times the marker "
            f"noise of {1e3 * solution.marker_noise:.2f} mm; pull with more force"
        )


def _cut(trial: Trial, displacement: NDArray[np.float64], oscillation: Oscillation) -> Record:
    in_force = (trial.force_time >= oscillation.start) & (trial.force_time <= oscillation.end)
    in_frames = (trial.marker_time >= oscillation.start) & (trial.marker_time <= oscillation.end)
    seen = in_frames & np.isfinite(displacement)
    if np.count_nonzero(seen) < 0.5 * np.count_nonzero(in_frames):
        raise UnusableTrial("the markers are hidden in most of the dynamic pull; check the cameras' view")
    time, force = _averaged(trial.force_time[in_force], trial.force[in_force])
    return Record(
        time,
        force,
        trial.marker_time[seen],
        displacement[seen],
        trial.cuff_mass,
        trial.lag.total(oscillation.middle),
    )


def _averaged(time: NDArray[np.float64], force: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Means of as many neighbouring samples as leave at least FIT_RATE."""
    together = max(1, int(1 / float(np.median(np.diff(time))) / FIT_RATE + 1e-6))
    whole = len(time) // together * together
    return time[:whole].reshape(-1, together).mean(axis=1), force[:whole].reshape(-1, together).mean(axis=1)


def _fit(trial: Trial, oscillation: Oscillation, record: Record, free: Solution, used: Solution) -> DampingFit:
    """Splits what is uncertain into what is new in every trial and what all share (declared lag, drift, static k)."""
    c = float(used.parameters[C])
    total = float(used.covariance[C, C])
    noise = float(used.known_lag_sd[1]) ** 2
    if used is free:
        noise = min(total, noise + (float(used.parameters[K]) * trial.lag.edge) ** 2)
    k, k_error = float(free.parameters[K]), math.sqrt(float(free.covariance[K, K]))
    return DampingFit(
        damping=Repeat(c, math.sqrt(noise), math.sqrt(max(0.0, total - noise))),
        stiffness=Estimate(k, k_error, (k - NORMAL_95 * k_error, k + NORMAL_95 * k_error)),
        lag=float(used.parameters[TAU]),
        offset=float(used.parameters[2]),
        force_noise=used.force_noise,
        marker_noise=used.marker_noise,
        uses_static_stiffness=used is not free,
        oscillation=oscillation,
        time=record.force_time,
        displacement=used.x,
        velocity=used.velocity,
        damper_force=used.damper_force,
    )
