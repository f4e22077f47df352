"""A body from the markers of all trials of a person: scale factors and marker offsets together with all postures.

    minimise  Σ_trials κ Σ_frames [Σ_m |p_m(q, θ) − x_m|² / σ_m² + Σ_k (q_k − v_k)² / s_k²] + prior(θ)     over q, θ
    so that   g(q, θ) = 0,   θ = (ln factors, offsets of the markers in their bodies, v the girdle's mean posture)

κ is the number of effective frames over that of frames. The postures are eliminated (variable projection; Golub and
Pereyra 2003, Inverse Problems 19:R1): for given θ they are the optimum of inverse kinematics, and θ takes Gauss–Newton
steps on what remains,

    (dq, λ) = −K⁻¹ (JᵀW T − S V, G_θ) dθ,   K = (JᵀWJ + S, Gᵀ; G, 0),   reduced T′ = T + J dq/dθ

where T, G_θ, V are the derivatives of markers, constraints and v by θ at fixed postures. The inverse of the reduced
normal matrix is the covariance of θ.

The number of effective frames counts independent observations. Skin and model errors follow the posture, so frames of
similar posture repeat the same error: a hundred frames of one pose are one observation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from solver.errors import SolverCode
from solver.inverse_kinematics.solve import InverseKinematics, TrackingTasks, solve_inverse_kinematics
from solver.model import Array, Marker, Model, ModelError
from solver.personalisation.anthropometry import BodyPriors, body_factors, population_priors
from solver.personalisation.normal_equations import Share, linearise_postures, normal_equations
from solver.scaling import Scaling, scale_model, scale_skeleton

MOST_FRAMES = 60
"""Of a trial that enter the normal equations; its postures are solved in all frames."""
MOST_STEPS = 40
TOLERANCE, LOOSE_TOLERANCE = 1e-3, 0.05
"""Of a step, in standard deviations of the parameter; the loose one where no step lowers the cost any more, because
inverse kinematics of a frame ends in another optimum.
"""
MOST_HALVINGS = 6
TURN = 2.0 * np.pi
LEAST_ARM = 1e-9  # m/rad; of a marker about the axis of a coordinate that moves it
LARGEST_GAP = 1e-6  # m or rad; of the constraints, in a frame that counts


class EstimateOutcome(StrEnum):
    """Outcome of the iteration."""

    CONVERGED = "converged"
    NOT_CONVERGED = "not_converged"


@dataclass(frozen=True, eq=False)
class BodyEstimate:
    """A person's body, with its uncertainty and the postures in which the markers were seen.

    model         scaled, with the tracked markers at their estimated places; masses as scaling leaves them
    priors        that were used
    factors       (factors,) scale factors in the order of priors.factors;  factor_errors (factors,) standard errors
    offsets       (markers, 3) [m] in the markers' bodies, from where the scaled model has them;  offset_errors alike
    girdle        (girdle,) [rad] mean posture, from the default, of the coordinates of priors.girdle;  girdle_errors
    parameters    (parameters,) θ: logarithms of the factors, offsets, girdle;  covariance of θ
    tasks         markers, weights and coordinate weights: the problem of inverse kinematics that belongs to this body
    postures      of every frame of every trial
    effective     (trials,) effective frames
    """

    model: Model
    priors: BodyPriors
    factors: Array
    factor_errors: Array
    offsets: Array
    offset_errors: Array
    girdle: Array
    girdle_errors: Array
    parameters: Array
    covariance: Array
    tasks: TrackingTasks
    postures: tuple[InverseKinematics, ...]
    effective: Array
    outcome: EstimateOutcome
    steps: int


def estimate_body(model: Model, markers: Sequence[Marker], trials: Sequence[Array]) -> BodyEstimate:
    """The most probable body. trials: observed (frames, markers, 3) [m] in ground, NaN where a marker is hidden.

    Raises ModelError for shapes that do not fit, and for a trial of which no frame can be solved.
    """
    priors = population_priors(model, markers)
    for observed in trials:
        if observed.ndim != 3 or observed.shape[1:] != (len(markers), 3):
            raise ModelError(
                f"expected trials of shape (frames, {len(markers)}, 3) and found {observed.shape}",
                SolverCode.WRONG_SHAPE,
            )
    typical = float(np.median(priors.errors.scatter))
    effective = np.array([effective_frames(observed, typical) for observed in trials])
    problem = _Problem(model, tuple(markers), tuple(trials), priors, effective)
    state = problem.solve(np.zeros(problem.parameters))
    outcome = EstimateOutcome.NOT_CONVERGED
    covariance = np.zeros((0, 0))
    for steps in range(1, MOST_STEPS + 1):  # noqa: B007  (counts what was taken)
        matrix, gradient = problem.normal_equations(state)
        covariance = np.asarray(np.linalg.inv(matrix), dtype=np.float64)
        step = -covariance @ gradient
        longest = float(np.abs(step / np.sqrt(np.diag(covariance))).max())
        before, state = state, _searched(problem, state, step)
        if longest < TOLERANCE or (state is before and longest < LOOSE_TOLERANCE):
            outcome = EstimateOutcome.CONVERGED
        if outcome is EstimateOutcome.CONVERGED or state is before:
            break
    return _estimate(problem, state, covariance, outcome, steps)


def body_from_parameters(
    model: Model, markers: Sequence[Marker], priors: BodyPriors, parameters: Array
) -> tuple[Model, TrackingTasks]:
    """The body of parameters θ: its skeleton, and the tasks of inverse kinematics with markers at their places."""
    factors, offsets, girdle = _split(priors, parameters)
    by_body = body_factors(priors.factors, factors)
    one = np.ones(3)
    moved = tuple(
        replace(marker, location=marker.location * by_body.get(model.bodies[marker.body].name, one) + offset)
        for marker, offset in zip(markers, offsets, strict=True)
    )
    weights = priors.errors.scatter**-2
    pulls = {name: deviation**-2 / weights.sum() for name, deviation in priors.girdle.items()}
    defaults = model.default_coordinates
    targets = {
        name: float(defaults[model.coordinate_index(name)] + shift)
        for name, shift in zip(priors.girdle, girdle, strict=True)
    }
    return scale_skeleton(model, Scaling(by_body)), TrackingTasks(moved, weights, pulls, targets)


def prior_precision(priors: BodyPriors, offset: Array | None = None) -> Array:
    """Inverse covariance (parameters, parameters) of the prior of θ, with the standard deviations of the offsets
    (markers,) [m] of priors unless others are given.
    """
    number = len(priors.factors)
    offsets = np.repeat((priors.errors.offset if offset is None else offset) ** -2.0, 3)
    girdle = np.full(len(priors.girdle), priors.person**-2.0)
    precision = np.diag(np.concatenate([np.zeros(number), offsets, girdle]))
    precision[:number, :number] = np.linalg.inv(priors.covariance)
    return precision


def _split(priors: BodyPriors, parameters: Array) -> tuple[Array, Array, Array]:
    """Scale factors (factors,), offsets (markers, 3), and the girdle's mean posture from the default (girdle,)."""
    factors, offsets, girdle = np.split(parameters, [len(priors.factors), len(parameters) - len(priors.girdle)])
    return np.exp(factors), offsets.reshape(-1, 3), girdle


