"""Smoother of a wearer's motion: the posterior of motion and body from the markers and a prior of anatomy.

    x_t = p(q_t, θ) + R_t skin_t        of a marker along each axis of its body, R_t the orientation of that body in q⁰:
                                        Gaussian process, slide² K + SKIN_NOISE² 1
    c_kᵀ q_t = target_k(θ) + girdle_t   of coordinate k of the girdle: deviation_k² K + POSTURE_NOISE² 1
    q_t within the joint ranges         normal, with mean and variance of a uniform distribution on the range, once
    q_t = q⁰_t + Φ_t w,  g(q_t, θ) = 0  q⁰ the postures of inverse kinematics

θ are sizes, places of the markers and posture of the girdle on the hanging arm, with the prior of estimate.py. c_kᵀ q
is a coordinate of clavicle or scapula less what follows the elevation of the arm (Rhythm).

Markers are put on the hanging arm r, and the model's default posture is one. From there, skin slides and the girdle
deviates, the farther the arm is raised, and the same posture has the same error, in the next cycle and in another
trial: a process with the covariance k = exp(−½ d² / ALIKE²) that is known to be 0 at r (Rasmussen and Williams 2006,
Gaussian Processes for Machine Learning, ch. 2.2 and 4.2),

    K(t, s) = (k(t, s) − k(t, r) k(r, s)) / (1 − exp(−RAISED² / ALIKE²))

where d² is the sum, over the bodies with markers, of (2 sin φ/2)², φ the angle between two orientations in the trunk. Φ
are the modes of such a kernel with RESOLVED in place of ALIKE.

The posterior is normal about its mode (Laplace's approximation, Gauss–Newton), of θ and w together.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from solver.inverse_kinematics.marker_fit import (
    RAISED,
    PostureErrors,
    orientations_in_trunk,
    posture_errors,
    trunk_and_bodies,
)
from solver.inverse_kinematics.solve import InverseKinematics, TrackingTasks
from solver.model import Array, Marker, Model
from solver.multibody.postures import postures
from solver.personalisation.anthropometry import ELEVATION, BodyPriors, body_factors
from solver.personalisation.estimate import (
    LARGEST_GAP,
    LEAST_ARM,
    BodyEstimate,
    angle_ranges,
    body_from_parameters,
    prior_precision,
)
from solver.personalisation.normal_equations import (
    LinearisedPostures,
    linearise_constraints,
    linearise_postures,
    parameter_derivatives,
)
from solver.scaling import Scaling, scale_skeleton

KNOTS = 24
"""Frames of a trial whose markers count, evenly spread over those that are solved."""
ALIKE = np.radians(100.0)
"""d at which k is 0.6. Over a raise an error is then nearly proportional to d."""
RESOLVED = np.radians(25.0)
"""Of Φ. Angles of a hanging arm change fast with its elevation, even where an error of orientation does not."""
SKIN_NOISE, POSTURE_NOISE = 0.0025, np.radians(1.5)
"""m along each axis, and rad; standard deviation of the error that does not follow the posture."""
LEAST_MODE = 1e-3  # of the largest one of Φ
GAP_SD = 1e-3  # m or rad; a basis of few modes does not close a joint exactly
LOOSE, FIXED = 1.0, 1e-6
"""rad or m; standard deviation of coordinates that only markers determine, and of those that no marker moves."""
MOST_STEPS, SETTLED = 12, 0.05
"""Of the mode; the longest step, in standard deviations, at which it is found."""
CLOSINGS = 3
"""Newton steps by which a posture meets the constraints."""


@dataclass(frozen=True, eq=False)
class WearerMotion:
    """The posterior of a motion.

    scaling       the body of its mode, as scaling of the estimated one that keeps its masses;  skeleton  of that body
    factors       (factors,) scale factors of that body in the order of the priors;  factor_errors  standard errors
    coordinates   (frames, coordinates) [rad or m] of its mode, closed on that body
    standard_deviation   (frames, coordinates); 0 of a coordinate that no marker moves
    covariance    of (θ, w);  mode  w (coordinates, modes);  parameters  θ of its mode
    is_converged  whether the mode was found
    """

    scaling: Scaling
    skeleton: Model
    factors: Array
    factor_errors: Array
    coordinates: Array
    standard_deviation: Array
    covariance: Array
    mode: Array
    is_converged: bool
    knots: _Knots
    body: _Body
    parameters: Array

    @property
    def tasks(self) -> TrackingTasks:
        """Of inverse kinematics in a motion without a posterior of its own: markers where they were put on the hanging
        arm, and the girdle following the elevation of the arm.
        """
        tasks, rhythm = self.body.of(self.parameters)[1], self.body.priors.rhythm
        if ELEVATION not in self.body.generic.coordinate_names:
            return tasks
        at_rest = float(self.body.generic.default_coordinates[self.body.generic.coordinate_index(ELEVATION)])
        targets = {
            name: float(np.asarray(value)) - rhythm[name].slope * at_rest
            for name, value in tasks.coordinate_targets.items()
        }
        slopes = {name: one.slope for name, one in rhythm.items() if one.slope}
        return replace(tasks, coordinate_targets=targets, coordinate_slopes=slopes, leader=ELEVATION)

    @property
    def errors(self) -> PostureErrors:
        """Of the postures that tasks give. The errors of places and targets are taken as independent."""
        body, girdle = self.body, len(self.body.priors.girdle)
        variances = np.diag(self.covariance)[: body.parameters]
        placed = variances[len(body.priors.factors) : body.parameters - girdle].reshape(-1, 3).mean(axis=1)
        targets = np.zeros((2, body.count))
        own = np.sqrt(variances[body.parameters - girdle :])
        for name, at_rest in zip(body.priors.girdle, own, strict=True):
            targets[:, body.generic.coordinate_index(name)] = at_rest, body.priors.rhythm[name].deviation
        placed = np.sqrt(placed + SKIN_NOISE**2)
        return posture_errors(self.skeleton, body.markers, placed, body.priors.errors.slide, targets)

    def draw(self, count: int, seed: int = 1) -> Iterator[tuple[Scaling, Array]]:
        """Bodies of the posterior, as scaling of that of the mode, and their coordinates (frames, coordinates) [rad or
        m], in their ranges.
        """
        generator = np.random.default_rng(seed)
        root = np.linalg.cholesky(self.covariance)
        for _ in range(count):
            moved = root @ generator.standard_normal(len(root))
            weights = self.mode + moved[self.body.parameters :].reshape(self.mode.shape)
            scaling = self.body.scaling(moved)
            yield scaling, self.knots.closed(scale_skeleton(self.skeleton, scaling), weights)

    def postures(self, solved: Array) -> Array:
        """(frames, coordinates) of its mode, closed on that body, from those of inverse kinematics in one of the trials
        that it was estimated from.
        """
        modes = _modes(self.body, solved, self.knots.places, self.knots.basis)
        return replace(self.knots, wanted=solved, wanted_modes=modes).closed(self.skeleton, self.mode)


def smooth_wearer(
    generic: Model,
    markers: Sequence[Marker],
    estimate: BodyEstimate,
    trials: Sequence[tuple[Array, InverseKinematics]],
    wanted: Array,
) -> WearerMotion:
    """The posterior of a motion with the coordinates wanted (frames, coordinates), which are a part of one trial.

    generic and markers are those of the estimate; trials its observed (frames, markers, 3) [m] and their
    postures within the ranges of the joints (within_ranges).
    """
    body = _Body(generic, tuple(markers), estimate)
    knots = _knots(body, trials, wanted)
    at = np.concatenate([estimate.parameters, np.zeros(body.count * knots.modes.shape[1])])
    is_converged = False
    for _ in range(MOST_STEPS):
        matrix, gradient = _normal_equations(body, knots, at)
        covariance = np.asarray(np.linalg.inv(matrix), dtype=np.float64)
        step = -covariance @ gradient
        at = at + step
        if is_converged := bool((np.abs(step) <= SETTLED * np.sqrt(np.diag(covariance))).all()):
            break
    mode, skeleton = at[body.parameters :].reshape(body.count, -1), body.of(at[: body.parameters])[0]
    factors = np.exp(at[: len(body.priors.factors)])
    return WearerMotion(
        scaling=body.scaling(at[: body.parameters] - estimate.parameters),
        skeleton=skeleton,
        factors=factors,
        factor_errors=factors * np.sqrt(np.diag(covariance)[: len(factors)]),
        coordinates=knots.closed(skeleton, mode),
        standard_deviation=knots.deviations(covariance),
        covariance=covariance,
        mode=mode,
        is_converged=is_converged,
        knots=knots,
        body=body,
        parameters=at[: body.parameters],
    )


@dataclass(frozen=True, eq=False)
class _Body:
    """The estimated body, and the prior of its postures."""

    generic: Model
    markers: tuple[Marker, ...]
    estimate: BodyEstimate

    @property
    def priors(self) -> BodyPriors:
        return self.estimate.priors

    @property
    def parameters(self) -> int:
        return len(self.estimate.parameters)

    @property
    def count(self) -> int:
        return len(self.generic.coordinates)

    @cached_property
    def skeleton(self) -> Model:
        return self.of(self.estimate.parameters)[0]

    def of(self, parameters: Array) -> tuple[Model, TrackingTasks]:
        return body_from_parameters(self.generic, self.markers, self.priors, parameters)

    def scaling(self, moved: Array) -> Scaling:
        """By the sizes among changes of θ, of which more may follow."""
        factors = self.priors.factors
        return Scaling(body_factors(factors, np.exp(moved[: len(factors)])), keeps_masses=True)

    @property
    def limits(self) -> tuple[Array, Array]:
        """(coordinates,) lowest and highest value, infinite where a coordinate is not an angle with a range."""
        ranges, free = angle_ranges(self.generic), (-np.inf, np.inf)
        lowest, highest = np.array([ranges.get(name, free) for name in self.generic.coordinate_names]).T
        return lowest, highest

    @cached_property
    def anatomy(self) -> tuple[Array, Array, Array, NDArray[np.int64]]:
        """Prior of the postures, of rows c q = target: c (rows, coordinates), standard deviations (rows,), constants of
        the targets (rows,), and the parameter that adds to a target, −1 for none.
        """
        model, priors = self.generic, self.priors
        defaults = model.default_coordinates
        rows, deviations, targets, parameter = [], [], [], []
        for place, name in enumerate(priors.girdle):
            rhythm = priors.rhythm[name]
            row = np.zeros(self.count)
            row[model.coordinate_index(name)] = 1.0
            if rhythm.slope:
                row[model.coordinate_index(ELEVATION)] = -rhythm.slope
            rows.append(row)
            deviations.append(rhythm.deviation)
            targets.append(float(row @ defaults))
            parameter.append(self.parameters - len(priors.girdle) + place)
        for name, (lowest, highest) in angle_ranges(model).items():
            rows.append(np.eye(self.count)[model.coordinate_index(name)])
            deviations.append((highest - lowest) / np.sqrt(12.0))
            targets.append(0.5 * (lowest + highest))
            parameter.append(-1)
        return np.array(rows), np.array(deviations), np.array(targets), np.array(parameter)


@dataclass(frozen=True, eq=False)
class _Knots:
    """Frames of all trials whose markers count.

    coordinates (knots, coordinates) q⁰;  observed (knots, markers, 3);  modes (knots, modes) Φ
    growing      (knots, knots) K
    turned       (knots, markers, 3, 3) from ground to the axes of the marker's body, in q⁰
    places       (knots, features) of _orientations;  basis (knots, modes) of Φ in the kernel with them
    wanted (frames, coordinates) q⁰ of the wanted motion;  wanted_modes (frames, modes);  lowest, highest (coordinates,)
    """

    coordinates: Array
    observed: Array
    modes: Array
    growing: Array
    turned: Array
    places: Array
    basis: Array
    wanted: Array
    wanted_modes: Array
    lowest: Array
    highest: Array

    def closed(self, skeleton: Model, weights: Array) -> Array:
        """The wanted coordinates with these weights (coordinates, modes), moved so that joints are closed at the knots,
        and within their ranges.
        """
        moved = self.coordinates + self.modes @ weights.T
        for _ in range(CLOSINGS):
            gap, rows = linearise_constraints(skeleton, moved)
            moved = moved - (np.linalg.pinv(rows) @ gap[..., None])[..., 0]
        away = np.linalg.lstsq(self.modes, moved - self.coordinates, rcond=None)[0]
        found: Array = np.clip(self.wanted + self.wanted_modes @ away, self.lowest, self.highest)
        return found

    def deviations(self, covariance: Array) -> Array:
        """(frames, coordinates) of the wanted motion, from the covariance of (θ, w)."""
        count, modes = self.wanted.shape[1], self.modes.shape[1]
        size = count * modes
        blocks = covariance[-size:, -size:].reshape(count, modes, count, modes)
        own = np.einsum("kikj->kij", blocks)
        variance = np.einsum("fi,kij,fj->fk", self.wanted_modes, own, self.wanted_modes)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def _knots(body: _Body, trials: Sequence[tuple[Array, InverseKinematics]], wanted: Array) -> _Knots:
    chosen = [(observed, solution, _evenly_spread(solution)) for observed, solution in trials]
    coordinates = np.concatenate([solution.coordinates[frames] for _, solution, frames in chosen])
    places = _orientations(body, coordinates)
    kernel = _alike(places, places, ALIKE)
    at_rest = kernel[:, [_resting(body, coordinates)]]
    growing = (kernel - at_rest @ at_rest.T) / (1.0 - np.exp(-((RAISED / ALIKE) ** 2)))
    narrow = _alike(places, places, RESOLVED)
    sizes, directions = np.linalg.eigh(narrow)
    kept = sizes > LEAST_MODE * sizes[-1]
    basis = directions[:, kept] / np.sqrt(sizes[kept])
    return _Knots(
        coordinates,
        np.concatenate([observed[frames] for observed, _, frames in chosen]),
        narrow @ basis,
        growing,
        _to_bodies(body, coordinates),
        places,
        basis,
        wanted,
        _modes(body, wanted, places, basis),
        *body.limits,
    )


def _modes(body: _Body, coordinates: Array, places: Array, basis: Array) -> Array:
    """(frames, modes) Φ in these postures."""
    modes: Array = _alike(_orientations(body, coordinates), places, RESOLVED) @ basis
    return modes


def _resting(body: _Body, coordinates: Array) -> int:
    """The frame with the least elevation of the arm; the first one of a model without."""
    names = body.generic.coordinate_names
    return int(np.argmin(coordinates[:, names.index(ELEVATION)])) if ELEVATION in names else 0


def _evenly_spread(solution: InverseKinematics) -> NDArray[np.int64]:
    """At most KNOTS of the solved frames."""
    solved = np.flatnonzero(solution.gap < LARGEST_GAP)
    spread: NDArray[np.int64] = solved[np.linspace(0, len(solved) - 1, min(len(solved), KNOTS)).astype(int)]
    return spread


def _to_bodies(body: _Body, coordinates: Array) -> Array:
    """(frames, markers, 3, 3) rotations from ground to the axes of the bodies of the markers."""
    state = postures(body.skeleton, coordinates, np.zeros_like(coordinates))
    return np.swapaxes(state.rotation_to_ground[:, [marker.body for marker in body.markers]], 2, 3)


def _orientations(body: _Body, coordinates: Array) -> Array:
    """(frames, features) of the bodies with markers in the trunk, whose distance is about the angle between them."""
    state = postures(body.skeleton, coordinates, np.zeros_like(coordinates))
    return orientations_in_trunk(state.rotation_to_ground, *trunk_and_bodies(body.generic, body.markers))


def _alike(one: Array, other: Array, angle: float) -> Array:
    square = ((one[:, None] - other[None]) ** 2).sum(axis=2)
    return np.asarray(np.exp(-0.5 * square / angle**2))


def _normal_equations(body: _Body, knots: _Knots, at: Array) -> tuple[Array, Array]:
    """Matrix and gradient at (θ, w)."""
    parameters = at[: body.parameters]
    coordinates = knots.coordinates + knots.modes @ at[body.parameters :].reshape(body.count, -1).T
    found = linearise_postures(*body.of(parameters), coordinates)
    points, gaps = parameter_derivatives(body.of, parameters, coordinates, len(body.priors.factors))
    own = np.zeros((len(at), len(at)))
    own[: body.parameters, : body.parameters] = prior_precision(body.priors, body.priors.errors.placement)
    deviation = np.repeat(np.where(_is_moved(found), LOOSE, FIXED), knots.modes.shape[1])
    own[body.parameters :, body.parameters :] = np.diag(deviation**-2.0)
    anatomy, slope = _squared(len(at), _anatomy_rows(body, knots, found, gaps, coordinates, parameters))
    of_markers, pull = _squared(len(at), _marker_rows(body, knots, found, points))
    return own + anatomy + of_markers, own @ at + slope + pull


def _squared(size: int, rows: Iterator[Array]) -> tuple[Array, Array]:
    """AᵀA and Aᵀr of blocks of rows (A, r) in standard deviations. A block has few columns that are not zero."""
    product = np.zeros((size + 1, size + 1))
    for block in rows:
        used = np.flatnonzero(block.any(axis=0))
        filled = block[:, used]
        product[np.ix_(used, used)] += filled.T @ filled
    return product[:-1, :-1], product[:-1, -1]


def _anatomy_rows(
    body: _Body, knots: _Knots, found: LinearisedPostures, gaps: Array, coordinates: Array, parameters: Array
) -> Iterator[Array]:
    """Of rhythm and ranges, then of the constraints."""
    count, modes = knots.modes.shape
    is_moved = _is_moved(found)
    for combined, deviation, target, parameter in zip(*body.anatomy, strict=True):
        if not is_moved[combined != 0.0].all():
            continue
        rows = np.zeros((count, body.parameters + body.count * modes + 1))
        rows[:, body.parameters : -1] = (combined[:, None] * knots.modes[:, None, :]).reshape(count, -1)
        rows[:, -1] = coordinates @ combined - target
        if parameter >= 0:
            rows[:, parameter] = -1.0
            rows[:, -1] -= parameters[parameter]
        whitener = _whitener(knots.growing, deviation, POSTURE_NOISE)
        yield whitener @ rows if parameter >= 0 else rows / (deviation * np.sqrt(count))
    along = (found.rows[..., None] * knots.modes[:, None, None]).reshape(*found.rows.shape[:2], -1)
    tight = np.concatenate([gaps, along, found.gap[..., None]], axis=2)
    yield tight.reshape(-1, tight.shape[2]) / GAP_SD


def _marker_rows(body: _Body, knots: _Knots, found: LinearisedPostures, points: Array) -> Iterator[Array]:
    """Of one marker after the other."""
    is_seen = np.asarray(np.isfinite(knots.observed).all(axis=2))
    for marker, slide in enumerate(body.priors.errors.slide):
        seen = is_seen[:, marker]
        if not seen.any():
            continue
        along = found.jacobian[seen, marker][..., None] * knots.modes[seen][:, None, None]
        residual = found.points[seen, marker] - knots.observed[seen, marker]
        rows = [points[seen, marker], along.reshape(*residual.shape, -1), residual[..., None]]
        stacked = knots.turned[seen, marker] @ np.concatenate(rows, axis=2)
        whitener = _whitener(knots.growing[np.ix_(seen, seen)], slide, SKIN_NOISE)
        yield (whitener @ stacked.reshape(len(stacked), -1)).reshape(-1, stacked.shape[2])


def _whitener(growing: Array, deviation: float, noise: float) -> Array:
    """L⁻¹ of the covariance L Lᵀ of an error with these standard deviations."""
    covariance = deviation**2 * growing + noise**2 * np.eye(len(growing))
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)))


def _is_moved(found: LinearisedPostures) -> NDArray[np.bool_]:
    """(coordinates,) whether a marker or a constraint depends on the coordinate."""
    by_marker = (np.abs(found.jacobian) > LEAST_ARM).any(axis=(0, 1, 2))
    return np.asarray(by_marker | (found.rows != 0.0).any(axis=(0, 1)))
