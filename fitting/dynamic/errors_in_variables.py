"""Spline errors-in-variables maximum likelihood for F(t + τ) = k x + c ẋ + m ẍ + F0 + F1 u, x seen with noise.

The true motion is a B-spline with coefficients θ; θ and p = (k, c, F0, F1, τ) are estimated at once, so nothing is
differentiated that carries noise. With B, Ḃ, B̈ the spline's design at the force samples, G = k B + c Ḃ + m B̈ and
Bx its design at the frames, Gauss-Newton alternates

    θ from N θ = Bxᵀ x / s_x² + Gᵀ (F − F0 − F1 u) / s_F²      N = Bxᵀ Bx / s_x² + Gᵀ G / s_F²
    p from S δp = Jᵀ r / s_F² + prior                          S = JᵀJ / s_F² − JᵀG N⁻¹ GᵀJ / s_F⁴ + prior

S⁻¹ is the covariance of p, and the Cramér-Rao bound of the same model.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from fitting.outcome import NEGLIGIBLE, FitOutcome
from fitting.quality import UnusableTrial
from fitting.spline import Spline, combined, grounded, solve_banded
from solver.cuff import cuff_force

KNOT_STEP = 0.08
OUTLIER = 5.0
MAX_LAG_SD = 4.0
"""The spline reaches beyond the samples by so many standard deviations of the lag."""

MAX_ROUNDS, MAX_NOISE_ROUNDS = 20, 20
"""Of Gauss-Newton with the noise as given, and of the noise."""
NOISE_TOLERANCE = 2e-3
"""Relative change of both noises in the last round."""
TOLERANCE, LAG_TOLERANCE = 1e-7, 1e-8
"""Relative change of k and c, and change of the lag [s], at which the rounds end."""
MIN_MARKER_NOISE, MIN_FORCE_NOISE = 1e-7, 1e-4
"""Noise [m], [N] below which a perfect simulation would divide by zero."""

NOT_TOLD = (
    "the cuff does not move as the force does, so nothing tells its stiffness from its damping; check that the cuff's "
    "markers are on the cuff, and record again"
)

K, C, F0, F1, TAU = range(5)


@dataclass(frozen=True)
class Record:
    """force (n,) [N] at force_time [s], displacement (frames,) [m] at marker_time [s], finite; mass m [kg].

    lag_sd is s_τ [s].
    """

    force_time: NDArray[np.float64]
    force: NDArray[np.float64]
    marker_time: NDArray[np.float64]
    displacement: NDArray[np.float64]
    mass: float
    lag_sd: float


@dataclass(frozen=True)
class Solution:
    """parameters (5,): k [N/m], c [N s/m], F0 [N], F1 [N], τ [s], and their (5, 5) covariance.

    known_lag_sd   (2,) standard errors of k and c if the lag were known exactly
    marker_noise, force_noise  standard deviation per sample [m], [N], estimated with the rest
    x, velocity, damper_force  (n,) at the force samples: the fitted motion, and F − k x − m ẍ − F0 − F1 u over it
    force_residual, marker_residual  (n,) [N], (frames,) [m]: measured minus fitted; outlying frames are NaN
    outcome        of the rounds of the noise, and of the last ones of Gauss-Newton
    """

    parameters: NDArray[np.float64]
    covariance: NDArray[np.float64]
    known_lag_sd: NDArray[np.float64]
    marker_noise: float
    force_noise: float
    x: NDArray[np.float64]
    velocity: NDArray[np.float64]
    damper_force: NDArray[np.float64]
    force_residual: NDArray[np.float64]
    marker_residual: NDArray[np.float64]
    outcome: FitOutcome = FitOutcome.CONVERGED


def estimate(record: Record) -> Solution:
    """Maximum likelihood; both noises come from what the fit leaves over, and outlying frames are left out.

    Raises UnusableTrial where the cuff's motion tells no parameters.
    """
    try:
        return _estimate(record)
    except np.linalg.LinAlgError as error:
        raise UnusableTrial(NOT_TOLD) from error


def _estimate(record: Record) -> Solution:
    reach = MAX_LAG_SD * record.lag_sd
    ends = np.concatenate((record.force_time[[0, -1]], record.marker_time[[0, -1]]))
    spline = Spline(float(ends.min() - reach), float(ends.max() + reach), KNOT_STEP)
    noise = _roughness(record.displacement), _roughness(record.force)
    seen = np.ones(len(record.displacement), bool)
    parameters, outcome = _start(record, spline), FitOutcome.NOT_CONVERGED
    for _ in range(MAX_NOISE_ROUNDS):
        step = _converge(record, spline, seen, noise, parameters)
        parameters, before, noise = step.parameters, noise, step.updated_noise(seen)
        seen = np.abs(step.marker_residual) < OUTLIER * noise[0]
        if np.allclose(before, noise, rtol=NOISE_TOLERANCE):
            outcome = step.outcome
            break
    return replace(_solution(step, seen), outcome=outcome)


@dataclass(frozen=True)
class _Step:
    """One round of Gauss-Newton: where it stands, what is left over, and the information there."""

    parameters: NDArray[np.float64]
    theta: NDArray[np.float64]
    noise: tuple[float, float]
    marker_residual: NDArray[np.float64]
    force_residual: NDArray[np.float64]
    normal: csr_array
    normal_of_force: csr_array
    jacobian: NDArray[np.float64]
    information: NDArray[np.float64]
    gradient: NDArray[np.float64]
    outcome: FitOutcome = FitOutcome.NOT_CONVERGED

    def updated_noise(self, seen: NDArray[np.bool_]) -> tuple[float, float]:
        """Standard deviations (marker, force) of the residuals; θ's degrees of freedom shared as the data share θ."""
        used_by_force = float(np.trace(solve_banded(self.normal, self.normal_of_force.toarray())))
        used_by_markers = len(self.theta) - used_by_force
        markers, force = self.marker_residual[seen], self.force_residual
        s_x = np.sqrt(markers @ markers / max(len(markers) - used_by_markers, 1.0))
        s_f = np.sqrt(force @ force / max(len(force) - used_by_force - 4, 1.0))
        return max(float(s_x), MIN_MARKER_NOISE), max(float(s_f), MIN_FORCE_NOISE)