@dataclass(frozen=True, eq=False)
class _State:
    """Postures and cost of parameters θ; skeleton and tasks are the body that θ makes."""

    parameters: Array
    skeleton: Model
    tasks: TrackingTasks
    solutions: tuple[InverseKinematics, ...]
    cost: float


@dataclass(frozen=True, eq=False)
class _Problem:
    model: Model
    markers: tuple[Marker, ...]
    trials: tuple[Array, ...]
    priors: BodyPriors
    effective: Array

    def body(self, parameters: Array) -> tuple[Model, TrackingTasks]:
        """The skeleton, and the tasks of inverse kinematics with markers at their places."""
        return body_from_parameters(self.model, self.markers, self.priors, parameters)

    @property
    def parameters(self) -> int:
        return len(self.priors.factors) + 3 * len(self.markers) + len(self.priors.girdle)

    def solve(self, parameters: Array, before: _State | None = None) -> _State:
        skeleton, tasks = self.body(parameters)
        starts = [None] * len(self.trials) if before is None else [s.coordinates[0].copy() for s in before.solutions]
        solutions = []
        for observed, start in zip(self.trials, starts, strict=True):
            known = start if start is not None and np.isfinite(start).all() else None
            solutions.append(solve_inverse_kinematics(skeleton, observed, tasks, known))
        cost = 0.5 * float(parameters @ prior_precision(self.priors) @ parameters)
        for observed, solution, share in zip(self.trials, solutions, self.shares(solutions), strict=True):
            is_seen = np.isfinite(observed[share.frames]).all(axis=2)
            seen = is_seen @ tasks.weights  # inverse kinematics divides by them
            cost += share.weight * float(solution.cost[share.frames] @ seen)
        return _State(parameters, skeleton, tasks, tuple(solutions), cost)

    def shares(self, solutions: Sequence[InverseKinematics]) -> list[Share]:
        """Of each trial, the frames that count, and the weight κ of each: all whose constraints are met, so that none
        comes and goes between steps.
        """
        shares: list[Share] = []
        for solution, effective in zip(solutions, self.effective, strict=True):
            solved = np.flatnonzero(solution.gap < LARGEST_GAP)
            if not len(solved):
                raise ModelError(
                    f"no frame of trial {len(shares) + 1} can be solved: its markers do not fit the model "
                    f"{self.model.name}; check labels and units",
                    SolverCode.MARKERS_DO_NOT_FIT,
                )
            chosen = solved[np.linspace(0, len(solved) - 1, min(len(solved), MOST_FRAMES)).astype(int)]
            shares.append(Share(chosen, float(effective) / len(chosen)))
        return shares

    def normal_equations(self, state: _State) -> tuple[Array, Array]:
        """Of all trials and the prior: matrix (parameters, parameters) and gradient (parameters,)."""
        shares = self.shares(state.solutions)
        observed = [trial[share.frames] for trial, share in zip(self.trials, shares, strict=True)]
        coordinates = [one.coordinates[share.frames] for one, share in zip(state.solutions, shares, strict=True)]
        matrix, gradient = normal_equations(
            self.body,
            state.parameters,
            np.concatenate(observed),
            np.concatenate(coordinates),
            np.repeat([share.weight for share in shares], [len(share.frames) for share in shares]),
            len(self.priors.factors),
        )
        precision = prior_precision(self.priors)
        return matrix + precision, gradient + precision @ state.parameters


