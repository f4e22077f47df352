"""Force curves of muscle fibres and tendons, and the limits of their parameters.

Fibre: active force-length, force-velocity and passive force-length. Millard, Uchida, Seth, Delp, J. Biomech. Eng.
135(2):021005 (2013): chains of quintic Bézier corners, the shapes of OpenSim's SmoothSegmentedFunctionFactory. Thelen,
J. Biomech. Eng. 125(1):70-77 (2003): exponentials and hyperbolas, in OpenSim's version. De Groote, Kinney, Rao, Fregly,
Ann. Biomed. Eng. 44(10):2922-2936 (2016), and Schutte, Rodgers, Zajac, Glaser, IEEE Trans. Rehabil. Eng. 1(2):109-125
(1993): as in OpenSim's classes of these names. Lengths over the optimal one, speeds over the fastest, forces over the
greatest isometric one.

Tendon: force over the greatest isometric force of the muscle, of length over slack length. As in OpenSim's
TendonForceLengthCurve (Millard, Uchida, Seth, Delp, J. Biomech. Eng. 135(2):021005, 2013), in its Thelen2003Muscle
(Thelen, J. Biomech. Eng. 125(1):70-77, 2003, with constants that make the slope continuous) and in its
DeGrooteFregly2016Muscle (De Groote, Kinney, Rao, Fregly, Ann. Biomed. Eng. 44(10):2922-2936, 2016).

Limits of the parameters, beyond which a curve folds or its force is not finite: those of OpenSim's
SmoothSegmentedFunctionFactory, Millard2012EquilibriumMuscle, Thelen2003Muscle and DeGrooteFregly2016Muscle, which
refuse to build such a muscle.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from math import exp, expm1, log
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from solver.functions.coordinate_functions import Function, simm_spline

Array = NDArray[np.float64]
Codes = NDArray[np.int8]
Knot = tuple[float, float, float]
"""x, y and slope of the end of a Bézier corner."""

INTERVALS = 512  # in each corner


@dataclass(frozen=True)
class MillardCurves:
    """The figures of OpenSim's ActiveForceLengthCurve, ForceVelocityCurve and FiberForceLengthCurve, its defaults.

    Active force rises from `shortest`, is gentle to `transition` and beyond, where it has the slope `shallow_slope`,
    greatest at 1 and least, `minimum`, again from `longest` on. The force at speed has the named slopes at the fastest
    shortening, near it (nine tenths), at rest, near and at the fastest lengthening. The passive force begins at
    `passive_start` beyond 1 and is that of full activity at `passive_end`; the slopes are those after its toe and at
    its end.
    """

    shortest: float = 0.4441
    transition: float = 0.73
    longest: float = 1.8123
    shallow_slope: float = 0.8616
    minimum: float = 0.1
    concentric_slope: float = 0.0
    near_concentric_slope: float = 0.25
    isometric_slope: float = 5.0
    eccentric_slope: float = 0.0
    near_eccentric_slope: float = 0.15
    strongest: float = 1.4
    concentric_curviness: float = 0.6
    eccentric_curviness: float = 0.9
    passive_start: float = 0.0
    passive_end: float = 0.7
    passive_low_slope: float = 0.2
    passive_slope: float = 2.0 / 0.7
    passive_curviness: float = 0.75
    is_idle_when_shortest: ClassVar[bool] = False

    @property
    def chains(self) -> tuple[BezierChain, BezierChain, BezierChain]:
        """Active force-length, force-velocity and passive force-length."""
        return _active_force_length(self), _force_velocity(self), _passive_force_length(self)

    def active_force_length(self, length: Array, codes: Codes | None = None) -> Array:
        return evaluate(_active_force_length(self), length, codes)

    def force_velocity(self, speed: Array, codes: Codes | None = None) -> Array:
        """Lengthening is positive."""
        return evaluate(_force_velocity(self), speed, codes)

    def passive_force_length(self, length: Array, codes: Codes | None = None) -> Array:
        return evaluate(_passive_force_length(self), length, codes)


@dataclass(frozen=True)
class ThelenCurves:
    """The figures of OpenSim's Thelen2003Muscle, its defaults.

    The force at speed is that at full activation: in this muscle alone it depends on the activation, and a force that
    is to be linear in the activation has to take one. Beyond `linear_beyond` of `strongest` it is linear.
    """

    passive_strain: float = 0.6
    active_shape: float = 0.45
    passive_shape: float = 5.0
    velocity_shape: float = 0.25
    strongest: float = 1.4
    linear_beyond: float = 0.95
    shortest: float = 0.0
    is_idle_when_shortest: ClassVar[bool] = True

    def active_force_length(self, length: Array, _codes: Codes | None = None) -> Array:
        return np.asarray(np.exp(-((length - 1.0) ** 2) / self.active_shape))

    def force_velocity(self, speed: Array, _codes: Codes | None = None) -> Array:
        """Lengthening is positive; equations 6 and 7, solved for the force."""
        a, strongest = self.velocity_shape, self.strongest
        gain = (2.0 + 2.0 / a) / (strongest - 1.0)
        last = self.linear_beyond * strongest
        room = gain * (strongest - last)
        last_speed = (last - 1.0) / room
        straight = last + (speed - last_speed) / (1.0 / room + (last - 1.0) * gain / room**2)
        shortening = (1.0 + np.clip(speed, -1.0, 0.0)) / (1.0 - np.clip(speed, -1.0, 0.0) / a)
        lengthening = np.clip(speed, 0.0, last_speed) * gain
        curved = np.where(speed < 0.0, shortening, (1.0 + lengthening * strongest) / (1.0 + lengthening))
        return np.asarray(np.where(speed > last_speed, straight, curved))

    def passive_force_length(self, length: Array, _codes: Codes | None = None) -> Array:
        stretch = np.maximum(length - 1.0, 0.0) / self.passive_strain
        return np.asarray(np.expm1(self.passive_shape * stretch) / np.expm1(self.passive_shape))


DE_GROOTE_BELLS = (  # height, centre, width at zero, growth of the width
    (0.8150671134243542, 1.055033428970575, 0.162384573599574, 0.063303448465465),
    (0.433004984392647, 0.716775413397760, -0.029947116970696, 0.200356847296188),
    (0.1, 1.0, 0.353553390593274, 0.0),
)
DE_GROOTE_SPEED = (-0.3211346127989808, -8.149, -0.374, 0.8825327733249912)


@dataclass(frozen=True)
class DeGrooteFreglyCurves:
    """The figures of OpenSim's DeGrooteFregly2016Muscle, its defaults; the curves are in the code of that class.

    The active curve is `width` times as wide as the published one. The passive force is that of full activity at
    `passive_strain` and zero at a length of 0.2; it is zero everywhere if not `has_passive_force`.
    """

    width: float = 1.0
    passive_strain: float = 0.6
    has_passive_force: bool = True
    shortest: ClassVar[float] = 0.0
    is_idle_when_shortest: ClassVar[bool] = True

    def active_force_length(self, length: Array, _codes: Codes | None = None) -> Array:
        """The sum of three bells of height, centre, and width that grows with the length."""
        x = (length - 1.0) / self.width + 1.0
        bells = [b1 * np.exp(-0.5 * ((x - b2) / (b3 + b4 * x)) ** 2) for b1, b2, b3, b4 in DE_GROOTE_BELLS]
        return np.asarray(np.sum(bells, axis=0))

    def force_velocity(self, speed: Array, _codes: Codes | None = None) -> Array:
        """Lengthening is positive; d₁ ln(y + √(y² + 1)) + d₄ at y = d₂ v + d₃, which is 1 at rest."""
        d1, d2, d3, d4 = DE_GROOTE_SPEED
        return np.asarray(d1 * np.arcsinh(d2 * speed + d3) + d4)

    def passive_force_length(self, length: Array, _codes: Codes | None = None) -> Array:
        if not self.has_passive_force:
            return np.zeros_like(length)
        shape, strain = 4.0, self.passive_strain
        foot = np.exp(shape * (0.2 - 1.0) / strain)
        return np.asarray((np.exp(shape * (length - 1.0) / strain) - foot) / (np.exp(shape) - foot))


_SCHUTTE_ACTIVE = simm_spline(
    np.array(
        [
            *(-5.307692, -4.307692, -1.923077, -0.884615, -0.269231, 0.230769, 0.461538, 0.52725, 0.62875, 0.71875),
            *(0.86125, 1.045, 1.2175, 1.43875, 1.5, 1.615385, 2.0, 2.961538, 3.692308, 5.461538, 9.901902),
        ]
    ),
    np.array(
        [
            *(0.012188, 0.021899, 0.036466, 0.052493, 0.075312, 0.114158, 0.157859, 0.226667, 0.636667, 0.856667),
            *(0.95, 0.993333, 0.77, 0.246667, 0.193821, 0.133252, 0.072683, 0.044417, 0.036341, 0.021899, 0.007332),
        ]
    ),
)


@dataclass(frozen=True)
class SchutteCurves:
    """Curves of OpenSim's Schutte1993Muscle_Deprecated: splines of the file over length, Hill's hyperbolas over speed.

    Without a passive curve in the file the passive force is an exponential of the length.
    """

    active: Function = _SCHUTTE_ACTIVE
    passive: Function | None = None
    shortest: ClassVar[float] = 0.0
    is_idle_when_shortest: ClassVar[bool] = True

    def active_force_length(self, length: Array, _codes: Codes | None = None) -> Array:
        return np.asarray(np.maximum(self.active.derivatives(length)[0], 0.0))

    def force_velocity(self, speed: Array, _codes: Codes | None = None) -> Array:
        """Lengthening is positive. The class solves these for the speed, with damping, which is left out."""
        shortening, lengthening = np.clip(speed, -1.0, 0.0), np.maximum(speed, 0.0)
        k, slope = 0.15, 0.13 * 0.15 / (0.15 + 1.0)
        return np.asarray(
            np.where(
                speed < 0.0,
                k * (1.0 + shortening) / (k - shortening),
                (slope + 1.4 * lengthening) / (slope + lengthening),
            )
        )

    def passive_force_length(self, length: Array, _codes: Codes | None = None) -> Array:
        return np.asarray(np.exp(8.0 * length - 12.0) if self.passive is None else self.passive.derivatives(length)[0])


Curves = MillardCurves | ThelenCurves | DeGrooteFreglyCurves | SchutteCurves

_PLATEAU = 0.05


@lru_cache(maxsize=256)
def _active_force_length(curves: MillardCurves) -> BezierChain:
    shortest, shallow, longest = curves.shortest, curves.transition, curves.longest
    slope, least = curves.shallow_slope, curves.minimum
    shoulder = 1.0 - _PLATEAU
    height = 1.0 - slope * (shoulder - shallow)
    return chain(
        (shortest, least, 0.0),
        ((shortest + shallow) / 2, height / 2, 1.25 * height / (shallow - shortest)),  # as if the minimum were zero
        ((shallow + shoulder) / 2, (height + 1.0) / 2, slope),
        (1.0, 1.0, 0.0),
        ((1.0 + _PLATEAU + longest) / 2, 0.5, -1.0 / (longest - 1.0 - 2 * _PLATEAU)),
        (longest, least, 0.0),
        curviness=(1.0,) * 5,
    )


@lru_cache(maxsize=256)
def _force_velocity(curves: MillardCurves) -> BezierChain:
    slow, near_slow = curves.concentric_slope, curves.near_concentric_slope
    fast, near_fast = curves.eccentric_slope, curves.near_eccentric_slope
    strongest = curves.strongest
    return chain(
        (-1.0, 0.0, slow),
        (-0.9, 0.05 * (near_slow + slow), near_slow),
        (0.0, 1.0, curves.isometric_slope),
        (0.9, strongest - 0.05 * (near_fast + fast), near_fast),
        (1.0, strongest, fast),
        curviness=(curves.concentric_curviness,) * 2 + (curves.eccentric_curviness,) * 2,
    )


@lru_cache(maxsize=256)
def _passive_force_length(curves: MillardCurves) -> BezierChain:
    start, end = 1.0 + curves.passive_start, 1.0 + curves.passive_end
    low, slope = curves.passive_low_slope, curves.passive_slope
    toe = min(0.1 / slope, 0.1 * (end - start))
    foot = (start + toe, low * toe / 2, low)
    return chain((start, 0.0, 0.0), foot, (end, 1.0, slope), curviness=(curves.passive_curviness,) * 2)


@dataclass(frozen=True)
class MillardTendon:
    """The figures of OpenSim's TendonForceLengthCurve, its defaults.

    strain     at a force of 1;  stiffness  slope there and beyond;  toe_force  where the toe ends
    """

    strain: float = 0.049
    stiffness: float = 1.375 / 0.049
    toe_force: float = 2.0 / 3.0
    curviness: float = 0.5

    @property
    def chain(self) -> BezierChain:
        return _millard_chain(self)

    def force(self, length: Array) -> Array:
        return evaluate(self.chain, length, None)


@dataclass(frozen=True)
class ThelenTendon:
    """An exponential up to `toe_force`, then a straight line to a force of 1 at the strain; zero if slack."""

    strain: float = 0.04
    toe_force: float = 0.33
    toe_shape: float = 3.0

    @property
    def toe_strain(self) -> float:
        """Strain at which both parts have the same slope (0.609 of the strain, as the paper rounds it)."""
        slope = self.toe_shape * self.toe_force * exp(self.toe_shape) / expm1(self.toe_shape)
        return self.strain * slope / (slope + 1.0 - self.toe_force)

    @property
    def stiffness(self) -> float:
        return (1.0 - self.toe_force) / (self.strain - self.toe_strain)

    def force(self, length: Array) -> Array:
        stretch = length - 1.0
        toe = np.expm1(self.toe_shape * np.clip(stretch, 0.0, self.toe_strain) / self.toe_strain)
        straight = self.stiffness * np.maximum(stretch - self.toe_strain, 0.0)
        return np.asarray(self.toe_force * toe / expm1(self.toe_shape) + straight)


@dataclass(frozen=True)
class DeGrooteFreglyTendon:
    """An exponential through 0 at slack length and 1 at the strain; a slack tendon pushes with up to 0.2."""

    strain: float = 0.049

    @property
    def shape(self) -> float:
        """k of 0.2 exp(k strain) − 0.2."""
        return log(6.0) / self.strain

    def force(self, length: Array) -> Array:
        return np.asarray(0.2 * np.expm1(self.shape * (length - 1.0)))


TendonCurve = MillardTendon | ThelenTendon | DeGrooteFreglyTendon


@lru_cache(maxsize=256)
def _millard_chain(tendon: MillardTendon) -> BezierChain:
    """From slack to the end of the toe, with a knot half-way up."""
    toe, stiffness = tendon.toe_force, tendon.stiffness
    end = 1.0 + tendon.strain - (1.0 - toe) / stiffness
    foot = 1.0 + (end - 1.0) / 10.0
    middle = 1.0 + tendon.strain - (1.0 - toe / 2) / stiffness
    slope = toe / 2 / (middle - foot)
    knot = (foot + middle) / 2, slope * (middle - foot) / 2, slope
    return chain((1.0, 0.0, 0.0), knot, (end, toe, stiffness), curviness=(tendon.curviness,) * 2)


@dataclass(frozen=True)
class Interval:
    """From low to high; brackets say which ends belong to it: "[)" is from low to below high."""

    low: float
    high: float = math.inf
    brackets: str = "()"

    def __contains__(self, value: float) -> bool:
        is_above = value >= self.low if self.brackets[0] == "[" else value > self.low
        return is_above and (value <= self.high if self.brackets[1] == "]" else value < self.high)

    def __str__(self) -> str:
        return f"{self.brackets[0]}{self.low:g}, {self.high:g}{self.brackets[1]}"


ABOVE_ZERO, FROM_ZERO = Interval(0.0), Interval(0.0, math.inf, "[)")
SHARE = Interval(0.0, 1.0, "[]")


@dataclass(frozen=True)
class Outside:
    """A figure outside its interval."""

    name: str
    interval: Interval
    value: float

    def __str__(self) -> str:
        return f"{self.name} in {self.interval} and has {self.value:g}"


def first_outside(owner: object, limits: Iterable[tuple[str, Interval]]) -> Outside | None:
    """The first of the owner's named figures that is outside its interval."""
    for name, interval in limits:
        value = getattr(owner, name)
        if value not in interval:
            return Outside(name, interval, value)
    return None


