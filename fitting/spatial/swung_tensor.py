"""Damping in three dimensions from swings: the measured force vector drives m Ẍ + C Ẋ + K X = F u.

Output error, as in output_error.py: the simulated displacement is fitted to the markers, so marker noise causes no
bias. The law is solved in the frequency domain, X(ω) = (K + iωC − ω²m)⁻¹ (F u)(ω). The start is a fit of
X = A F u + B d(F u)/dt, linear in symmetric A and B. K of the swings is fitted with C, because it may differ from that
of the held loads.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from fitting.errors import UnusableTrial
from fitting.pull.pull import Pull
from fitting.results.codes import TensorCode
from fitting.results.outcome import FitOutcome
from fitting.spatial.tensor import NoTensor, Tensor, entries_of, posture_error, require_span, symmetric, unit_tensors
from fitting.trial.oscillation import Oscillation, find_oscillation
from fitting.uncertainty import NORMAL_95

SETTLING = 0.5
"""Seconds at both ends that are simulated but not compared."""
HIGHEST = 10.0
"""Cut-off frequency [Hz] of the low-pass filter of the force, below the Nyquist frequency of the markers."""
OUTLIER = 5.0
ROUNDS = 40
STEP_TOLERANCE = 0.03
"""Largest last step in standard errors."""


def swung_tensor(trials: Sequence[Pull], swings: Mapping[str, Oscillation], gain_sd: float) -> Tensor:
    """C (3, 3) [N s/m] of the dynamic trials of one donning; swings by file, if known. Raises NoTensor."""
    seen = [(pull, rope) for pull in trials if (rope := pull.motion.rope) is not None]
    if not seen:
        raise NoTensor(TensorCode.NO_ROPE, {"quantity": "damping", "test": "dynamic"})
    directions = require_span(np.array([pull.direction for pull, _ in seen]), "damping", "dynamic")
    cut = [_cut(pull, rope, swings.get(pull.trial.file)) for pull, rope in seen]
    parameters = _start(cut)
    for _ in range(ROUNDS):
        change, covariance = _step(cut, parameters)
        parameters = parameters + change
        if np.all(np.abs(change) < STEP_TOLERANCE * np.sqrt(np.diag(covariance))):
            break
    else:
        raise NoTensor(TensorCode.NOT_CONVERGED, {"quantity": "damping"}, FitOutcome.NOT_CONVERGED)
    stiffness, damping = parameters[:6], parameters[6:]
    # To first order a lag τ adds K τ to C, equally in all trials.
    lag = max(swing.lag_sd for swing in cut)
    tensor = Tensor(symmetric(damping), covariance[6:, 6:], NORMAL_95, directions)
    posture = posture_error(tensor.value, seen[0][0].motion.anchor, seen[0][0].markers.anchor_rms)
    return tensor.widened(
        {"lag": lag**2 * np.outer(stiffness, stiffness), "gain": tensor.scaled_error(gain_sd), "posture": posture}
    )


@dataclass(frozen=True)
class _Swing:
    """One swing on the regular grid of frames: force vector (n, 3) [N], displacement (n, 3) [m], compared frames."""

    step: float
    force: NDArray[np.float64]
    x: NDArray[np.float64]
    is_compared: NDArray[np.bool_]
    mass: float
    frequency: float
    lag_sd: float


def _cut(pull: Pull, rope: NDArray[np.float64], oscillation: Oscillation | None) -> _Swing:
    trial = pull.trial
    try:
        oscillation = oscillation or find_oscillation(pull.force_time, pull.force)
    except UnusableTrial as error:
        raise NoTensor(
            TensorCode.NO_SWING, {"file": trial.file, "reason": str(error), "reason_code": error.reason.code}
        ) from error
    inside = (pull.marker_time >= max(oscillation.start - SETTLING, pull.force_time[0])) & (
        pull.marker_time <= min(oscillation.end + SETTLING, pull.force_time[-1])
    )
    time = pull.marker_time[inside]
    step = float(np.median(np.diff(time)))
    rope = rope[inside] * np.sign(np.nansum(rope[inside], axis=0) @ pull.direction)
    known = np.isfinite(rope).all(axis=1)
    if np.count_nonzero(known) < len(time) / 2:
        raise NoTensor(TensorCode.ROPE_HIDDEN, {"quantity": "damping", "file": trial.file})
    u = np.column_stack([np.interp(time, time[known], column[known]) for column in rope.T])
    low_pass = scipy.signal.butter(4, min(HIGHEST, 0.4 / step), fs=1 / step, output="sos")
    force = np.asarray(
        scipy.signal.sosfiltfilt(low_pass, _force_at(pull.force_time, pull.force, time, step)[:, None] * u, axis=0)
    )
    x = pull.motion.displacement[inside]
    is_compared = np.isfinite(x).all(axis=1) & (time >= time[0] + SETTLING) & (time <= time[-1] - SETTLING)
    return _Swing(
        step, force, x, is_compared, trial.cuff_mass, oscillation.frequency, trial.lag.total(oscillation.middle)
    )


def _force_at(
    force_time: NDArray[np.float64], force: NDArray[np.float64], time: NDArray[np.float64], step: float
) -> NDArray[np.float64]:
    """Force (n,) at the frames: block means over half a frame, interpolated by a cubic spline."""
    per_block = max(1, int(step / 2 / float(np.median(np.diff(force_time)))))
    whole = len(force) // per_block * per_block
    means = (values[:whole].reshape(-1, per_block).mean(axis=1) for values in (force_time, force))
    return np.asarray(scipy.interpolate.CubicSpline(*means)(time))


def _start(swings: Sequence[_Swing]) -> NDArray[np.float64]:
    """K and C (12,) from X = A f + B ḟ: to first order in the frequency A = K⁻¹ and B = −A C A."""
    normal, right = np.zeros((12, 12)), np.zeros(12)
    for swing in swings:
        rate = np.gradient(swing.force, swing.step, axis=0)
        design = np.concatenate(
            [np.einsum("eij,nj->nie", unit_tensors(), vector) for vector in (swing.force, rate)], axis=2
        )
        both = _without_slow(
            swing, np.concatenate((design[swing.is_compared], swing.x[swing.is_compared, :, None]), axis=2)
        )
        columns, seen = both[..., :-1].reshape(-1, 12), both[..., -1].ravel()
        normal, right = normal + columns.T @ columns, right + columns.T @ seen
    scale = np.sqrt(np.diag(normal))
    solved = np.linalg.solve(normal / np.outer(scale, scale), right / scale) / scale
    stiffness = np.asarray(np.linalg.inv(symmetric(solved[:6])), dtype=np.float64)
    return np.concatenate((entries_of(stiffness), entries_of(-stiffness @ symmetric(solved[6:12]) @ stiffness)))


def _without_slow(swing: _Swing, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values (frames, 3, columns) without the offset and linear drift of the trial along every axis."""
    u = np.linspace(-1, 1, len(swing.x))[swing.is_compared]
    slow, _ = np.linalg.qr(np.column_stack((np.ones(len(u)), u)))
    return np.asarray(values - np.tensordot(slow, np.tensordot(slow.T, values, 1), 1))


