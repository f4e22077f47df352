"""Force balance of a fibre and its elastic tendon, and the fibre length that one implicit step leads to; compiled.

With the normalised fibre length l, its velocity v over the fastest one, the pennation φ and the path length L (Millard,
Uchida, Seth, Delp, J. Biomech. Eng. 135(2):021005, 2013, equation 4):

    [a f_L(l) f_V(v) + f_P(l) + β v] cos φ − f_T((L − l₀ l cos φ) / l_T) = 0

v is known from l: by a difference formula, rate (l − anchor), or in the first frame, where the tendon keeps its length,
by the velocity of the path, drift cos φ. So one equation in l remains, which rises where it has its root.

The step is that of the second-order backward differentiation formula (BDF2; Curtiss and Hirschfelder, Proc. Natl. Acad.
Sci. 38:235, 1952), l' = (3 l − 4 l₁ + l₂) / 2h of the two frames before, which damps the stiff modes of short tendons;
by implicit Euler, l' = (l − l₁) / h, in the second frame and after a fibre was held at its least length. The balance of
forces holds in every frame, so velocities of the path are only needed in the first one.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from math import asinh, e, exp, expm1, inf, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from solver.compiled import compiled, compiled_for_python
from solver.errors import SolverCode
from solver.functions.bezier import value_and_slope
from solver.functions.muscle_curves import (
    DE_GROOTE_BELLS,
    DE_GROOTE_SPEED,
    INTERVALS,
    BezierChain,
    DeGrooteFreglyCurves,
    DeGrooteFreglyTendon,
    MillardCurves,
    MillardTendon,
    SchutteCurves,
    ThelenCurves,
    ThelenTendon,
)
from solver.model import Model, ModelError, Muscle
from solver.muscle import MuscleForces, muscle_forces

Array = NDArray[np.float64]
Four = tuple[float, float, float, float]
Settled = tuple[float, float, float, float, int]
"""Normalised fibre length; over the greatest isometric force the tendon's force, its derivative by a, and the passive
force along the tendon; and outcome code."""

CONVERGED, AT_SHORTEST, NOT_CONVERGED = 0, 1, 2
"""Outcome codes of a fibre. AT_SHORTEST: held at its least length, as in OpenSim."""
STEPS = 60
FIRST_STEP = 0.2  # of the normalised length, twice the longest first step without a bracket
LENGTH_TOLERANCE = 1e-13  # of the normalised length
WIDEST = 8.0  # normalised length beyond which no balance is sought

Codes = NDArray[np.int8]
MILLARD, THELEN, DE_GROOTE = 0, 1, 2
KINDS = {MillardCurves: MILLARD, ThelenCurves: THELEN, DeGrooteFreglyCurves: DE_GROOTE}
ACTIVE, VELOCITY, PASSIVE, TENDON = 0, 1, 2, 3
LEAST_LENGTH = 0.01  # of the optimal one, OpenSim's for a fibre without pennation
LEAST_ACTIVATION = 0.01  # OpenSim's minimum_activation
LEAST_DE_GROOTE = 0.2  # the length at which its passive force is zero; OpenSim's lower bound


class FiberEquation(NamedTuple):
    """The equation in l of a fibre at path length L [m] and activation a, with v = rate (l − anchor) + drift cos φ."""

    path: float
    a: float
    rate: float
    anchor: float
    drift: float


@compiled
def settle_fiber(tables: FiberTables, i: int, equation: FiberEquation, guess: float) -> Settled:
    """The fibre in balance.

    Newton's method from the guess, which nearly always converges from the frame before. Where it does not, and in a
    first frame, where v does not make the equation rise, within a bracket of the root.
    """
    if equation.rate > 0.0:
        found = _by_newton(tables, i, equation, guess)
        if found[4] == CONVERGED:
            return found
    return _within_bracket(tables, i, equation, guess)


@compiled
def _by_newton(tables: FiberTables, i: int, equation: FiberEquation, guess: float) -> Settled:
    """CONVERGED only if every step is shorter than half of the one before, and the length above the least one."""
    length, before = guess, FIRST_STEP
    for _ in range(STEPS):
        value, slope, by_activation, passive = balance(tables, i, equation, length)
        step = -value / slope
        length += step
        if not (slope > 0.0 and abs(step) <= 0.5 * before and length > tables.scales[i, 6]):
            break
        before = abs(step)
        if before <= LENGTH_TOLERANCE:
            force, by_length = tendon_force(tables, i, equation.path, length)
            return length, force, -by_length * by_activation / slope, passive, CONVERGED
    return length, 0.0, 0.0, 0.0, NOT_CONVERGED


@compiled
def _within_bracket(tables: FiberTables, i: int, equation: FiberEquation, guess: float) -> Settled:
    low = tables.scales[i, 6]
    value, _, _, passive = balance(tables, i, equation, low)
    if value >= 0.0:
        return low, tendon_force(tables, i, equation.path, low)[0], 0.0, passive, AT_SHORTEST
    high = _upper_end(tables, i, equation)
    if not high < WIDEST:
        return low, 0.0, 0.0, 0.0, NOT_CONVERGED
    length, before, code = min(max(guess, low), high), inf, NOT_CONVERGED
    for _ in range(STEPS):
        value, slope, _, _ = balance(tables, i, equation, length)
        if value < 0.0:
            low = length
        else:
            high = length
        step = -value / slope if slope > 0.0 else inf
        if not (low <= length + step <= high and abs(step) <= 0.5 * before):  # f_V bends sharply at v = 0
            step = 0.5 * (low + high) - length
        length, before = length + step, abs(step)
        if abs(step) <= LENGTH_TOLERANCE:
            code = CONVERGED
            break
    _, slope, by_activation, passive = balance(tables, i, equation, length)
    force, by_length = tendon_force(tables, i, equation.path, length)
    gain = -by_length * by_activation / slope if slope > 0.0 else 0.0  # 0: a slack tendon and a fibre without force
    return length, force, gain, passive, code


@compiled
def balance(tables: FiberTables, i: int, equation: FiberEquation, length: float) -> Four:
    """The left side of the equation, its derivatives by l and by a, and the passive force f_P cos φ."""
    path, a, rate, anchor, drift = equation
    optimal, height, damping = tables.scales[i, 0], tables.scales[i, 2], tables.scales[i, 5]
    cos = sqrt(max(1.0 - (height / (optimal * length)) ** 2, 1e-12))
    cos_slope = (1.0 - cos * cos) / (length * cos)
    v, v_slope = rate * (length - anchor) + drift * cos, rate + drift * cos_slope
    active, active_slope, passive, passive_slope = _length_factors(tables, i, length)
    speed, speed_slope, speed_by_a = _speed_factor(tables, i, v, a)
    force, force_slope = tendon_force(tables, i, path, length)
    fiber = a * active * speed + passive + damping * v
    fiber_slope = a * (active_slope * speed + active * speed_slope * v_slope) + passive_slope + damping * v_slope
    by_length = fiber_slope * cos + fiber * cos_slope - force_slope
    return fiber * cos - force, by_length, active * (speed + a * speed_by_a) * cos, passive * cos


@compiled
def tendon_force(tables: FiberTables, i: int, path: float, length: float) -> tuple[float, float]:
    """f_T and its derivative by the normalised fibre length."""
    optimal, slack, height = tables.scales[i, 0], tables.scales[i, 1], tables.scales[i, 2]
    along = sqrt(max((optimal * length) ** 2 - height**2, (1e-6 * optimal * length) ** 2))
    stretch_slope = -(optimal**2) * length / along / slack
    kind, shapes, tendon = tables.kind[i], tables.shapes[i], (path - along) / slack
    if kind == MILLARD:
        force, slope = _chain(tables, i, TENDON, tendon)
    elif kind == THELEN:
        force, slope = _thelen_tendon(shapes[6], tendon - 1.0)
    else:
        force, slope = 0.2 * expm1(shapes[3] * (tendon - 1.0)), 0.2 * shapes[3] * exp(shapes[3] * (tendon - 1.0))
    return force, slope * stretch_slope


@compiled
def _upper_end(tables: FiberTables, i: int, equation: FiberEquation) -> float:
    """A length with a balance that is not negative: the tendon is slack, and the fibre does not shorten."""
    scales = tables.scales[i]
    optimal, slack, height, shortest = scales[0], scales[1], scales[2], scales[6]
    along = max(equation.path - slack, 0.0)
    high = max(shortest, sqrt(along**2 + height**2) / optimal)
    if equation.rate > 0.0:
        high = max(high, equation.anchor)
    while high < WIDEST and not balance(tables, i, equation, high)[0] >= 0.0:
        high *= 1.1
    return float(high)


@compiled
def _length_factors(tables: FiberTables, i: int, length: float) -> Four:
    """f_L and its slope, f_P and its slope."""
    kind, shapes = tables.kind[i], tables.shapes[i]
    if kind == MILLARD:
        active, active_slope = _chain(tables, i, ACTIVE, length)
        passive, passive_slope = _chain(tables, i, PASSIVE, length)
        return active, active_slope, passive, passive_slope
    if kind == THELEN:
        width, shape, strain = shapes[0], shapes[1], shapes[2]
        active = exp(-((length - 1.0) ** 2) / width)
        stretch, rigid = max(length - 1.0, 0.0) / strain, expm1(shape)
        passive_slope = shape / strain * exp(shape * stretch) / rigid if length > 1.0 else 0.0
        return active, -2.0 * (length - 1.0) / width * active, expm1(shape * stretch) / rigid, passive_slope
    x, strain = (length - 1.0) / shapes[0] + 1.0, shapes[1]
    active, active_slope = 0.0, 0.0
    for height, centre, width, growth in DE_GROOTE_BELLS:
        spread = width + growth * x
        z = (x - centre) / spread
        bell = height * exp(-0.5 * z * z)
        active += bell
        active_slope -= bell * z * (1.0 - growth * z) / spread / shapes[0]
    foot, grown = exp(4.0 * (0.2 - 1.0) / strain), exp(4.0 * (length - 1.0) / strain)
    scale = shapes[2] / (exp(4.0) - foot)
    return active, active_slope, scale * (grown - foot), scale * 4.0 / strain * grown


@compiled
def _speed_factor(tables: FiberTables, i: int, v: float, a: float) -> tuple[float, float, float]:
    """f_V, its slope, and its derivative by a: Thelen's fibre is slower at little activation."""
    kind, shapes = tables.kind[i], tables.shapes[i]
    if kind == MILLARD:
        factor, slope = _chain(tables, i, VELOCITY, v)
        return factor, slope, 0.0
    if kind == THELEN:
        pace = 0.25 + 0.75 * a
        factor, slope = _thelen_speed(shapes[3], shapes[4], shapes[5], v / pace)
        return factor, slope / pace, -0.75 * v / pace**2 * slope
    d1, d2, d3, d4 = DE_GROOTE_SPEED
    y = d2 * v + d3
    return d1 * asinh(y) + d4, d1 * d2 / sqrt(y * y + 1.0), 0.0


