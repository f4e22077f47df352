"""The muscle-redundancy problem: load sharing among the muscles, frame by frame (Belli et al. 2023, "RMR").

With x = (activations a of the muscles, controls r of the actuators), in each frame

    minimise  Σ w aᵖ + Σ w r²   subject to   A x = q̈ − q̈₀,   lower ≤ x ≤ upper,   F₀ + A_F x in the glenoid's cone

with p = 2; q̈₀ and F₀ are accelerations and glenohumeral reaction at x = 0. The effort is (10), the constraints are
(11) of the source study (docs/architecture.md). Bounds follow the activation dynamics from one frame to the next. A has
rank 14 in 17 rows: the acromioclavicular constraint determines three combinations of accelerations, which no muscle
changes. The projection of q̈ − q̈₀ onto the column space of A is satisfied; the rest is reported per frame as the
equality residual.

With A x = b in each frame, b splits into its projection onto the column space of A, which a solution satisfies, and a
rest that no x produces. The residual of a solution is orthogonal to all columns of A, or a control could reduce it.

reduction.py eliminates the unbounded unknowns of a frame. There remains

    minimise  1/p Σ q aᵖ + ½ v·R v   subject to   M a + R v − t = (0, s),   lower ≤ a ≤ upper,   s and λ in the cone

with n activations a, m rows and their multipliers v = (y, λ). The first `equalities` rows are equalities; the last
three are the cone's, if there is a cone. R stands for the unknowns that were eliminated: v·R v / 2 is their effort.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from solver.errors import SolverCode
from solver.model import Array, Model, ModelError
from solver.multibody.postures import each_frame
from solver.redundancy.effort import (
    ActivationCost,
    Effort,
    Exponent,
    RedundancyOptions,
    Solver,
    activation_limits,
    effort_weights,
    ensure_convex,
    tracked_coordinates,
)
from solver.redundancy.mechanics import Mechanics, cone_rows, glenoid_cone

Outcomes = NDArray[np.object_]
Codes = NDArray[np.int8]
Number = TypeVar("Number", float, Array)

SOLVED, INFEASIBLE, NOT_CONVERGED, BEYOND_RATE = 0, 1, 2, 3
"""Outcome codes. BEYOND_RATE: infeasible within the activation-rate bounds, solved without them."""
VIOLATION_LIMIT = 1e-8
"""Largest error of the optimality conditions of a SOLVED problem."""
CONE_FORCE_SCALE = 1e3  # N; brings the cone's rows to the size of activations
ROUND_OFF = 1e-9  # of the frame's longest column


class FrameOutcome(StrEnum):
    """Outcome of a frame; everything but SOLVED is counted and shown.

    BEYOND_ACTIVATION_RATE  activations cannot change fast enough since the previous frame; solved without that limit
    INFEASIBLE              no activations between 0 and 1 and controls within their limits give the accelerations and
                            keep the joint reaction inside the glenoid; the point of least violation is given
    NOT_CONVERGED           the solver stopped before its residuals were small; its last point is given
    NOT_FINITE              the model has no finite accelerations in this posture, or a muscle with an elastic tendon no
                            finite force; the frame is left out
    """

    SOLVED = "solved"
    BEYOND_ACTIVATION_RATE = "beyond_activation_rate"
    INFEASIBLE = "infeasible"
    NOT_CONVERGED = "not_converged"
    NOT_FINITE = "not_finite"


OUTCOME_OF_CODE = np.empty(4, dtype=object)
OUTCOME_OF_CODE[[SOLVED, INFEASIBLE, NOT_CONVERGED, BEYOND_RATE]] = [
    FrameOutcome.SOLVED,
    FrameOutcome.INFEASIBLE,
    FrameOutcome.NOT_CONVERGED,
    FrameOutcome.BEYOND_ACTIVATION_RATE,
]
SOLVED_OUTCOMES = (FrameOutcome.SOLVED, FrameOutcome.BEYOND_ACTIVATION_RATE)


def are_solved(outcomes: Outcomes) -> NDArray[np.bool_]:
    """Whether frames (…) have the activations from which the next ones start."""
    return np.asarray((outcomes == SOLVED_OUTCOMES[0]) | (outcomes == SOLVED_OUTCOMES[1]))


@dataclass(frozen=True, eq=False)
class RedundancyProblem:
    """The problems of all frames of all scenarios. Scenarios have A, A_F, the cone and w in common, b and F₀ their own;
    without loads (with_loads) there is one.

    time            (frames,) [s];  interval [s] over which activations may change
    weights         w (controls,);  reserves come after the muscles
    time_constants  (2, muscles) of activation and deactivation [s]; 0 without activation dynamics
    matrix          A (frames, tracked, controls);  target  b = q̈ − q̈₀ (scenarios, frames, tracked) [rad/s², m/s²]
    tracked         (coordinates,) whether the acceleration is tracked: not of free ones, nor where a lock or a coupler
                    determines it
    reaction_matrix A_F (frames, 6, controls);  reaction_at_rest  F₀ (scenarios, frames, 6) moment [N m], force [N] in
                    ground
    cone            (frames, k, 3) rows that turn the force into (s, v); k = 3, or 0 without the glenoid
    solver, exponent, cost  as in RedundancyOptions
    control_limits  (2, actuators) least and greatest control, infinite without a limit; None is no limits
    has_activation_dynamics  False where every frame is solved by itself
    activation_limits  (2, muscles) least and greatest activation; None is 0 and 1
    order           (controls,) index in x of every column, None for the same order
    """

    time: Array
    interval: float
    weights: Array
    time_constants: Array
    matrix: Array
    target: Array
    tracked: NDArray[np.bool_]
    reaction_matrix: Array
    reaction_at_rest: Array
    cone: Array
    solver: Solver = "interior_point"
    control_limits: Array | None = None
    exponent: Exponent = 2
    has_activation_dynamics: bool = True
    activation_limits: Array | None = None
    cost: ActivationCost | None = None
    order: NDArray[np.int64] | None = None

    @property
    def muscles(self) -> int:
        """Number of them."""
        return int(self.time_constants.shape[1])

    @property
    def effort(self) -> Effort:
        """Of x (…, controls), (10)."""
        return Effort(self.weights, self.muscles, self.exponent, self.cost)

    @property
    def is_finite(self) -> NDArray[np.bool_]:
        """(frames,) False where the model has no finite accelerations, and nothing is solved."""
        known = np.concatenate([self.target, self.reaction_at_rest], axis=-1)
        return np.asarray(np.isfinite(known).all(axis=(0, -1)))

    @cached_property
    def cone_matrix(self) -> Array:
        """C (frames, k, controls), scaled so that 1e-8 is small: C x + c is to lie in the cone."""
        return np.asarray(self.cone / CONE_FORCE_SCALE @ self.reaction_matrix[:, 3:])

    @cached_property
    def cone_offset(self) -> Array:
        """c (scenarios, frames, k), scaled as C."""
        return each_frame(self.cone / CONE_FORCE_SCALE, self.reaction_at_rest[..., 3:])

    @property
    def rates(self) -> ActivationRates:
        """Limits of the activation rates."""
        widest = np.ascontiguousarray(self.widest_activations)
        return ActivationRates(*self.rates_over(self.interval), widest)

    @property
    def widest_activations(self) -> Array:
        """(2, muscles)."""
        if self.activation_limits is not None:
            return self.activation_limits
        return np.repeat([[0.0], [1.0]], self.muscles, axis=1)

    def with_loads(self, loads: LoadResponse) -> RedundancyProblem:
        """A scenario for each of these additional loads."""
        return replace(
            self,
            target=self.target - loads.acceleration[..., self.tracked],
            reaction_at_rest=self.reaction_at_rest + loads.reaction,
        )

    def cut(self, frames: slice) -> RedundancyProblem:
        """These frames alone."""
        return replace(
            self,
            time=self.time[frames],
            matrix=self.matrix[frames],
            target=self.target[:, frames],
            reaction_matrix=self.reaction_matrix[frames],
            reaction_at_rest=self.reaction_at_rest[:, frames],
            cone=self.cone[frames],
        )

    def scenario(self, chosen: int | slice) -> RedundancyProblem:
        """This scenario alone, or these."""
        own = slice(chosen, chosen + 1) if isinstance(chosen, int) else chosen
        return replace(self, target=self.target[own], reaction_at_rest=self.reaction_at_rest[own])

    def widest_bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds (scenarios, controls) in any frame."""
        lower, upper = np.full((2, len(self.target), len(self.weights)), [[[-np.inf]], [[np.inf]]])
        lower[:, : self.muscles], upper[:, : self.muscles] = self.widest_activations
        if self.control_limits is not None:
            lower[:, self.muscles :], upper[:, self.muscles :] = self.control_limits
        return lower, upper

    def rates_over(self, interval: float | Array) -> tuple[Array, Array]:
        """Rise and fall (muscles,) over an interval [s], or (scenarios, muscles) over one for each (scenarios, 1);
        infinite for muscles without activation dynamics.
        """
        shape = np.broadcast_shapes(np.shape(interval), self.time_constants[0].shape)
        rise, fall = np.full((2, *shape), np.inf)
        for rate, constant in zip((rise, fall), self.time_constants, strict=True):
            is_limited = (constant > 0.0) & self.has_activation_dynamics
            np.divide(interval, constant, out=rate, where=np.broadcast_to(is_limited, shape))
        return rise, fall

    def reachable(
        self, activations: Array, is_known: NDArray[np.bool_], interval: float | Array | None = None
    ) -> Array:
        """Bounds (scenarios, 2, muscles) an interval after activations (scenarios, muscles), the problem's or another;
        the widest where these are not known.
        """
        least, greatest = self.widest_activations
        rise, fall = self.rates_over(self.interval if interval is None else interval)
        with np.errstate(invalid="ignore"):
            slowest, fastest = reachable(activations.clip(0, 1), rise, fall)
        within = np.stack([np.fmax(slowest, least), np.fmin(fastest, greatest)], axis=1)
        return np.where(is_known[:, None, None], within, self.widest_activations)

    @property
    def determined_weights(self) -> Array:
        """w, but 1 for a control without effect in any frame: without a weight its value would be undetermined."""
        first = self.cut(slice(1))
        is_moving = first.matrix.any(axis=(0, 1)) | first.cone_matrix.any(axis=(0, 1))
        if not is_moving.all():  # in the first frame, as usual
            is_moving = self.matrix.any(axis=(0, 1)) | self.cone_matrix.any(axis=(0, 1))
        return np.where(is_moving, self.weights, np.maximum(self.weights, 1.0))

    def reducible(self) -> RedundancyProblem | None:
        """The problem as reduction.py takes it: a control without effect in all frames has a weight, so that its value
        is determined, and actuators with two limits are bounded as activations without dynamics, behind the muscles.

        None where only Clarabel solves it: with an actuator limited on one side or to one value, and with actuators
        limited on both where activations count by their cubes, because the effort of a control is its square.
        """
        weighted = replace(self, weights=self.determined_weights)
        if self.control_limits is None or not np.isfinite(self.control_limits).any():
            return weighted
        limits = np.asarray(self.control_limits)
        is_limited = np.isfinite(limits)
        is_bounded = is_limited.all(axis=0)
        is_fit = is_bounded & (limits[0] < limits[1]) | ~is_limited.any(axis=0)
        if (self.cost is None and self.exponent != 2) or not is_fit.all():
            return None
        actuators = self.muscles + np.concatenate([np.flatnonzero(is_bounded), np.flatnonzero(~is_bounded)])
        order = np.concatenate([np.arange(self.muscles), actuators])
        return replace(
            weighted,
            weights=weighted.weights[order],
            matrix=self.matrix[:, :, order],
            reaction_matrix=self.reaction_matrix[:, :, order],
            time_constants=np.hstack([self.time_constants, np.zeros((2, int(is_bounded.sum())))]),
            control_limits=None,
            activation_limits=np.concatenate([self.widest_activations, limits[:, is_bounded]], axis=1),
            order=order,
        )