@lru_cache(maxsize=256)
def outside_of_curves(curves: Curves) -> Outside | None:
    """Kept, because muscles are made anew for every drawn person, with the same curves."""
    return first_outside(curves, _curve_limits(curves))


def _curve_limits(curves: Curves) -> Iterator[tuple[str, Interval]]:
    """Intervals of the figures. Those of later ones are computed from earlier ones, which have to be inside theirs."""
    if isinstance(curves, MillardCurves):
        yield from _active_limits(curves)
        yield from _speed_limits(curves)
        yield from _passive_limits(curves)
    elif isinstance(curves, ThelenCurves):
        yield from ((name, ABOVE_ZERO) for name in ("passive_strain", "active_shape", "passive_shape"))
        yield "velocity_shape", ABOVE_ZERO
        yield "strongest", Interval(1.0)
        yield "linear_beyond", Interval(1.0 / curves.strongest, 1.0)
    elif isinstance(curves, DeGrooteFreglyCurves):
        yield "width", Interval(1.0, math.inf, "[)")
        yield "passive_strain", ABOVE_ZERO


def _active_limits(curves: MillardCurves) -> Iterator[tuple[str, Interval]]:
    yield "transition", Interval(0.0, 1.0)
    yield "shortest", Interval(0.0, curves.transition, "[)")
    yield "longest", Interval(1.0)
    yield "minimum", Interval(0.0, 1.0, "[)")
    yield "shallow_slope", Interval(0.0, (1.0 - curves.minimum) / (1.0 - curves.transition), "[)")