@compiled
def _thelen_speed(shape: float, strongest: float, linear_beyond: float, v: float) -> tuple[float, float]:
    """Equations 6 and 7 of Thelen (2003), solved for the force; straight beyond both ends, as in OpenSim."""
    gain, last = (2.0 + 2.0 / shape) / (strongest - 1.0), linear_beyond * strongest
    room = gain * (strongest - last)
    last_v = (last - 1.0) / room
    if v <= -1.0:
        slope = 1.0 / (1.0 + 1.0 / shape)
        return (v + 1.0) * slope, slope
    if v < 0.0:
        below = 1.0 - v / shape
        return (1.0 + v) / below, (below + (1.0 + v) / shape) / below**2
    if v <= last_v:
        below = 1.0 + gain * v
        return (1.0 + gain * v * strongest) / below, gain * (strongest - 1.0) / below**2
    slope = 1.0 / (1.0 / room + (last - 1.0) * gain / room**2)
    return last + (v - last_v) * slope, slope


@compiled
def _thelen_tendon(strain: float, stretch: float) -> tuple[float, float]:
    toe_slope = 3.0 * 0.33 * e**3 / expm1(3.0)
    toe = strain * toe_slope / (toe_slope + 0.67)
    if stretch > toe:
        stiffness = 0.67 / (strain - toe)
        return 0.33 + stiffness * (stretch - toe), stiffness
    if stretch > 0.0:
        scale = 0.33 / expm1(3.0)
        return scale * expm1(3.0 * stretch / toe), scale * 3.0 / toe * exp(3.0 * stretch / toe)
    return 0.0, 0.0


