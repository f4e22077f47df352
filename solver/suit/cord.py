"""Forces of a suit on the bodies: scenarios, cord tension and cuff displacement in all frames, and their effect on the
accelerations; comparison with a measured tension.

In every frame cord tension and cuff stiffness are in quasi-static equilibrium; the damping force of a cuff is added. A
migrated cuff has another rest position: closer to the shoulder along the line of pull, which slackens the cord by the
migration and does not move its line, or along the bone.

(6) to (9) are equations of the source study (docs/architecture.md).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from solver.cuff import CuffLaw, CuffParameters
from solver.errors import SolverCode
from solver.model import Array, Model
from solver.motion import Kinematics
from solver.multibody.dynamics import Response, response_to_loads
from solver.multibody.loads import LoadWrenches
from solver.multibody.postures import Postures, each_frame, points_in_ground, postures, rotate
from solver.redundancy.mechanics import Mechanics
from solver.redundancy.problem import LoadResponse
from solver.suit.suit import Rate, Suit, SuitError, SuitPoint

Cuffs = Sequence[CuffParameters | None]
Condition = Literal["rigid", "shift", "visco_elastic", "both"]
CUFF_CONDITIONS: tuple[Condition, ...] = ("shift", "visco_elastic", "both")

EQUILIBRIUM_RESIDUAL = 1e-9  # N
EQUILIBRIUM_STEP, MOST_STEPS = 1e-11, 50  # N; of Newton's method
MIGRATION_STEP = 1e-3  # m, of a central difference of the effort over migration
ALONG_THE_BONE = np.array([0.0, 1.0, 0.0])  # the long axis of humerus and thorax, and the axis of their cuffs


@dataclass(frozen=True, eq=False)
class SuitScenario:
    """The suit with these cuffs (None is a rigid one) in this condition, at each of some rest lengths (n,) [m].

    with_slopes  whether to solve the change of the effort with the migration of each cuff at the last rest length
    """

    condition: Condition
    waist: CuffParameters | None
    arm: CuffParameters | None
    rest_lengths: Array
    with_slopes: bool = False

    @property
    def cuffs(self) -> tuple[CuffParameters | None, CuffParameters | None]:
        return self.waist, self.arm

    @property
    def migrated(self) -> list[SuitScenario]:
        """The scenario at its last rest length with the waist cuff, then the arm cuff, migrated by MIGRATION_STEP less,
        then with both by as much more; none without slopes.
        """
        if not self.with_slopes or not self.is_shifted:
            return []
        cord = replace(self, rest_lengths=self.rest_lengths[-1:], with_slopes=False)
        found = []
        for step in (-MIGRATION_STEP, MIGRATION_STEP):
            waist, arm = (cuff and replace(cuff, migration=cuff.migration + step) for cuff in self.cuffs)
            found += [replace(cord, waist=waist)] if waist else []
            found += [replace(cord, arm=arm)] if arm else []
        return found

    @property
    def is_shifted(self) -> bool:
        return self.condition in {"shift", "both"}

    @property
    def yields(self) -> bool:
        return self.condition in {"visco_elastic", "both"}

    @property
    def migration(self) -> float:
        """Migration of both cuffs together in this condition [m]."""
        return sum(cuff.migration for cuff in self.cuffs if cuff and self.is_shifted)


@dataclass(frozen=True, eq=False)
class CordLine:
    """The cord over a motion, in ground [m], and the rotations of the bodies that carry the cuffs.

    anchors            (frames, 2, 3) waist and arm, cuffs unloaded and in place
    shoulder           (frames, 3); of a straight cord a point of it between the anchors, where no force acts
    anchors_to_ground  (frames, 2, 3, 3)
    interval           between frames [s]
    reach, direction   distance (frames, 2) [m] from the anchors to the shoulder, and its unit vector (frames, 2, 3)
    """

    anchors: Array
    shoulder: Array
    anchors_to_ground: Array
    interval: float
    reach: Array
    direction: Array

    @cached_property
    def length(self) -> Array:
        """Length (frames,) [m] with the cuffs in place."""
        return np.asarray(self.reach.sum(axis=1))


@dataclass(frozen=True, eq=False)
class SuitForces:
    """Forces of the suit on the bodies, in ground; the leading axis is the rest length.

    tension       (rest lengths, frames) of the cord [N];  largest_tension (rest lengths,) of all frames of the line
    displacement  (rest lengths, frames, 2, 3) of the waist and arm cuff from their rest position [m]
    points        (rest lengths, frames, 3, 3) waist, arm, shoulder [m]
    forces        (rest lengths, frames, 3, 3) on the body at each of them [N]
    """

    tension: Array
    largest_tension: Array
    displacement: Array
    points: Array
    forces: Array


def cord_line(suit: Suit, model: Model, postures: Postures, interval: float) -> CordLine:
    """The line of the cord in all postures; raises ModelError where a point's body is not in the model."""
    waist, shoulder, arm = (
        points_in_ground(postures, model.body_index(point.body), point.location)
        for point in (suit.waist, suit.shoulder, suit.arm)
    )
    holding = [model.body_index(suit.waist.body), model.body_index(suit.arm.body)]
    shoulder = 0.5 * (waist + arm) if suit.is_straight else shoulder
    rotations = postures.rotation_to_ground[:, holding]
    return line_between(np.stack([waist, arm], axis=1), shoulder, rotations, interval)