def ensure_solvable(model: Model, options: RedundancyOptions) -> None:
    """Raise ModelError for a model without muscles, or a cost that is not convex."""
    if not model.muscles:
        raise ModelError(f"the model {model.name} should have muscles and has none; use another", SolverCode.NO_MUSCLES)
    if options.cost is not None:
        ensure_convex(options.cost, len(model.muscles))


def build_redundancy(model: Model, mechanics: Mechanics, options: RedundancyOptions) -> RedundancyProblem:
    """Build (11) for all frames. ModelError for a model without muscles, or for unknown names; MotionError if it has no
    finite accelerations in any frame.

    Columns of an actuator that are round-off, as on a locked coordinate, are set to zero; its control is 0 there.
    """
    ensure_solvable(model, options)
    kinematics, maps = mechanics.kinematics, mechanics.maps(model)
    tracked = tracked_coordinates(model, options)
    matrix, reaction_matrix = maps.acceleration_per_control, maps.reaction_per_control
    if not tracked.all():  # else not a copy
        matrix = matrix[:, tracked]
    is_idle = idle_controls(matrix, reaction_matrix)
    is_idle[:, : len(model.muscles)] = False
    if is_idle.any():
        matrix, reaction_matrix = (np.where(is_idle[:, None], 0.0, part) for part in (matrix, reaction_matrix))
    cone = np.zeros((len(kinematics.time), 0, 3))
    if options.has_glenoid_cone:
        glenoid = glenoid_cone(model, options.glenoid_aspect, options.joint)
        cone = cone_rows(glenoid, mechanics.state.rotation_to_ground[:, glenoid.body])
    return RedundancyProblem(
        time=kinematics.time,
        interval=kinematics.interval,
        weights=effort_weights(model, options),
        time_constants=np.array(
            [
                [muscle.activation_time_constant for muscle in model.muscles],
                [muscle.deactivation_time_constant for muscle in model.muscles],
            ]
        ),
        matrix=matrix,
        target=(kinematics.accelerations - maps.acceleration_at_rest)[None, :, tracked],
        tracked=tracked,
        reaction_matrix=reaction_matrix,
        reaction_at_rest=maps.reaction_at_rest[None],
        cone=cone,
        solver=options.solver,
        control_limits=np.array([[actuator.min_control, actuator.max_control] for actuator in model.actuators])
        .reshape(-1, 2)
        .T,
        exponent=options.exponent,
        cost=options.cost,
        has_activation_dynamics=options.has_activation_dynamics,
        activation_limits=activation_limits(model) if options.has_muscle_limits else None,
    )