@compiled
def _chain(tables: FiberTables, i: int, curve: int, x: float) -> tuple[float, float]:
    first, last = tables.corner_range[i, curve]
    return value_and_slope(tables.corners[first:last], tables.nodes[first:last], x)


class StepStart(NamedTuple):
    """Start of the step of n fibres: v = rate (l − anchor) + drift cos φ, and a guess of l; all (n,)."""

    anchor: Array
    rate: Array
    drift: Array
    guess: Array


class SettledFibers(NamedTuple):
    """The fibres after a step, all (n,): normalised length, tendon force over the greatest isometric one, its
    derivative by the activation, passive force of the fibre along the tendon over the same, codes of fiber.py.
    """

    length: Array
    force: Array
    gain: Array
    passive: Array
    codes: Codes


@compiled_for_python
def fill_settled(
    tables: FiberTables, paths: Array, activations: Array, start: StepStart, settled: SettledFibers
) -> None:
    """Fibres (n,) at path lengths [m] and activations (n,)."""
    for i in range(len(tables.muscle)):
        a = max(activations[i], tables.least_activation[i])
        equation = FiberEquation(paths[i], a, start.rate[i], start.anchor[i], start.drift[i])
        length, force, gain, passive, code = settle_fiber(tables, i, equation, start.guess[i])
        settled.length[i], settled.force[i], settled.passive[i], settled.codes[i] = length, force, passive, code
        settled.gain[i] = gain if activations[i] >= a else 0.0