def _converge(
    record: Record,
    spline: Spline,
    seen: NDArray[np.bool_],
    noise: tuple[float, float],
    parameters: NDArray[np.float64],
) -> _Step:
    """Gauss-Newton until the parameters rest, with the noise as given."""
    markers = spline.design(record.marker_time)[0]
    design = spline.design(record.force_time + parameters[TAU])
    for _ in range(MAX_ROUNDS):
        step = _linearise(record, markers, design, seen, noise, parameters)
        change = np.asarray(np.linalg.solve(step.information, step.gradient), dtype=np.float64)
        parameters = parameters + change
        rests = np.all(np.abs(change[:2]) < TOLERANCE * np.abs(parameters[:2])) and abs(change[TAU]) < LAG_TOLERANCE
        if rests:
            break
        if change[TAU]:
            design = spline.design(record.force_time + parameters[TAU])
    if rests or _is_negligible(change, step.information):
        return replace(step, outcome=FitOutcome.CONVERGED)
    return step


def _is_negligible(change: NDArray[np.float64], information: NDArray[np.float64]) -> bool:
    """Whether k, c and the lag change by a negligible part of their standard errors."""
    variance = np.diag(np.linalg.inv(information))
    return bool(np.all((change**2 <= NEGLIGIBLE**2 * variance)[[K, C, TAU]]))