@dataclass(frozen=True, eq=False)
class LoadResponse:
    """Changes by additional loads at x = 0, per scenario and frame.

    acceleration  (scenarios, frames, coordinates) [rad/s², m/s²]
    reaction      (scenarios, frames, 6) moment [N m], force [N] on the scapula in ground
    """

    acceleration: Array
    reaction: Array


def idle_controls(matrix: Array, reaction_matrix: Array) -> NDArray[np.bool_]:
    """(frames, controls) whose columns of A (frames, rows, controls) and of the reaction's A_F are round-off.

    The actuator of a locked coordinate is one: the lock takes its force.
    """
    return np.asarray(np.logical_and(*(_is_round_off(part) for part in (matrix, reaction_matrix))))


def _is_round_off(matrix: Array) -> NDArray[np.bool_]:
    squares = column_squares(matrix)
    return np.asarray(squares <= ROUND_OFF**2 * squares.max(axis=1, keepdims=True, initial=0.0))


def column_squares(matrix: Array) -> Array:
    """Squared lengths (frames, controls) of the columns, without an intermediate array."""
    return np.asarray(np.einsum("fij,fij->fj", matrix, matrix))


def reachable(a: Number, rise: Number, fall: Number) -> tuple[Number, Number]:
    """Activations that one interval at no and at full excitation leads to from a (Thelen 2003).

    NaN where infinity is multiplied by zero; this and infinity are no limits.
    """
    pace = 0.5 + 1.5 * a
    return a - fall * a * pace, a + rise * (1.0 - a) / pace


class FrameProblem(NamedTuple):
    """The problem of one frame: q (n,), M (m, n), R (m, m), t (m,), lower and upper (n,), exponent p."""

    q: Array
    M: Array
    R: Array
    t: Array
    equalities: int
    lower: Array
    upper: Array
    exponent: int


class ActivationRates(NamedTuple):
    """Limits of the change of activations from one frame to the next, for compiled code.

    rise, fall  (n,) interval between frames over the time constants of activation and deactivation; infinite where the
                unknown may take any value within its bounds in every frame
    widest      (2, n) least and greatest a in any frame
    """

    rise: Array
    fall: Array
    widest: Array


class WarmStart(NamedTuple):
    """Start of the next frame: bounds (scenarios, 2, n) lower and upper, multipliers (scenarios, m) as a guess."""

    bounds: Array
    multipliers: Array


class SequenceSolution(NamedTuple):
    """a (scenarios, frames, n), v (scenarios, frames, m) and outcome codes (scenarios, frames)."""

    a: Array
    v: Array
    codes: Codes
