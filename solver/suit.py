"""A passive suit worn by a model: a cord from the waist over the shoulder to the arm, on two cuffs that yield.

Per frame the cuffs find their quasi-static equilibrium, cord tension against cuff stiffness; the damping of a cuff acts
on the body besides. A cuff that has migrated rests nearer to the shoulder along the cord's line, so the cord is slacker
by that much. The waist cuff is anchored to the thorax: the model has no pelvis.
"""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solver.cuff import CuffParameters, cuff_force
from solver.kinematics import Postures, points_in_ground
from solver.model import Model, with_point_mass
from solver.spatial import rotate

Array = NDArray[np.float64]

PARTS = ("waist", "shoulder", "arm")
BUNDLED_SUIT = Path(__file__).with_name("suit.toml")
EQUILIBRIUM_RESIDUAL = 1e-9  # N
MOST_STEPS = 50


class SuitError(ValueError):
    """A suit that cannot be worn; its text is the sentence to show."""


@dataclass(frozen=True, eq=False)
class SuitPoint:
    """Where the cord meets the suit: location (3,) [m] in a body."""

    body: str
    location: Array


@dataclass(frozen=True, eq=False)
class WornMass:
    """A cuff as dead weight: mass [kg], center (3,) [m] in the body, inertia (3,) [kg m²] about it, body's axes."""

    body: str
    mass: float
    center: Array
    inertia: Array


@dataclass(frozen=True, eq=False)
class Suit:
    """Cord points, stiffness [N/m] and damping [N s/m], masses, and the rest lengths [m] to try and to refer to."""

    waist: SuitPoint
    shoulder: SuitPoint
    arm: SuitPoint
    stiffness: float
    damping: float
    masses: tuple[WornMass, ...]
    rest_lengths: Array
    reference_rest_length: float


@dataclass(frozen=True, eq=False)
class CordLine:
    """The cord over a motion, in ground [m], and the rotations of the bodies that the cuffs hold on to.

    anchors            (frames, 2, 3) waist and arm, cuffs unloaded and in place
    shoulder           (frames, 3)
    anchors_to_ground  (frames, 2, 3, 3)
    interval           between frames [s]
    """

    anchors: Array
    shoulder: Array
    anchors_to_ground: Array
    interval: float

    @property
    def length(self) -> Array:
        """Length (frames,) [m] with the cuffs in place."""
        length: Array = np.linalg.norm(self.shoulder[:, None] - self.anchors, axis=-1).sum(axis=-1)
        return length


@dataclass(frozen=True, eq=False)
class SuitForces:
    """What the suit does to the bodies, in ground; the leading axis follows the rest lengths.

    tension       (rest lengths, frames) of the cord [N]
    displacement  (rest lengths, frames, 2, 3) of the waist and arm cuff from where they rest [m]
    points        (rest lengths, frames, 3, 3) waist, arm, shoulder [m]
    forces        (rest lengths, frames, 3, 3) on the body at each of them [N]
    """

    tension: Array
    displacement: Array
    points: Array
    forces: Array


def read_suit(path: Path = BUNDLED_SUIT) -> Suit:
    """Read a suit.toml; raises SuitError naming the key that is missing, unknown or out of range."""
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise SuitError(f"{path} should be a suit in TOML and cannot be read ({error}); correct it") from error
    reference, lengths, cord, masses = _take(
        document, path.name, "reference_rest_length_m", "rest_lengths_m", "exotendon", "masses"
    )
    stiffness, damping, *points = _take(cord, "exotendon", "stiffness_n_per_m", "damping_n_s_per_m", *PARTS)
    waist, shoulder, arm = (_point(table, f"exotendon.{part}") for part, table in zip(PARTS, points, strict=True))
    worn = zip(PARTS, _take(masses, "masses", *PARTS), strict=True)
    return Suit(
        waist=waist,
        shoulder=shoulder,
        arm=arm,
        stiffness=_number(stiffness, "exotendon.stiffness_n_per_m"),
        damping=_number(damping, "exotendon.damping_n_s_per_m"),
        masses=tuple(_worn_mass(table, f"masses.{part}") for part, table in worn),
        rest_lengths=_rest_lengths(lengths),
        reference_rest_length=_number(reference, "reference_rest_length_m"),
    )