def line_between(anchors: Array, shoulder: Array, anchors_to_ground: Array, interval: float) -> CordLine:
    span = shoulder[:, None] - anchors
    reach = np.linalg.norm(span, axis=-1)
    return CordLine(anchors, shoulder, anchors_to_ground, interval, reach, span / reach[..., None])


def with_migration(suit: Suit, line: CordLine, cuffs: Cuffs) -> CordLine:
    """The cord after migration of the cuffs, None for a rigid one; only this function uses the migration direction.

    Raises SuitError for a migration beyond the shoulder point.
    """
    migration = np.array([cuff.migration if cuff else 0.0 for cuff in cuffs])
    if suit.migration_direction == "cord":
        _ensure_before_the_bend(suit, migration, line.reach.min(axis=0))
        anchors = line.anchors + migration[:, None] * line.direction
        if not suit.is_straight:
            return replace(line, anchors=anchors, reach=line.reach - migration)
    else:
        in_body = np.array([direction_to_joint(point) for point in (suit.waist, suit.arm)])
        anchors = line.anchors + migration[:, None] * rotate(line.anchors_to_ground, in_body)
    shoulder = anchors.mean(axis=1) if suit.is_straight else line.shoulder
    return line_between(anchors, shoulder, line.anchors_to_ground, line.interval)


def direction_to_joint(point: SuitPoint) -> Array:
    """Direction (3,) of migration along the bone, in its body: towards the body's origin."""
    return np.asarray(-np.sign(point.location @ ALONG_THE_BONE) * ALONG_THE_BONE)


def ensure_possible(cuff: CuffParameters, least_damping: float = 0.0) -> None:
    """Raise SuitError for a cuff that would generate energy, or has a figure that is not finite.

    It does with a stiffness of 0 or less, or a damping below the least [N s/m].
    """
    if not (np.isfinite(cuff.figures).all() and cuff.stiffness > 0 and cuff.damping >= least_damping):
        raise SuitError(
            f"the cuff {cuff.name} should have a stiffness above 0, a damping of 0 or more and a finite migration, and "
            f"has {cuff.stiffness:g} N/m, {cuff.damping:g} N s/m and {cuff.migration:g} m; fit it again, correct the "
            "figure, or leave it out",
            SolverCode.WRONG_CUFF,
        )


def suit_forces(
    suit: Suit,
    line: CordLine,
    rest_lengths: Array,
    cuffs: Cuffs = (None, None),
    *,
    is_shifted: bool = False,
    yields: bool = False,
    every: int = 1,
) -> SuitForces:
    """Forces of the suit, (7), at each rest length (rest lengths,) [m], in every N-th frame of the line.

    cuffs are those at waist and arm, None for a rigid one; is_shifted applies their migration, yields their compliance.
    Raises SuitError where a cuff has no positive stiffness, or no equilibrium in a frame.
    """
    for cuff in cuffs:
        if cuff:
            ensure_possible(cuff, least_damping=-np.inf)  # draws about a small damping are below 0, too
    rest = with_migration(suit, line, cuffs) if is_shifted else line
    laws = [cuff.law if cuff and yields else None for cuff in cuffs]
    _ensure_at_rest(rest.reach, suit.stiffness, float(rest_lengths.min()), laws)
    series, stiffness = _series_tension(rest.length, suit.stiffness, rest_lengths[:, None], laws)
    tension = _cord_tension(suit, rest.length - series * (1 / stiffness).sum(-1), rest_lengths[:, None], line.interval)
    chosen, direction = slice(None, None, every), rest.direction
    travel = series[..., None] / stiffness
    displacement = travel[:, chosen, :, None] * direction[chosen]
    pull = tension[:, chosen, None, None] * direction[chosen]
    held = [pull[..., i, :] for i in range(len(cuffs))]
    if yields:
        velocity = _velocity(suit, line, travel, direction, every)
        for i, law in enumerate(laws):
            if law:
                held[i] = law.force(displacement[..., i, :], velocity[..., i, :], axis=-1)
    shoulder = np.broadcast_to(line.shoulder[chosen], (*tension[:, chosen].shape, 3))
    return SuitForces(
        tension=tension[:, chosen],
        largest_tension=tension.max(axis=1),
        displacement=displacement,
        points=np.stack([*np.moveaxis(rest.anchors[chosen] + displacement, 2, 0), shoulder], axis=2),
        forces=np.stack([*held, -pull.sum(axis=2)], axis=2),
    )


