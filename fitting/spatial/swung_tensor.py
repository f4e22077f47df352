"""Damping in three dimensions from swings: the measured force vector drives m Ẍ + C Ẋ + K X = F u.

Output error, as in output_error.py: displacement is laid over the markers, so its noise biases nothing. The
law is solved in the frequency domain, X(ω) = (K + iωC − ω²m)⁻¹ (F u)(ω); its start is X = A F u + B d(F u)/dt, linear
in symmetric A and B. The swings' own K is fitted beside C: that of held loads may differ.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import butter, sosfiltfilt

from fitting.oscillation import Oscillation, find_oscillation
from fitting.outcome import FitOutcome
from fitting.quality import UnusableTrial
from fitting.spatial.posture import posture_error
from fitting.spatial.reduction import ReducedTrial
from fitting.spatial.tensor import NoTensor, Tensor, entries_of, require_span, symmetric, unit_tensors
from fitting.uncertainty import NORMAL_95

SETTLING = 0.5
"""Seconds at both ends that are driven and not compared."""
HIGHEST = 10.0
"""Hz that are kept of the force, below a marker's Nyquist frequency."""
OUTLIER = 5.0
ROUNDS = 40
RESTS = 0.03
"""Standard errors by which the last step may still go."""


def swung_tensor(trials: Sequence[ReducedTrial], swings: Mapping[str, Oscillation], gain_sd: float) -> Tensor:
    """C (3, 3) [N s/m] of the dynamic trials of one donning; swings by file where known. Raises NoTensor."""
    seen = [(each, rope) for each in trials if (rope := each.motion.rope) is not None]
    if not seen:
        raise NoTensor("damping in three dimensions needs two markers on the rope (rope_markers) and dynamic trials")
    directions = require_span(np.array([each.direction for each, _ in seen]), "damping", "dynamic")
    pulls = [_pull(each, rope, swings.get(each.trial.file)) for each, rope in seen]
    parameters = _start(pulls)
    for _ in range(ROUNDS):
        change, covariance = _step(pulls, parameters)
        parameters = parameters + change
        if np.all(np.abs(change) < RESTS * np.sqrt(np.diag(covariance))):
            break
    else:
        raise NoTensor(
            "damping in three dimensions is not identified: the fit did not converge; pull with more force",
            FitOutcome.NOT_CONVERGED,
        )
    stiffness, damping = parameters[:6], parameters[6:]
    # To first order a lag τ adds K τ to C, in all trials alike.
    lag = max(pull.lag_sd for pull in pulls)
    tensor = Tensor(symmetric(damping), covariance[6:, 6:], NORMAL_95, directions)
    posture = posture_error(tensor.value, seen[0][0].trial, seen[0][0].markers.anchor_rms)
    return tensor.widened(
        {"lag": lag**2 * np.outer(stiffness, stiffness), "gain": tensor.scaled_error(gain_sd), "posture": posture}
    )


@dataclass(frozen=True)
class _Pull:
    """One swing on its even grid of frames: force vector (n, 3) [N], displacement (n, 3) [m], which frames count."""

    step: float
    force: NDArray[np.float64]
    x: NDArray[np.float64]
    counts: NDArray[np.bool_]
    mass: float
    frequency: float
    lag_sd: float


def _pull(each: ReducedTrial, rope: NDArray[np.float64], swing: Oscillation | None) -> _Pull:
    trial, motion = each.trial, each.motion
    try:
        swing = swing or find_oscillation(trial.force_time, trial.force)
    except UnusableTrial as error:
        raise NoTensor(f"damping in three dimensions is not told: in {trial.file} {error}") from error
    inside = (trial.marker_time >= max(swing.start - SETTLING, trial.force_time[0])) & (
        trial.marker_time <= min(swing.end + SETTLING, trial.force_time[-1])
    )
    time = trial.marker_time[inside]
    step = float(np.median(np.diff(time)))
    rope = rope[inside] * np.sign(np.nansum(rope[inside], axis=0) @ each.direction)
    known = np.isfinite(rope).all(axis=1)
    if np.count_nonzero(known) < len(time) / 2:
        raise NoTensor(f"damping in three dimensions needs the rope's markers, hidden in most of {trial.file}")
    u = np.column_stack([np.interp(time, time[known], column[known]) for column in rope.T])
    low_pass = butter(4, min(HIGHEST, 0.4 / step), fs=1 / step, output="sos")
    force = np.asarray(sosfiltfilt(low_pass, _force_at(trial.force_time, trial.force, time, step)[:, None] * u, axis=0))
    x = motion.displacement[inside]
    counts = np.isfinite(x).all(axis=1) & (time >= time[0] + SETTLING) & (time <= time[-1] - SETTLING)
    return _Pull(step, force, x, counts, trial.cuff_mass, swing.frequency, trial.lag.total(swing.middle))