@compiled_for_python
def fill_given(tables: FiberTables, paths: Array, settled: SettledFibers) -> None:
    """Forces (n,) of fibres whose lengths are given in settled; without derivatives."""
    for i in range(len(tables.muscle)):
        length, path = settled.length[i], paths[i]
        settled.force[i] = tendon_force(tables, i, path, length)[0]
        settled.passive[i] = balance(tables, i, FiberEquation(path, 0.0, 0.0, length, 0.0), length)[3]


def allocate_settled(count: int) -> SettledFibers:
    length, force, gain, passive = np.zeros((4, count))
    return SettledFibers(length, force, gain, passive, np.zeros(count, np.int8))


class FiberHistory:
    """Normalised fibre lengths of the two frames before, at an interval [s]."""

    def __init__(self, tables: FiberTables, interval: float) -> None:
        optimal, fastest = tables.scales[:, 0], tables.scales[:, 4]
        self._optimal, self._per_second = optimal, 1.0 / fastest
        self._interval = interval
        self._last: Array | None = None
        self._before = np.empty(len(optimal))
        self._is_second_order = self._was_free = np.zeros(len(optimal), bool)

    def start(self, path_speeds: Array) -> StepStart:
        """Of the next frame; path_speeds (n,) [m/s] count in a first one, where tendons keep their lengths."""
        none = np.zeros(len(self._optimal))
        if self._last is None:
            drift = path_speeds * self._per_second / self._optimal
            return StepStart(none, none, drift, np.ones(len(none)))
        anchor = np.where(self._is_second_order, (4.0 * self._last - self._before) / 3.0, self._last)
        rate = np.where(self._is_second_order, 1.5, 1.0) / self._interval * self._per_second
        return StepStart(anchor, rate, none, self._last.copy())

    def keep(self, settled: SettledFibers) -> None:
        """The fibres of the frame, for the next ones."""
        is_free = settled.codes != AT_SHORTEST
        if self._last is not None:
            self._before, self._is_second_order = self._last, is_free & self._was_free
        self._last, self._was_free = settled.length.copy(), is_free


class FiberTables(NamedTuple):
    """n muscles with elastic tendons.

    muscle     (n,) index in Model.muscles;  kind (n,) MILLARD, THELEN or DE_GROOTE
    scales     (n, 7) optimal length [m], slack length [m], height [m], greatest isometric force [N], fastest velocity
               [optimal lengths/s], damping, shortest normalised length
    shapes     (n, 7) figures of the closed curves, as _shapes gives them
    least_activation  (n,) below which the fibre has this one: without damping, nothing else holds a fibre
    corners    (corners, 2, 6) of all Bézier chains, with nodes (corners, intervals + 1) as BezierChain
    corner_range  (n, 4, 2) where a muscle's chain begins and ends: ACTIVE, VELOCITY, PASSIVE, TENDON
    """

    muscle: NDArray[np.int64]
    kind: NDArray[np.int64]
    scales: Array
    shapes: Array
    least_activation: Array
    corners: Array
    nodes: Array
    corner_range: NDArray[np.int64]