def _velocity(suit: Suit, line: CordLine, travel: Array, direction: Array, every: int) -> Array:
    """Velocity of the cuffs relative to their bodies, in ground, from differences between neighbouring frames; (9)."""
    chosen = np.arange(0, len(line.shoulder), every)
    before = np.maximum(chosen - 1, 0)
    after = chosen if suit.rate == "backward" else np.minimum(chosen + 1, len(line.shoulder) - 1)

    def in_body(frames: NDArray[np.int64]) -> Array:
        return np.asarray(
            travel[:, frames, :, None] * rotate(np.swapaxes(line.anchors_to_ground[frames], 2, 3), direction[frames])
        )

    seconds = line.interval * np.maximum(after - before, 1)
    return rotate(line.anchors_to_ground[chosen], (in_body(after) - in_body(before)) / seconds[:, None, None])


def _ensure_before_the_bend(suit: Suit, migration: Array, reach: Array) -> None:
    """Migration and, of all frames the shortest, distance to the shoulder point, each (2,) [m] of waist and arm."""
    bend = "the middle of the cord" if suit.is_straight else f"the {suit.names['shoulder']} point"
    for part, slipped, nearest in zip(("waist", "arm"), migration, reach, strict=True):
        if slipped >= nearest:
            raise SuitError(
                f"the {suit.names[part]} cuff should slip by less than {nearest:.3g} m, its distance to {bend}, and "
                f"has a migration of {slipped:g} m; check it",
                SolverCode.CUFF_BEYOND_SHOULDER,
            )


def _series_tension(
    length: Array, cord_stiffness: float, rest_length: Array, laws: Sequence[CuffLaw | None]
) -> tuple[Array, Array]:
    """Tension T (rest lengths, frames) [N] with which both cuffs are in equilibrium, where k q = T, (8), and the secant
    stiffness (…, 2) of the cuffs under it, infinite for a rigid one.

    A cuff with the same stiffness in all directions moves along the cord, so cord and cuffs are springs in series:
    T = stretch / (1/k_cord + 1/k_waist + 1/k_arm). Energy is convex, so the equilibrium is unique. Newton's method
    finds it where a stiffness depends on T.
    """
    stretch = np.maximum(length - rest_length, 0.0)
    stiffness = _under(np.zeros_like(stretch), laws, CuffLaw.secant_under)
    tension: Array = _share(cord_stiffness, stiffness) * stretch
    for _ in range(MOST_STEPS):
        before, stiffness = stiffness, _under(tension, laws, CuffLaw.secant_under)
        if np.array_equal(stiffness, before):  # as of linear cuffs
            break
        left = stretch - tension / cord_stiffness - tension * (1 / stiffness).sum(-1)
        step = _share(cord_stiffness, _under(tension, laws, CuffLaw.tangent_under)) * left
        tension = np.maximum(tension + step, 0.0)
        if np.abs(step).max() <= EQUILIBRIUM_STEP:
            stiffness = _under(tension, laws, CuffLaw.secant_under)
            break
    return tension, stiffness


def _share(cord_stiffness: float, cuff_stiffness: Array) -> Array:
    """Stiffness of cord and cuffs (…, 2) in series [N/m]."""
    return np.asarray(cord_stiffness / (1 + cord_stiffness * (1 / cuff_stiffness).sum(-1)))


def _under(
    tension: Array, laws: Sequence[CuffLaw | None], stiffness: Callable[[CuffLaw, Array], float | Array]
) -> Array:
    """Stiffnesses (…, 2) of the cuffs under a tension, (2,) if they are linear; infinite for a rigid cuff."""
    found = [stiffness(law, tension) if law else np.inf for law in laws]
    shape = tension.shape if any(np.ndim(value) for value in found) else ()
    return np.stack([np.broadcast_to(value, shape) for value in found], axis=-1)