def _force_at(
    force_time: NDArray[np.float64], force: NDArray[np.float64], time: NDArray[np.float64], step: float
) -> NDArray[np.float64]:
    """Force (n,) at the frames: means of as many samples as make half a frame, led on by a cubic spline."""
    together = max(1, int(step / 2 / float(np.median(np.diff(force_time)))))
    whole = len(force) // together * together
    means = (values[:whole].reshape(-1, together).mean(axis=1) for values in (force_time, force))
    return np.asarray(CubicSpline(*means)(time))


def _start(pulls: Sequence[_Pull]) -> NDArray[np.float64]:
    """K and C (12,) from X = A f + B ḟ: to first order in the frequency A = K⁻¹ and B = −A C A."""
    normal, right = np.zeros((12, 12)), np.zeros(12)
    for pull in pulls:
        rate = np.gradient(pull.force, pull.step, axis=0)
        design = np.concatenate([np.einsum("eij,nj->nie", unit_tensors(), each) for each in (pull.force, rate)], axis=2)
        both = _without_slow(pull, np.concatenate((design[pull.counts], pull.x[pull.counts, :, None]), axis=2))
        columns, seen = both[..., :-1].reshape(-1, 12), both[..., -1].ravel()
        normal, right = normal + columns.T @ columns, right + columns.T @ seen
    scale = np.sqrt(np.diag(normal))
    solved = np.linalg.solve(normal / np.outer(scale, scale), right / scale) / scale
    stiffness = np.asarray(np.linalg.inv(symmetric(solved[:6])), dtype=np.float64)
    return np.concatenate((entries_of(stiffness), entries_of(-stiffness @ symmetric(solved[6:12]) @ stiffness)))


def _without_slow(pull: _Pull, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values (frames, 3, columns) without the trial's own offset and drift along each axis."""
    u = np.linspace(-1, 1, len(pull.x))[pull.counts]
    slow, _ = np.linalg.qr(np.column_stack((np.ones(len(u)), u)))
    return np.asarray(values - np.tensordot(slow, np.tensordot(slow.T, values, 1), 1))


def _step(pulls: Sequence[_Pull], parameters: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """One step of Gauss-Newton (12,), and the covariance (12, 12) there."""
    normal, right = np.zeros((12, 12)), np.zeros(12)
    for pull in pulls:
        model, slopes = _motion(pull, parameters)
        both = np.concatenate((slopes.transpose(1, 2, 0), (pull.x - model)[..., None]), axis=2)[pull.counts]
        both = _without_slow(pull, both).reshape(-1, 13)
        jacobian, left = both[:, :-1], both[:, -1]
        reach = OUTLIER * 1.4826 * float(np.median(np.abs(left))) + 1e-12
        left = np.clip(left, -reach, reach)
        weight = 1 / _noise(pull, left.reshape(-1, 3)) ** 2
        normal += weight * jacobian.T @ jacobian
        right += weight * jacobian.T @ left
    covariance = np.asarray(np.linalg.inv(normal), dtype=np.float64)
    return covariance @ right, covariance


def _motion(pull: _Pull, parameters: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """X (n, 3) and its slopes (12, n, 3) by the entries of K and C."""
    stiffness, damping = symmetric(parameters[:6]), symmetric(parameters[6:])
    count = len(pull.force)
    omega = 2j * np.pi * np.fft.rfftfreq(count, pull.step)[:, None, None]
    answer = np.linalg.inv(stiffness + omega * damping + omega**2 * pull.mass * np.eye(3))
    swing = pull.force - pull.force.mean(axis=0)
    spectrum = (answer @ np.fft.rfft(swing, axis=0)[..., None])[..., 0]
    by_stiffness = [-(answer @ (unit @ spectrum[..., None]))[..., 0] for unit in unit_tensors()]
    spectra = np.array([*by_stiffness, *(omega[..., 0] * each for each in by_stiffness)])
    return np.fft.irfft(spectrum, count, axis=0), np.fft.irfft(spectra, count, axis=1)


def _noise(pull: _Pull, left: NDArray[np.float64]) -> float:
    """Standard deviation per frame and axis; the residuals' level about the swing's frequency if that is the higher."""
    power = np.mean(np.abs(np.fft.rfft(left, axis=0)) ** 2, axis=1) / len(left)
    frequency = np.fft.rfftfreq(len(left), pull.step)
    near = (frequency > 0.5 * pull.frequency) & (frequency < 2 * pull.frequency)
    return max(math.sqrt(max(float(np.mean(left**2)), float(np.mean(power[near])))), 1e-9)
