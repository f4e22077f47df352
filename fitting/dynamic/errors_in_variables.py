"""Spline errors-in-variables maximum likelihood for F(t + τ) = k x + c ẋ + m ẍ + F0 + F1 u, x observed with noise.

The true motion is a B-spline with coefficients θ; θ and p = (k, c, F0, F1, τ) are estimated together, so no noisy
signal is differentiated. B, Ḃ, B̈ are the design matrices of the spline at the force samples, G = k B + c Ḃ + m B̈, and
Bx is the design matrix at the frames. Gauss-Newton alternates

    θ from N θ = Bxᵀ x / s_x² + Gᵀ (F − F0 − F1 u) / s_F²      N = Bxᵀ Bx / s_x² + Gᵀ G / s_F²
    p from S δp = Jᵀ r / s_F² + prior                          S = JᵀJ / s_F² − JᵀG N⁻¹ GᵀJ / s_F⁴ + prior

S⁻¹ is the covariance of p, and the Cramér-Rao bound of the same model. The data are a swing, cut out of a pull.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from fitting.errors import UnusableTrial
from fitting.pull.pull import Pull
from fitting.results.codes import NEGLIGIBLE, FitOutcome
from fitting.results.trial_codes import RejectionCode
from fitting.spline import Spline, linear_combination, regularised, solve_banded
from fitting.trial.bounce import Oscillation
from fitting.uncertainty import Estimate
from solver.cuff import KelvinVoigt

KNOT_STEP = 0.08
OUTLIER = 5.0
MAX_LAG_SD = 4.0
"""Standard deviations of the lag by which the spline extends beyond the samples."""

MAX_ROUNDS, MAX_NOISE_ROUNDS = 20, 20
"""Rounds of Gauss-Newton for given noise, and rounds of the noise."""
NOISE_TOLERANCE = 2e-3
"""Relative change of both noises in the last round."""
TOLERANCE, LAG_TOLERANCE = 1e-7, 1e-8
"""Relative change of k and c, and change of the lag [s], at which the rounds end."""
MIN_MARKER_NOISE, MIN_FORCE_NOISE = 1e-7, 1e-4
"""Smallest noise [m], [N], which avoids a division by zero for noise-free data."""

K, C, F0, F1, TAU = range(5)


@dataclass(frozen=True)
class SwingFit:
    """parameters (5,): k [N/m], c [N s/m], F0 [N], F1 [N], τ [s], and their (5, 5) covariance.

    known_lag_sd   (2,) standard errors of k and c for a known lag
    marker_noise, force_noise  estimated standard deviation per sample [m], [N]
    x, velocity, damper_force  (n,) at the force samples: the fitted motion, and F − k x − m ẍ − F0 − F1 u over it
    force_residual, marker_residual  (n,) [N], (frames,) [m]: measured minus fitted; NaN for outliers
    outcome        of the rounds of the noise, and of the last Gauss-Newton iteration
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


def estimate(swing: Swing) -> SwingFit:
    """Maximum likelihood estimate. Both noises are estimated from the residuals, and outliers are left out.

    Raises UnusableTrial if the motion of the cuff does not determine the parameters.
    """
    try:
        return _estimate(swing)
    except np.linalg.LinAlgError as error:
        raise UnusableTrial(RejectionCode.INDISTINCT) from error


def _estimate(swing: Swing) -> SwingFit:
    margin = MAX_LAG_SD * swing.lag_sd
    ends = np.concatenate((swing.force_time[[0, -1]], swing.marker_time[[0, -1]]))
    spline = Spline(float(ends.min() - margin), float(ends.max() + margin), KNOT_STEP)
    noise = _roughness(swing.displacement), _roughness(swing.force)
    seen = np.ones(len(swing.displacement), bool)
    parameters, outcome = _start(swing, spline), FitOutcome.NOT_CONVERGED
    for _ in range(MAX_NOISE_ROUNDS):
        step = _converge(swing, spline, seen, noise, parameters)
        parameters, before, noise = step.parameters, noise, step.updated_noise(seen)
        seen = np.abs(step.marker_residual) < OUTLIER * noise[0]
        if np.allclose(before, noise, rtol=NOISE_TOLERANCE):
            outcome = step.outcome
            break
    return replace(_solution(step, seen), outcome=outcome)


@dataclass(frozen=True)
class _Step:
    """One round of Gauss-Newton: parameters, residuals and information matrix."""

    parameters: NDArray[np.float64]
    theta: NDArray[np.float64]
    noise: tuple[float, float]
    marker_residual: NDArray[np.float64]
    force_residual: NDArray[np.float64]
    normal: scipy.sparse.csr_array
    normal_of_force: scipy.sparse.csr_array
    jacobian: NDArray[np.float64]
    information: NDArray[np.float64]
    gradient: NDArray[np.float64]
    outcome: FitOutcome = FitOutcome.NOT_CONVERGED

    def updated_noise(self, seen: NDArray[np.bool_]) -> tuple[float, float]:
        """Standard deviations (marker, force) of the residuals; θ uses degrees of freedom of both by leverage."""
        used_by_force = float(np.trace(solve_banded(self.normal, self.normal_of_force.toarray())))
        used_by_markers = len(self.theta) - used_by_force
        markers, force = self.marker_residual[seen], self.force_residual
        s_x = np.sqrt(markers @ markers / max(len(markers) - used_by_markers, 1.0))
        s_f = np.sqrt(force @ force / max(len(force) - used_by_force - 4, 1.0))
        return max(float(s_x), MIN_MARKER_NOISE), max(float(s_f), MIN_FORCE_NOISE)