def _speed_limits(curves: MillardCurves) -> Iterator[tuple[str, Interval]]:
    yield "strongest", Interval(1.0)
    yield "concentric_slope", Interval(0.0, 1.0, "[)")
    yield "near_concentric_slope", Interval(curves.concentric_slope, 1.0)
    yield "eccentric_slope", Interval(0.0, curves.strongest - 1.0, "[)")
    yield "near_eccentric_slope", Interval(max(curves.eccentric_slope, 1.5e-8), curves.strongest - 1.0, "[)")
    concentric_secant = (1.0 - 0.05 * (curves.concentric_slope + curves.near_concentric_slope)) / 0.9
    rise = curves.strongest - 1.0 - 0.05 * (curves.eccentric_slope + curves.near_eccentric_slope)
    yield "isometric_slope", Interval(max(1.0, concentric_secant, rise / 0.9))
    yield "concentric_curviness", SHARE
    yield "eccentric_curviness", SHARE


def _passive_limits(curves: MillardCurves) -> Iterator[tuple[str, Interval]]:
    yield "passive_end", Interval(curves.passive_start)
    strain = curves.passive_end - curves.passive_start
    yield "passive_low_slope", Interval(0.0, 1.0 / strain)
    toe = min(0.1 / max(curves.passive_slope, 1.0 / strain), 0.1 * strain)
    yield "passive_slope", Interval((1.0 - curves.passive_low_slope * toe / 2) / (strain - toe))
    yield "passive_curviness", SHARE