def _searched(problem: _Problem, state: _State, step: Array) -> _State:
    """A step that lowers the cost, halved where needed; the state itself where none does."""
    part = 1.0
    for _ in range(MOST_HALVINGS):
        found = problem.solve(state.parameters + part * step, state)
        if found.cost < state.cost:
            return found
        part *= 0.5
    return state


def _estimate(
    problem: _Problem, state: _State, covariance: Array, outcome: EstimateOutcome, steps: int
) -> BodyEstimate:
    factors, offsets, girdle = _split(problem.priors, state.parameters)
    factor_errors, offset_errors, girdle_errors = _split(problem.priors, np.sqrt(np.diag(covariance)))
    scaled = scale_model(problem.model, Scaling(body_factors(problem.priors.factors, factors)))
    places = {marker.name: marker for marker in state.tasks.markers}
    return BodyEstimate(
        replace(scaled, markers=tuple(places.get(marker.name, marker) for marker in scaled.markers)),
        problem.priors,
        factors,
        factors * np.log(factor_errors),
        offsets,
        offset_errors,
        girdle,
        girdle_errors,
        state.parameters,
        covariance,
        state.tasks,
        state.solutions,
        problem.effective,
        outcome,
        steps,
    )


def effective_frames(observed: Array, scatter: float) -> float:
    """Of observed (frames, markers, 3) [m], NaN where hidden; scatter [m] of a marker along each axis.

    n / (1 + 2 Σ ρ) with the autocorrelation ρ of the markers' motion up to its first zero, as far as the motion (its
    variance γ) exceeds the scatter: 1 + (n / (1 + 2 Σ ρ) − 1) γ / (γ + scatter²). So a static pose counts once.
    """
    flat = observed.reshape(len(observed), -1)
    flat = flat[:, np.isfinite(flat).any(axis=0)]
    if flat.size == 0 or len(flat) < 2:
        return 1.0
    centred = flat - np.nanmean(flat, axis=0)
    centred = np.where(np.isfinite(centred), centred, 0.0)
    variance = float((centred**2).mean())
    if variance == 0.0:
        return 1.0
    spectrum = np.fft.rfft(centred, 2 * len(centred), axis=0)
    correlation = np.fft.irfft((np.abs(spectrum) ** 2).sum(axis=1))[: len(centred)]
    correlation = correlation / correlation[0]
    is_negative = correlation <= 0.0
    end = int(np.argmax(is_negative)) if is_negative.any() else len(correlation)
    independent = len(centred) / (1.0 + 2.0 * float(correlation[1:end].sum()))
    return 1.0 + max(independent - 1.0, 0.0) * variance / (variance + scatter**2)


def angle_ranges(model: Model) -> dict[str, tuple[float, float]]:
    """Range [rad] of an angle by its name, where it is neither a single value nor a turn and more."""
    angles = [one for one in model.coordinates if one.motion == "rotation"]
    return {one.name: one.range for one in angles if 0.0 < np.ptp(one.range) < TURN}


def within_ranges(model: Model, tasks: TrackingTasks) -> tuple[Model, TrackingTasks]:
    """The problem of inverse kinematics with the joint ranges: as limits, and as a normal prior with the mean and the
    variance of a uniform distribution on the range. Without it, the angles of a hanging arm may be those of nearly
    the same posture with a negative elevation and the plane of elevation turned by half a turn.

    Angles whose range is empty or a turn and more, with a task of their own, or that no marker moves, have no such
    prior. Raises ModelError where no marker has a weight.
    """
    if not tasks.weights.any():
        sentence = "all markers have the weight 0, and none of them determines the posture; give one a positive weight"
        raise ModelError(sentence, SolverCode.WRONG_OPTION)
    ranges = angle_ranges(model)
    clamped = tuple(replace(one, is_clamped=one.is_clamped or one.name in ranges) for one in model.coordinates)
    jacobian = linearise_postures(model, tasks, model.default_coordinates[None]).jacobian
    is_moved = np.asarray((np.abs(jacobian) > LEAST_ARM).any(axis=(0, 1, 2)))
    weights, targets = dict(tasks.coordinate_weights), dict(tasks.coordinate_targets)
    for name, (lowest, highest) in ranges.items():
        if is_moved[model.coordinate_index(name)] and name not in weights:
            weights[name] = 12.0 / (highest - lowest) ** 2 / float(tasks.weights.sum())
            targets[name] = 0.5 * (lowest + highest)
    return replace(model, coordinates=clamped), replace(tasks, coordinate_weights=weights, coordinate_targets=targets)