def _converge(
    swing: Swing, spline: Spline, seen: NDArray[np.bool_], noise: tuple[float, float], parameters: NDArray[np.float64]
) -> _Step:
    """Gauss-Newton with given noise until the parameters have converged."""
    markers = spline.design(swing.marker_time)[0]
    design = spline.design(swing.force_time + parameters[TAU])
    for _ in range(MAX_ROUNDS):
        step = _linearise(swing, markers, design, seen, noise, parameters)
        change = np.asarray(np.linalg.solve(step.information, step.gradient), dtype=np.float64)
        parameters = parameters + change
        is_converged = (
            np.all(np.abs(change[:2]) < TOLERANCE * np.abs(parameters[:2])) and abs(change[TAU]) < LAG_TOLERANCE
        )
        if is_converged:
            break
        if change[TAU]:
            design = spline.design(swing.force_time + parameters[TAU])
    if is_converged or _is_negligible(change, step.information):
        return replace(step, outcome=FitOutcome.CONVERGED)
    return step


def _is_negligible(change: NDArray[np.float64], information: NDArray[np.float64]) -> bool:
    """Whether k, c and the lag change by a negligible part of their standard errors."""
    variance = np.diag(np.linalg.inv(information))
    return bool(np.all((change**2 <= NEGLIGIBLE**2 * variance)[[K, C, TAU]]))


def _linearise(
    swing: Swing,
    markers: scipy.sparse.csr_array,
    design: tuple[scipy.sparse.csr_array, ...],
    seen: NDArray[np.bool_],
    noise: tuple[float, float],
    parameters: NDArray[np.float64],
) -> _Step:
    position, velocity, acceleration, _ = design
    k, c, f0, f1, tau = parameters
    s_x, s_f = noise
    u = _ramp(swing)
    G = linear_combination((k, c, swing.mass), (position, velocity, acceleration))
    normal_of_force = scipy.sparse.csr_array(scipy.sparse.csr_array(G.T @ G) / s_f**2)
    seen_markers = scipy.sparse.csr_array(markers[seen])
    normal = regularised(
        scipy.sparse.csr_array(normal_of_force + scipy.sparse.csr_array(seen_markers.T @ seen_markers) / s_x**2)
    )
    load = swing.force - f0 - f1 * u
    theta = solve_banded(normal, seen_markers.T @ swing.displacement[seen] / s_x**2 + G.T @ load / s_f**2)
    x, v, a, j = (np.asarray(derivative @ theta) for derivative in design)
    law = KelvinVoigt(k, c)
    residual = load - law.force(x, v) - swing.mass * a
    with_lag = law.force(v, a) + swing.mass * j
    jacobian = np.column_stack((x, v, np.ones(len(u)), u, with_lag))
    shared = np.asarray(G.T @ jacobian) / s_f**2
    information = jacobian.T @ jacobian / s_f**2 - shared.T @ solve_banded(normal, shared)
    gradient = jacobian.T @ residual / s_f**2
    if swing.lag_sd > 0:
        information[TAU, TAU] += swing.lag_sd**-2
        gradient[TAU] -= tau * swing.lag_sd**-2
    else:
        information[TAU], information[:, TAU], information[TAU, TAU], gradient[TAU] = 0.0, 0.0, 1.0, 0.0
    marker_residual = swing.displacement - markers @ theta
    return _Step(
        parameters, theta, noise, marker_residual, residual, normal, normal_of_force, jacobian, information, gradient
    )