@dataclass(frozen=True, eq=False)
class BezierChain:
    """A chain of Bézier corners (X(s), Y(s)), s in [0, 1], with X increasing.

    corners  (corners, 2, 6) control points (x, y)
    nodes    (corners, intervals + 1) s at evenly spaced X of each corner, to start the search from
    """

    corners: Array
    nodes: Array


def chain(*knots: Knot, curviness: tuple[float, ...]) -> BezierChain:
    """The chain of corners between knots (x, y, slope)."""
    corners = np.array([_corner(a, b, c) for a, b, c in zip(knots[:-1], knots[1:], curviness, strict=True)])
    s, shares = np.linspace(0.0, 1.0, 4 * INTERVALS + 1), np.linspace(0.0, 1.0, INTERVALS + 1)
    nodes = [np.interp(x[0] + shares * (x[5] - x[0]), _bezier(x, s), s) for x in corners[:, 0]]
    return BezierChain(corners, np.array(nodes))


def evaluate(chain: BezierChain, x: Array, codes: Codes | None) -> Array:
    """y of the chain at x; beyond its ends a straight line with the end's slope. codes as in bezier.evaluate_chain."""
    from solver.functions.bezier import evaluate_chain  # the compiler behind it takes a third of a second to import

    values = np.array(x, dtype=float, order="C")
    codes = np.zeros(values.shape, np.int8) if codes is None else codes
    evaluate_chain(chain.corners, chain.nodes, values.reshape(-1), codes.reshape(-1))
    return values