def _ensure_at_rest(reach: Array, cord_stiffness: float, shortest: float, laws: Sequence[CuffLaw | None]) -> None:
    """Raise SuitError where a cuff would be pulled beyond the shoulder point, at the shortest rest length first.

    reach (frames, 2) is the distance from the cuffs to the shoulder.
    """
    tension, stiffness = _series_tension(reach.sum(axis=1), cord_stiffness, np.array(shortest), laws)
    travel = tension[:, None] / stiffness
    left = reach - travel
    pull = cord_stiffness * np.maximum(np.abs(left).sum(axis=-1) - shortest, 0.0)
    residual = [
        np.copysign(pull, left[..., i]) - law.force(travel[..., i], np.zeros_like(pull))
        for i, law in enumerate(laws)
        if law
    ]
    largest = float(np.abs(residual).max(initial=0.0))
    if not largest < EQUILIBRIUM_RESIDUAL:
        softest = float(stiffness.min())
        raise SuitError(
            f"the cuffs should come to rest within {EQUILIBRIUM_RESIDUAL:g} N and {largest:.3g} N remain: one of "
            f"{softest:g} N/m is drawn beyond the bend or middle of the cord; check the cuffs and the rest lengths",
            SolverCode.CUFFS_NOT_AT_REST,
        )


def _cord_tension(suit: Suit, length: Array, rest_length: Array, interval: float) -> Array:
    """Spring and damper in parallel, (6); zero while the cord is slack, never negative."""
    stretch = length - rest_length
    tension: Array = suit.stiffness * np.maximum(stretch, 0.0)
    if suit.damping:
        rate = _rate(length, interval, suit.rate)
        tension = np.where(stretch > 0, np.maximum(tension + suit.damping * rate, 0.0), 0.0)
    return tension


def _rate(values: Array, interval: float, scheme: Rate) -> Array:
    """Rate of change over frames, values (rest lengths, frames, …); backward is zero in the first frame."""
    if scheme == "central":
        rate: Array = np.gradient(values, interval, axis=1)
        return rate
    return np.diff(values, axis=1, prepend=values[:, :1]) / interval


def per_unit_wrench(model: Model, suit: Suit, mechanics: Mechanics) -> Response:
    """Response maps to unit moments and forces on the bodies of waist, arm and shoulder, (frames, 18, …)."""
    bodies = [model.body_index(point.body) for point in (suit.waist, suit.arm, suit.shoulder)]
    count = 6 * len(bodies)
    units = np.broadcast_to(np.tile(np.eye(6), (len(bodies), 1)), (len(mechanics.kinematics.time), count, 6))
    wrenches = LoadWrenches(units, np.arange(count), np.repeat(bodies, 6), count, len(model.bodies))
    return response_to_loads(mechanics.equations, wrenches)


def response_to_wrenches(unit: Response, wrenches: Array) -> LoadResponse:
    """Response to wrenches (scenarios, frames, 18) on the bodies of waist, arm and shoulder, by per_unit_wrench."""
    return LoadResponse(
        acceleration=each_frame(np.swapaxes(unit.acceleration, 1, 2), wrenches),
        reaction=each_frame(np.swapaxes(unit.reaction, 1, 2), wrenches),
    )


@dataclass(frozen=True, eq=False)
class CordCheck:
    """Measured and predicted tension (frames,) [N] at time (frames,) [s].

    offset       measured less predicted, mean over the frames [N]: the load cell's zero is part of it
    rms          of the difference less the offset [N]
    correlation  of the two, NaN where one of them is constant
    """

    time: Array
    measured: Array
    predicted: Array
    offset: float
    rms: float
    correlation: float


def check_cord(
    suit: Suit,
    model: Model,
    kinematics: Kinematics,
    measured: Array,
    cuffs: Sequence[CuffParameters | None] = (None, None),
) -> CordCheck:
    """Compare the tension (frames,) [N] measured in the frames of a motion with that of the suit at its reference rest
    length; cuffs are those at waist and arm, None a rigid one, already migrated as far as they do.
    """
    state = postures(model, kinematics.positions, kinematics.speeds)
    forces = suit_forces(
        suit,
        cord_line(suit, model, state, kinematics.interval),
        np.array([suit.reference_rest_length]),
        cuffs,
        yields=any(cuff is not None for cuff in cuffs),
    )
    predicted = forces.tension[0]
    differing = measured - predicted
    offset = float(differing.mean())
    is_constant = np.ptp(measured) == 0.0 or np.ptp(predicted) == 0.0
    return CordCheck(
        kinematics.time,
        measured,
        predicted,
        offset,
        float(np.sqrt(np.mean((differing - offset) ** 2))),
        np.nan if is_constant else float(np.corrcoef(measured, predicted)[0, 1]),
    )