def _linearise(
    record: Record,
    markers: csr_array,
    design: tuple[csr_array, ...],
    seen: NDArray[np.bool_],
    noise: tuple[float, float],
    parameters: NDArray[np.float64],
) -> _Step:
    position, velocity, acceleration, _ = design
    k, c, f0, f1, tau = parameters
    s_x, s_f = noise
    u = _ramp(record)
    G = combined((k, c, record.mass), (position, velocity, acceleration))
    normal_of_force = csr_array(csr_array(G.T @ G) / s_f**2)
    seen_markers = csr_array(markers[seen])
    normal = grounded(csr_array(normal_of_force + csr_array(seen_markers.T @ seen_markers) / s_x**2))
    load = record.force - f0 - f1 * u
    theta = solve_banded(normal, seen_markers.T @ record.displacement[seen] / s_x**2 + G.T @ load / s_f**2)
    x, v, a, j = (np.asarray(each @ theta) for each in design)
    residual = load - cuff_force(k, c, x, v) - record.mass * a
    with_lag = cuff_force(k, c, v, a) + record.mass * j
    jacobian = np.column_stack((x, v, np.ones(len(u)), u, with_lag))
    shared = np.asarray(G.T @ jacobian) / s_f**2
    information = jacobian.T @ jacobian / s_f**2 - shared.T @ solve_banded(normal, shared)
    gradient = jacobian.T @ residual / s_f**2
    if record.lag_sd > 0:
        information[TAU, TAU] += record.lag_sd**-2
        gradient[TAU] -= tau * record.lag_sd**-2
    else:
        information[TAU], information[:, TAU], information[TAU, TAU], gradient[TAU] = 0.0, 0.0, 1.0, 0.0
    marker_residual = record.displacement - markers @ theta
    return _Step(
        parameters, theta, noise, marker_residual, residual, normal, normal_of_force, jacobian, information, gradient
    )


def _solution(step: _Step, seen: NDArray[np.bool_]) -> Solution:
    covariance = np.asarray(np.linalg.inv(step.information), dtype=np.float64)
    known_lag = np.linalg.inv(step.information[:TAU, :TAU])
    variances = np.concatenate((np.diag(covariance), np.diag(known_lag)))
    if not (np.isfinite(variances).all() and variances.min() > 0):
        raise UnusableTrial(NOT_TOLD)
    x, velocity = step.jacobian[:, K], step.jacobian[:, C]
    return Solution(
        parameters=step.parameters,
        covariance=covariance,
        known_lag_sd=np.sqrt(np.diag(known_lag)[:2]),
        marker_noise=step.noise[0],
        force_noise=step.noise[1],
        x=x,
        velocity=velocity,
        damper_force=step.force_residual + step.parameters[C] * velocity,
        force_residual=step.force_residual,
        marker_residual=np.where(seen, step.marker_residual, np.nan),
    )


def _start(record: Record, spline: Spline) -> NDArray[np.float64]:
    """Least squares of the force on the spline that follows the markers alone: near enough for Gauss-Newton."""
    markers = spline.design(record.marker_time)[0]
    theta = solve_banded(grounded(csr_array(markers.T @ markers)), markers.T @ record.displacement)
    position, velocity, _, _ = spline.design(record.force_time)
    columns = np.column_stack((position @ theta, velocity @ theta, np.ones(len(record.force)), _ramp(record)))
    after = np.clip(np.searchsorted(record.marker_time, record.force_time), 1, len(record.marker_time) - 1)
    known = np.diff(record.marker_time)[after - 1] < KNOT_STEP  # where no marker was seen the spline is nowhere
    k, c, f0, f1 = np.linalg.lstsq(columns[known], record.force[known], rcond=None)[0]
    return np.array([k, abs(c), f0, f1, 0.0])  # a wide lag prior allows c of either sign; a cuff takes energy


def _ramp(record: Record) -> NDArray[np.float64]:
    """u (n,): time from the middle of the record in halves of its length, −1 … 1."""
    time = record.force_time
    return np.asarray((2 * time - time[0] - time[-1]) / (time[-1] - time[0]))


def _roughness(values: NDArray[np.float64]) -> float:
    """Noise per sample from second differences; a first guess, too large where the motion itself is rough."""
    return max(float(np.std(np.diff(values, 2)) / np.sqrt(6)), MIN_MARKER_NOISE)