def with_suit_masses(model: Model, suit: Suit) -> Model:
    """The model with the suit's masses lumped into its bodies; the bare body stays as it is."""
    for worn in suit.masses:
        model = with_point_mass(model, worn.body, worn.mass, worn.center)
        index = model.body_index(worn.body)
        body = model.bodies[index]
        loaded = replace(body, inertia=body.inertia + np.diag(worn.inertia))
        model = replace(model, bodies=(*model.bodies[:index], loaded, *model.bodies[index + 1 :]))
    return model


def cord_line(suit: Suit, model: Model, postures: Postures, interval: float) -> CordLine:
    """Where the cord runs in each posture; raises ModelError where a point's body is not in the model."""
    waist, shoulder, arm = (
        points_in_ground(postures, model.body_index(point.body), point.location)
        for point in (suit.waist, suit.shoulder, suit.arm)
    )
    holding = [model.body_index(suit.waist.body), model.body_index(suit.arm.body)]
    return CordLine(
        anchors=np.stack([waist, arm], axis=1),
        shoulder=shoulder,
        anchors_to_ground=postures.rotation_to_ground[:, holding],
        interval=interval,
    )


def suit_forces(
    suit: Suit,
    line: CordLine,
    rest_lengths: Array,
    cuffs: Sequence[CuffParameters | None] = (None, None),
    *,
    is_shifted: bool = False,
    yields: bool = False,
) -> SuitForces:
    """Forces of the suit at each rest length (rest lengths,) [m].

    cuffs are those at waist and arm, None a rigid one; is_shifted moves them by their migration, yields lets them give
    way. The rates of cuffs and cord are backward differences, zero in the first frame, as published. Raises SuitError
    where a cuff is no spring or does not find its equilibrium.
    """
    _ensure_springs(cuffs)
    migration = np.array([cuff.migration if cuff and is_shifted else 0.0 for cuff in cuffs])
    stiffness = np.array([cuff.stiffness if cuff and yields else np.inf for cuff in cuffs])
    span = line.shoulder[:, None] - line.anchors
    rest = line.anchors + migration[:, None] * span / np.linalg.norm(span, axis=-1, keepdims=True)
    displacement = _equilibrium(line.shoulder[:, None] - rest, suit.stiffness, rest_lengths[:, None], stiffness)
    points = rest + displacement
    span = line.shoulder[:, None] - points
    reach = np.linalg.norm(span, axis=-1)
    tension = _cord_tension(suit, reach.sum(axis=-1), rest_lengths[:, None], line.interval)
    pull = tension[..., None, None] * span / reach[..., None]
    in_body = rotate(np.swapaxes(line.anchors_to_ground, -1, -2), displacement)
    rate = rotate(line.anchors_to_ground, _backward_rate(in_body, line.interval))
    held = [
        cuff_force(cuff.stiffness, cuff.damping, displacement[..., i, :], rate[..., i, :])
        if cuff and yields
        else pull[..., i, :]
        for i, cuff in enumerate(cuffs)
    ]
    return SuitForces(
        tension=tension,
        displacement=displacement,
        points=np.stack([*np.moveaxis(points, -2, 0), np.broadcast_to(line.shoulder, held[0].shape)], axis=-2),
        forces=np.stack([*held, -pull.sum(axis=-2)], axis=-2),
    )


def _point(table: Any, where: str) -> SuitPoint:
    body, location = _take(table, where, "body", "point_m")
    return SuitPoint(str(body), _vector(location, f"{where}.point_m"))


def _worn_mass(table: Any, where: str) -> WornMass:
    body, mass, center, inertia = _take(table, where, "body", "mass_kg", "center_m", "inertia_kg_m2")
    return WornMass(
        body=str(body),
        mass=_number(mass, f"{where}.mass_kg"),
        center=_vector(center, f"{where}.center_m"),
        inertia=_vector(inertia, f"{where}.inertia_kg_m2"),
    )


def _rest_lengths(table: Any) -> Array:
    first, last, count = (
        _number(value, "rest_lengths_m") for value in _take(table, "rest_lengths_m", "first", "last", "count")
    )
    if not 0 < first < last or count < 5 or count % 1:
        raise SuitError(
            f"the suit's rest_lengths_m should be 5 or more, rising from above 0, and are {count:g} from {first:g} to "
            f"{last:g} m; correct it"
        )
    return np.linspace(first, last, int(count))