def _corner(start: Knot, end: Knot, curviness: float) -> Array:
    """Six control points on the two end tangents; the inner ones are doubled, near where the tangents meet."""
    (x0, y0, slope0), (x1, y1, slope1) = start, end
    is_straight = abs(slope0 - slope1) <= np.sqrt(np.finfo(float).eps)
    x = (x0 + x1) / 2 if is_straight else (y1 - y0 - x1 * slope1 + x0 * slope0) / (slope0 - slope1)
    first, last, meet = np.array([x0, y0]), np.array([x1, y1]), np.array([x, (x - x1) * slope1 + y1])
    reach = 0.1 + 0.8 * curviness
    inner_first, inner_last = first + reach * (meet - first), last + reach * (meet - last)
    return np.column_stack([first, inner_first, inner_first, inner_last, inner_last, last])


def _bezier(p: Array, s: Array) -> Array:
    """Σ (5 over k) sᵏ (1 − s)⁵⁻ᵏ p_k, p (6, …)."""
    t = 1.0 - s
    ss, tt = s * s, t * t
    value: Array = tt * t * (tt * p[0] + 5.0 * s * t * p[1] + 10.0 * ss * p[2])
    value += ss * s * (10.0 * tt * p[3] + 5.0 * s * t * p[4] + ss * p[5])
    return value