def _step(swings: Sequence[_Swing], parameters: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """One step of Gauss-Newton (12,), and the covariance (12, 12) there."""
    normal, right = np.zeros((12, 12)), np.zeros(12)
    for swing in swings:
        model, slopes = _motion(swing, parameters)
        both = np.concatenate((slopes.transpose(1, 2, 0), (swing.x - model)[..., None]), axis=2)[swing.is_compared]
        both = _without_slow(swing, both).reshape(-1, 13)
        jacobian, residual = both[:, :-1], both[:, -1]
        limit = OUTLIER * 1.4826 * float(np.median(np.abs(residual))) + 1e-12
        residual = np.clip(residual, -limit, limit)
        weight = 1 / _noise(swing, residual.reshape(-1, 3)) ** 2
        normal += weight * jacobian.T @ jacobian
        right += weight * jacobian.T @ residual
    covariance = np.asarray(np.linalg.inv(normal), dtype=np.float64)
    return covariance @ right, covariance


def _motion(swing: _Swing, parameters: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """X (n, 3) and its derivatives (12, n, 3) with respect to the entries of K and C."""
    stiffness, damping = symmetric(parameters[:6]), symmetric(parameters[6:])
    count = len(swing.force)
    omega = 2j * np.pi * np.fft.rfftfreq(count, swing.step)[:, None, None]
    receptance = np.linalg.inv(stiffness + omega * damping + omega**2 * swing.mass * np.eye(3))
    varying = swing.force - swing.force.mean(axis=0)
    spectrum = (receptance @ np.fft.rfft(varying, axis=0)[..., None])[..., 0]
    by_stiffness = [-(receptance @ (unit @ spectrum[..., None]))[..., 0] for unit in unit_tensors()]
    spectra = np.array([*by_stiffness, *(omega[..., 0] * slope for slope in by_stiffness)])
    return np.fft.irfft(spectrum, count, axis=0), np.fft.irfft(spectra, count, axis=1)


def _noise(swing: _Swing, residual: NDArray[np.float64]) -> float:
    """Standard deviation per frame and axis; the level near the swing's frequency if that is higher."""
    power = np.mean(np.abs(np.fft.rfft(residual, axis=0)) ** 2, axis=1) / len(residual)
    frequency = np.fft.rfftfreq(len(residual), swing.step)
    near = (frequency > 0.5 * swing.frequency) & (frequency < 2 * swing.frequency)
    return max(math.sqrt(max(float(np.mean(residual**2)), float(np.mean(power[near])))), 1e-9)