def elastic_muscles(model: Model) -> NDArray[np.int64]:
    """Indices of the muscles whose tendons are elastic: those with a curve and a tendon that has a length."""
    is_elastic = [muscle.tendon is not None and muscle.tendon_slack_length > 0.0 for muscle in model.muscles]
    return np.flatnonzero(is_elastic)


@lru_cache(maxsize=32)  # a model is frozen
def fiber_tables(model: Model) -> FiberTables:
    """Raises ModelError if no tendon is elastic, or for a muscle of Schutte, whose tendon is not read."""
    unread = [muscle.name for muscle in model.muscles if isinstance(muscle.curves, SchutteCurves)]
    if unread:
        raise ModelError(
            f"the tendons of {', '.join(unread[:3])} should have a curve and have none: the solver does not read that "
            f"of Schutte1993Muscle_Deprecated; replace {len(unread)} muscles of {model.name} or keep tendons rigid",
            SolverCode.NO_TENDON,
        )
    indices = elastic_muscles(model)
    if not len(indices):
        raise ModelError(
            f"the model {model.name} should have a muscle with an elastic tendon and has none: all have "
            "ignore_tendon_compliance, or no tendon; change the model or keep tendons rigid",
            SolverCode.NO_TENDON,
        )
    muscles = [model.muscles[index] for index in indices]
    used = [_chains(muscle) for muscle in muscles]  # muscles with the same curve share it
    chains = {id(chain): chain for of_muscle in used for chain in of_muscle if chain is not None}
    ends = np.cumsum([0, *(len(chain.corners) for chain in chains.values())])
    ranges = dict(zip(chains, pairwise(ends.tolist()), strict=True))
    return FiberTables(
        muscle=indices,
        kind=np.array([KINDS[type(muscle.curves)] for muscle in muscles]),
        scales=np.array([_scales(muscle) for muscle in muscles]),
        shapes=np.array([_shapes(muscle) for muscle in muscles]),
        least_activation=np.array([0.0 if muscle.fiber_damping else LEAST_ACTIVATION for muscle in muscles]),
        corners=np.concatenate([np.zeros((0, 2, 6)), *(chain.corners for chain in chains.values())]),
        nodes=np.concatenate([np.zeros((0, INTERVALS + 1)), *(chain.nodes for chain in chains.values())]),
        corner_range=np.array([[ranges.get(id(chain), (0, 0)) for chain in of_muscle] for of_muscle in used]),
    )


def _chains(muscle: Muscle) -> tuple[BezierChain | None, ...]:
    if isinstance(muscle.curves, MillardCurves) and isinstance(muscle.tendon, MillardTendon):
        return (*muscle.curves.chains, muscle.tendon.chain)
    return (None,) * 4


def _scales(muscle: Muscle) -> tuple[float, ...]:
    optimal = muscle.optimal_fiber_length
    height = optimal * float(np.sin(muscle.pennation_at_optimal))
    least = LEAST_DE_GROOTE if isinstance(muscle.curves, DeGrooteFreglyCurves) else LEAST_LENGTH
    steepest = min(muscle.maximum_pennation, float(np.arccos(1e-3)))  # a fibre across its tendon would bear nothing
    shortest = max(muscle.curves.shortest, height / float(np.sin(steepest)) / optimal, least)
    fastest, slack = muscle.max_contraction_velocity, muscle.tendon_slack_length
    return optimal, slack, height, muscle.max_isometric_force, fastest, muscle.fiber_damping, shortest


def _shapes(muscle: Muscle) -> tuple[float, ...]:
    """In the order in which fiber.py unpacks them; zeros for Millard's, which are chains."""
    match muscle.curves, muscle.tendon:
        case ThelenCurves() as curves, ThelenTendon() as tendon:
            active, passive = curves.active_shape, curves.passive_shape
            speed = curves.velocity_shape, curves.strongest, curves.linear_beyond
            return active, passive, curves.passive_strain, *speed, tendon.strain
        case DeGrooteFreglyCurves() as curves, DeGrooteFreglyTendon() as tendon:
            has_passive = float(curves.has_passive_force)
            return curves.width, curves.passive_strain, has_passive, tendon.shape, 0.0, 0.0, 0.0
        case _:
            return (0.0,) * 7