def _solution(step: _Step, seen: NDArray[np.bool_]) -> SwingFit:
    covariance = np.asarray(np.linalg.inv(step.information), dtype=np.float64)
    known_lag = np.linalg.inv(step.information[:TAU, :TAU])
    variances = np.concatenate((np.diag(covariance), np.diag(known_lag)))
    if not (np.isfinite(variances).all() and variances.min() > 0):
        raise UnusableTrial(RejectionCode.INDISTINCT)
    x, velocity = step.jacobian[:, K], step.jacobian[:, C]
    return SwingFit(
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


def _start(swing: Swing, spline: Spline) -> NDArray[np.float64]:
    """Start for Gauss-Newton: least squares of the force on a spline fitted to the markers alone."""
    markers = spline.design(swing.marker_time)[0]
    theta = solve_banded(regularised(scipy.sparse.csr_array(markers.T @ markers)), markers.T @ swing.displacement)
    position, velocity, _, _ = spline.design(swing.force_time)
    columns = np.column_stack((position @ theta, velocity @ theta, np.ones(len(swing.force)), _ramp(swing)))
    after = np.clip(np.searchsorted(swing.marker_time, swing.force_time), 1, len(swing.marker_time) - 1)
    known = np.diff(swing.marker_time)[after - 1] < KNOT_STEP  # the spline is undefined in gaps of the markers
    k, c, f0, f1 = np.linalg.lstsq(columns[known], swing.force[known], rcond=None)[0]
    return np.array([k, abs(c), f0, f1, 0.0])  # a wide lag prior allows both signs of c; a cuff dissipates energy


def _ramp(swing: Swing) -> NDArray[np.float64]:
    """u (n,): time scaled to −1 … 1 over the record."""
    time = swing.force_time
    return np.asarray((2 * time - time[0] - time[-1]) / (time[-1] - time[0]))


def _roughness(values: NDArray[np.float64]) -> float:
    """Noise per sample from second differences: a first guess, too large if the motion is not smooth."""
    return max(float(np.std(np.diff(values, 2)) / np.sqrt(6)), MIN_MARKER_NOISE)


LAG_RANGE, LAG_STEPS = 4.0, 801
"""Range of the grid of lags in prior standard deviations, and its number of points."""


@dataclass(frozen=True)
class LagPosterior:
    """Mean [s] and standard deviation [s] of the lag, and standard deviation of the damping [N s/m]."""

    lag: float
    lag_sd: float
    damping_sd: float


def lag_from_magnitude(
    solution: SwingFit, mass: float, frequency: float, known: Estimate, lag_sd: float
) -> LagPosterior:
    """The lag from the magnitude of the complex stiffness at `frequency` [Hz] and a known stiffness [N/m].

    The prior of the lag is 0 ± lag_sd [s]. A lag that makes c negative is excluded: a cuff dissipates energy.
    """
    omega = 2 * math.pi * frequency
    k, c, found = (float(solution.parameters[index]) for index in (K, C, TAU))
    lags = np.linspace(-LAG_RANGE, LAG_RANGE, LAG_STEPS) * lag_sd
    rotated = complex(k - mass * omega**2, omega * c) * np.exp(1j * omega * (found - lags))
    stiffness, damping = rotated.real + mass * omega**2, rotated.imag / omega
    error = math.hypot(known.standard_error, float(solution.known_lag_sd[0]))
    cost = ((stiffness - known.value) / error) ** 2 + (lags / lag_sd) ** 2
    cost[damping < 0] = np.inf
    weight = np.exp(-0.5 * (cost - cost.min())) if np.isfinite(cost).any() else np.ones(LAG_STEPS)
    weight /= weight.sum()
    lag, mean = float(weight @ lags), float(weight @ damping)
    return LagPosterior(
        lag, math.sqrt(float(weight @ (lags - lag) ** 2)), math.sqrt(float(weight @ (damping - mean) ** 2))
    )


FIT_RATE = 250.0
"""Rate [Hz] to which force is averaged. This attenuates a swing of 3 Hz by 0.005 % and makes the fit 4 times faster."""


@dataclass(frozen=True)
class Swing:
    """force (n,) [N] at force_time [s], displacement (frames,) [m] at marker_time [s], finite; mass [kg] of the cuff.

    lag_sd is the prior standard deviation [s] of the lag in a fit; 0: the lag is known.
    """

    force_time: NDArray[np.float64]
    force: NDArray[np.float64]
    marker_time: NDArray[np.float64]
    displacement: NDArray[np.float64]
    mass: float
    lag_sd: float

    def delayed(self, lag: float) -> Swing:
        """The swing with every force sample `lag` [s] later."""
        return replace(self, force_time=self.force_time + lag)


def cut_swing(pull: Pull, oscillation: Oscillation, lag_sd: float) -> Swing:
    """The visible frames of the oscillation, and the force averaged to FIT_RATE. Raises UnusableTrial."""
    in_force = (pull.force_time >= oscillation.start) & (pull.force_time <= oscillation.end)
    seen = (pull.marker_time >= oscillation.start) & (pull.marker_time <= oscillation.end)
    seen &= np.isfinite(pull.displacement)
    expected = (oscillation.end - oscillation.start) / float(np.median(np.diff(pull.marker_time)))
    if np.count_nonzero(seen) < 0.5 * expected:
        raise UnusableTrial(RejectionCode.SWING_HIDDEN)
    time, force = _averaged(pull.force_time[in_force], pull.force[in_force])
    return Swing(time, force, pull.marker_time[seen], pull.displacement[seen], pull.trial.cuff_mass, lag_sd)


def _averaged(time: NDArray[np.float64], force: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Block means with a rate of at least FIT_RATE."""
    per_block = max(1, int(1 / float(np.median(np.diff(time))) / FIT_RATE + 1e-6))
    whole = len(time) // per_block * per_block
    return time[:whole].reshape(-1, per_block).mean(axis=1), force[:whole].reshape(-1, per_block).mean(axis=1)