def _take(table: Any, where: str, *keys: str) -> list[Any]:
    """The values of exactly these keys, in this order."""
    if not isinstance(table, dict):
        raise SuitError(f"the suit's {where} should be a table with {', '.join(keys)} and is {table!r}; correct it")
    missing, unknown = [key for key in keys if key not in table], [key for key in table if key not in keys]
    if missing or unknown:
        fault = f"lacks {', '.join(missing)}" if missing else f"has an unknown {', '.join(unknown)}"
        raise SuitError(f"the suit's {where} should have {', '.join(keys)} and {fault}; correct it")
    return [table[key] for key in keys]


def _number(value: Any, where: str) -> float:
    if not isinstance(value, int | float) or not 0 <= value < np.inf:
        raise SuitError(f"the suit's {where} should be a number that is not negative and is {value!r}; correct it")
    return float(value)


def _vector(value: Any, where: str) -> Array:
    if not (isinstance(value, list) and len(value) == 3 and all(isinstance(v, int | float) for v in value)):
        raise SuitError(f"the suit's {where} should be three numbers and is {value!r}; correct it")
    return np.array(value, dtype=float)


def _ensure_springs(cuffs: Sequence[CuffParameters | None]) -> None:
    for cuff in cuffs:
        if cuff and not (0 < cuff.stiffness < np.inf and np.isfinite([cuff.damping, cuff.migration]).all()):
            raise SuitError(
                f"the cuff {cuff.name} should have a stiffness above 0 and finite damping and migration and has "
                f"{cuff.stiffness:g} N/m, {cuff.damping:g} N s/m and {cuff.migration:g} m; fit it again or leave it out"
            )


def _equilibrium(span: Array, cord_stiffness: float, rest_length: Array, cuff_stiffness: Array) -> Array:
    """Displacements q (rest lengths, frames, 2, 3) where k q = T d for both cuffs, by Newton's method.

    span (frames, 2, 3) runs from the resting cuffs to the shoulder; T = k_cord max(Σ |span − q| − rest length, 0) pulls
    along d. Energy is convex, so the equilibrium is unique; its second derivative is, while the cord is taut,
    k_cord d dᵀ over both cuffs plus T (1 − d dᵀ) / |span − q| + k for each.
    """
    is_rigid = np.isinf(cuff_stiffness)
    k = np.where(is_rigid, 1.0, cuff_stiffness)  # with d = 0 below, a rigid cuff's equation becomes q = 0
    q = np.zeros((len(rest_length), *span.shape))
    for _ in range(MOST_STEPS):
        reach = np.linalg.norm(span - q, axis=-1, keepdims=True)
        d = np.where(is_rigid[:, None], 0.0, (span - q) / reach)
        tension = cord_stiffness * np.maximum(reach.sum(axis=-2) - rest_length[..., None], 0.0)[..., None]
        residual = tension * d - k[:, None] * q
        if np.abs(residual).max(initial=0.0) < EQUILIBRIUM_RESIDUAL:
            return q
        along = d.reshape(*q.shape[:2], 6)
        slope = cord_stiffness * (tension > 0) * along[..., :, None] * along[..., None, :]
        own = (tension / reach)[..., None] * (np.eye(3) - d[..., :, None] * d[..., None, :]) + k[
            :, None, None
        ] * np.eye(3)
        slope[..., :3, :3] += own[..., 0, :, :]
        slope[..., 3:, 3:] += own[..., 1, :, :]
        q += np.linalg.solve(slope, residual.reshape(*q.shape[:2], 6, 1)).reshape(q.shape)
    raise SuitError(
        f"the cuffs should come to rest within {EQUILIBRIUM_RESIDUAL:g} N and {np.abs(residual).max():g} N remain "
        f"after {MOST_STEPS} steps; check the cuffs' stiffness"
    )


def _cord_tension(suit: Suit, length: Array, rest_length: Array, interval: float) -> Array:
    """A spring and a damper that pull while the cord is taut and never push."""
    stretch = length - rest_length
    rate = _backward_rate(length[..., None, None], interval)[..., 0, 0]
    taut: Array = np.where(stretch > 0, np.maximum(suit.stiffness * stretch + suit.damping * rate, 0.0), 0.0)
    return taut


def _backward_rate(values: Array, interval: float) -> Array:
    """Backward difference over frames, values (rest lengths, frames, …); zero in the first frame."""
    return np.diff(values, axis=1, prepend=values[:, :1]) / interval