@dataclass(frozen=True, eq=False)
class ElasticForces:
    """Forces and fibres of all muscles of a model in a motion, all (frames, muscles).

    A muscle with a rigid tendon (ignore_tendon_compliance, or a slack length of 0) has the forces of muscle_forces.

    tension         along the tendon [N]
    passive         passive force of the fibre along the tendon, without damping [N]
    fiber_lengths   [m];  tendon_strain 0 at the slack length; both NaN with a rigid tendon
    is_shortest     whether the fibre is held at its least length
    is_converged    whether the balance of forces converged
    """

    tension: Array
    passive: Array
    fiber_lengths: Array
    tendon_strain: Array
    is_shortest: NDArray[np.bool_]
    is_converged: NDArray[np.bool_]

    @property
    def elastic(self) -> NDArray[np.int64]:
        """Indices of the muscles with elastic tendons."""
        return np.flatnonzero(~np.isnan(self.tendon_strain).all(axis=0))


def elastic_forces(
    model: Model,
    lengths: Array,
    speeds: Array,
    activations: Array,
    interval: float,
    initial_fibers: Array | None = None,
) -> ElasticForces:
    """Forces at path lengths [m], lengthening speeds [m/s] and activations, all (frames, muscles), `interval` s apart.

    Of the speeds, elastic tendons need those of the first frame only: there the tendon keeps its length, which at rest
    is OpenSim's equilibrium. Or the first frame has initial_fibers (muscles,), lengths of the fibres [m]. The error
    falls with the square of the interval. Raises ModelError without an elastic tendon, or for other shapes.
    """
    tables = fiber_tables(model)
    _ensure_shapes(model, lengths, speeds, activations)
    chosen, forces = tables.muscle, with_rigid_tendons(muscle_forces(model, lengths, speeds), activations)
    history, settled = FiberHistory(tables, interval), allocate_settled(len(chosen))
    for frame, path in enumerate(np.ascontiguousarray(lengths[:, chosen])):
        if frame == 0 and initial_fibers is not None:
            settled.length[:] = np.maximum(initial_fibers[chosen] / tables.scales[:, 0], tables.scales[:, 6])
            fill_given(tables, path, settled)
        else:
            fill_settled(tables, path, activations[frame, chosen], history.start(speeds[frame, chosen]), settled)
        history.keep(settled)
        fill_frame(forces, frame, tables, path, settled)
    return forces


def with_rigid_tendons(forces: MuscleForces, activations: Array) -> ElasticForces:
    """All muscles with rigid tendons, to be filled frame by frame where they are elastic."""
    shape = activations.shape
    return ElasticForces(
        tension=forces.active * activations + forces.passive,
        passive=forces.passive.copy(),
        fiber_lengths=np.full(shape, np.nan),
        tendon_strain=np.full(shape, np.nan),
        is_shortest=np.zeros(shape, bool),
        is_converged=np.ones(shape, bool),
    )


def fill_frame(forces: ElasticForces, frame: int, tables: FiberTables, paths: Array, settled: SettledFibers) -> None:
    """Fill the elastic muscles of a frame; paths (n,) [m] are those of the tables' muscles."""
    chosen, (optimal, slack, height, strength, *_) = tables.muscle, tables.scales.T
    fiber = settled.length * optimal
    forces.tension[frame, chosen] = settled.force * strength
    forces.passive[frame, chosen] = settled.passive * strength
    forces.fiber_lengths[frame, chosen] = fiber
    forces.tendon_strain[frame, chosen] = (paths - np.sqrt(np.maximum(fiber**2 - height**2, 0.0))) / slack - 1.0
    forces.is_shortest[frame, chosen] = settled.codes == AT_SHORTEST
    forces.is_converged[frame, chosen] = settled.codes != NOT_CONVERGED


def _ensure_shapes(model: Model, *arrays: Array) -> None:
    expected = (len(arrays[0]), len(model.muscles))
    for array in arrays:
        if array.shape != expected:
            raise ModelError(
                f"path lengths, speeds and activations should have shape {expected}, a column for each muscle of "
                f"{model.name}, and one has {array.shape}; give all of them",
                SolverCode.WRONG_SHAPE,
            )
