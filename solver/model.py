"""The musculoskeletal model of the solver: frozen, in SI units, every reference an index.

Body 0 is the ground. So every body index is a valid row of the (frames, bodies, …) arrays, and a path point on the
ground needs no special case; the ground's pose is the identity, its mass, velocity and Jacobian are zero.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from documents.interval import counted
from solver.checks import freeze_arrays
from solver.constraint import Constraint as Constraint  # noqa: PLC0414 (part of the interface)
from solver.constraint import CoordinateCoupler as CoordinateCoupler  # noqa: PLC0414 (part of the interface)
from solver.constraint import CoordinateLock as CoordinateLock  # noqa: PLC0414 (part of the interface)
from solver.constraint import PointConstraint as PointConstraint  # noqa: PLC0414 (part of the interface)
from solver.errors import ModelError as ModelError  # noqa: PLC0414 (part of the interface)
from solver.errors import SolverCode
from solver.functions.coordinate_functions import Function
from solver.functions.muscle_curves import (
    ABOVE_ZERO,
    FROM_ZERO,
    Curves,
    Interval,
    TendonCurve,
    first_outside,
    outside_of_curves,
)

Array = NDArray[np.float64]

GROUND = 0
NO_COORDINATE = -1


@dataclass(frozen=True, eq=False)
class Body:
    """A rigid body: mass [kg], mass_center (3,) [m] in the body, inertia (3, 3) [kg m²] about the mass centre."""

    name: str
    mass: float
    mass_center: Array
    inertia: Array

    def __post_init__(self) -> None:
        freeze_arrays(self, mass_center=(3,), inertia=(3, 3))


@dataclass(frozen=True, eq=False)
class Placement:
    """Pose of a frame in a body: rotation (3, 3) turns frame vectors into body vectors, translation (3,) [m]."""

    rotation: Array
    translation: Array

    def __post_init__(self) -> None:
        freeze_arrays(self, rotation=(3, 3), translation=(3,))


@dataclass(frozen=True)
class Coordinate:
    """A generalised coordinate [rad or m] with its default value and range (lowest, highest), as in the model's file.

    Only inverse kinematics keeps a clamped coordinate within its range. The motion is "coupled" if the coordinate is
    neither an angle nor a distance, for example if it rotates and translates a joint at once.
    """

    name: str
    motion: Literal["rotation", "translation", "coupled"]
    default: float
    range: tuple[float, float]
    is_clamped: bool = False


@dataclass(frozen=True)
class Joint:
    """Joint between a frame in body `parent` and one in body `child`; parents come before their children."""

    name: str
    parent: int
    child: int
    frame_in_parent: Placement
    frame_in_child: Placement
    motion: Motion


@dataclass(frozen=True, eq=False)
class PathPoint:
    """A point of a path, location (3,) [m] in its body."""

    body: int
    location: Array

    def __post_init__(self) -> None:
        freeze_arrays(self, location=(3,))


@dataclass(frozen=True)
class MovingPathPoint:
    """A path point that a coordinate q moves in its body: to (f₁(q), f₂(q), f₃(q)) [m] in the frame `placement`.

    The location is that of q clamped to `range`; velocity and derivative are those of the unclamped q, as in OpenSim.
    """

    body: int
    placement: Placement
    coordinate: int
    functions: tuple[Function, Function, Function]
    range: tuple[float, float]


@dataclass(frozen=True, eq=False)
class ConditionalPathPoint:
    """A path point that is active while a coordinate is within `range`; location (3,) [m] in its body."""

    body: int
    location: Array
    coordinate: int
    range: tuple[float, float]

    def __post_init__(self) -> None:
        freeze_arrays(self, location=(3,))


AnyPathPoint = PathPoint | MovingPathPoint | ConditionalPathPoint


SurfaceKind = Literal["ellipsoid", "sphere", "cylinder", "torus"]


@dataclass(frozen=True, eq=False)
class WrapSurface:
    """A surface that paths wrap over, in its body.

    dimensions  (3,) [m]: ellipsoid: semi-axes; sphere: its radius three times; cylinder: radius, radius, length (its
                axis is the surface's z); torus: radius of its tube, radius of its ring (around the surface's z), 0
    quadrant    "all", or the side on which a path must stay: "+x", "-y", …
    is_active   whether paths wrap over it
    """

    name: str
    body: int
    placement: Placement
    kind: SurfaceKind
    dimensions: Array
    quadrant: str
    is_active: bool = True

    def __post_init__(self) -> None:
        freeze_arrays(self, dimensions=(3,))


@dataclass(frozen=True)
class PathWrap:
    """One surface (index into Model.surfaces) that a path may wrap over, and the method for ellipsoids.

    Only the segments between the path's points `first` and `last` (indices, both included; None is the end) may wrap.
    """

    surface: int
    method: Literal["hybrid", "midpoint", "axial"]
    first: int = 0
    last: int | None = None


@dataclass(frozen=True)
class Path:
    """A path from its first to its last point, and its surfaces in the order of the wrapping."""

    points: tuple[AnyPathPoint, ...]
    wraps: tuple[PathWrap, ...]


@dataclass(frozen=True)
class Muscle:
    """A muscle: N, m, rad, optimal fibre lengths per second, s.

    tendon          its force-length curve, for elastic tendons (solver/tendons); None for a tendon that stays rigid
    fiber_damping   damping force at the greatest velocity, over the greatest isometric force; with elastic tendons only
    min_control, max_control  limits of the activation in static optimisation
    activation_time_constant, deactivation_time_constant  0 for an activation that takes any value at once

    Raises ModelError for a figure, also of the curves, outside its limits.
    """

    name: str
    path: Path
    max_isometric_force: float
    optimal_fiber_length: float
    tendon_slack_length: float
    pennation_at_optimal: float
    maximum_pennation: float
    max_contraction_velocity: float
    activation_time_constant: float
    deactivation_time_constant: float
    curves: Curves
    tendon: TendonCurve | None = None
    fiber_damping: float = 0.0
    min_control: float = 0.0
    max_control: float = 1.0

    def __post_init__(self) -> None:
        outside = first_outside(self, MUSCLE_LIMITS.items()) or outside_of_curves(self.curves)
        if outside is not None:
            raise ModelError(f"muscle {self.name} should have {outside}; correct it", SolverCode.WRONG_MUSCLE)


MUSCLE_LIMITS: Mapping[str, Interval] = {
    "max_isometric_force": FROM_ZERO,
    "optimal_fiber_length": ABOVE_ZERO,
    "tendon_slack_length": FROM_ZERO,
    "max_contraction_velocity": ABOVE_ZERO,
    "activation_time_constant": Interval(0.0, np.inf, "[]"),
    "deactivation_time_constant": Interval(0.0, np.inf, "[]"),
    "fiber_damping": FROM_ZERO,
}
"""A time constant may be infinite: of an activation that does not fall."""


@dataclass(frozen=True)
class CoordinateActuator:
    """Generalised force on one coordinate: optimal_force [N or N m] times its control, within limits."""

    name: str
    coordinate: int
    optimal_force: float
    min_control: float = -np.inf
    max_control: float = np.inf


class ActuatorOnBodies(Protocol):
    """An actuator along a path, at a point or between bodies: solver/forces/actuators.py.

    Its load is its control, within limits, times full_loads: that at a control of 1, optimal_force [unit].
    """

    @property
    def name(self) -> str: ...
    @property
    def optimal_force(self) -> float: ...
    @property
    def min_control(self) -> float: ...
    @property
    def max_control(self) -> float: ...
    @property
    def unit(self) -> Literal["N", "N m"]: ...


Actuator = CoordinateActuator | ActuatorOnBodies


class CoordinateForce(Protocol):
    """Passive force on a coordinate, as of a spring: solver/forces/passive_forces.py."""

    @property
    def name(self) -> str: ...
    @property
    def coordinate(self) -> int: ...

    def at(self, q: Array, u: Array) -> Array:
        """(frames,) [N or N m] for values q (frames,) [rad or m] and speeds u (frames,) of the coordinate."""
        ...


class PassiveForce(Protocol):
    """A spring, ligament or contact between bodies: solver/forces, by multibody/loads.py."""

    @property
    def name(self) -> str: ...


@dataclass(frozen=True, eq=False)
class Marker:
    """A named point of a body, location (3,) [m] in it; a fixed marker is not moved by marker placement."""

    name: str
    body: int
    location: Array
    is_fixed: bool = False

    def __post_init__(self) -> None:
        freeze_arrays(self, location=(3,))


@dataclass(frozen=True, eq=False, repr=False)
class Model:
    """The musculoskeletal model of a person; gravity (3,) [m/s²] in ground. The order of each tuple is that of every
    array with such an axis: bodies (ground first), coordinates, muscles, then actuators behind the muscles in controls.
    forces are passive loads on its bodies. left_out names the parts of its file that are switched off or were ignored
    on request, lacking those of them whose loads act in OpenSim and are not known. unattached names the markers of its
    file on bodies that it lacks; they are not among markers. unused names what the files of its added actuators have
    and is not read.
    """

    name: str
    gravity: Array
    bodies: tuple[Body, ...]
    coordinates: tuple[Coordinate, ...]
    joints: tuple[Joint, ...]
    surfaces: tuple[WrapSurface, ...]
    muscles: tuple[Muscle, ...]
    constraints: tuple[Constraint, ...]
    actuators: tuple[Actuator, ...]
    markers: tuple[Marker, ...]
    coordinate_forces: tuple[CoordinateForce, ...] = ()
    forces: tuple[PassiveForce, ...] = ()
    left_out: tuple[str, ...] = ()
    lacking: tuple[str, ...] = ()
    unattached: tuple[str, ...] = ()
    unused: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        freeze_arrays(self, gravity=(3,))

    def __repr__(self) -> str:
        return (
            f"Model {self.name!r}: {len(self.bodies) - 1} bodies, {counted(len(self.coordinates), 'coordinate')}, "
            f"{counted(len(self.muscles), 'muscle')}, {counted(len(self.actuators), 'actuator')}, "
            f"{counted(len(self.markers), 'marker')}, "
            f"{counted(len(self.constraints), 'constraint')}"
        )

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        return tuple(coordinate.name for coordinate in self.coordinates)

    @property
    def muscle_names(self) -> tuple[str, ...]:
        return tuple(muscle.name for muscle in self.muscles)

    @property
    def actuated_names(self) -> tuple[str, ...]:
        """Names of the actuators in weights and figures: of the coordinate, or of the actuator if it acts on bodies."""
        return tuple(
            self.coordinates[actuator.coordinate].name if isinstance(actuator, CoordinateActuator) else actuator.name
            for actuator in self.actuators
        )

    @property
    def default_coordinates(self) -> Array:
        """(coordinates,) default values [rad or m]."""
        return np.array([coordinate.default for coordinate in self.coordinates])

    def body_index(self, name: str) -> int:
        return _index(self.bodies, name, "body", self.name)

    def coordinate_index(self, name: str) -> int:
        return _index(self.coordinates, name, "coordinate", self.name)

    def joint(self, name: str) -> Joint:
        return self.joints[_index(self.joints, name, "joint", self.name)]

    def marker(self, name: str) -> Marker:
        return self.markers[_index(self.markers, name, "marker", self.name)]


class _Named(Protocol):
    @property
    def name(self) -> str: ...


def _index(items: Sequence[_Named], name: str, kind: str, model: str) -> int:
    for index, item in enumerate(items):
        if item.name == name:
            return index
    known = ", ".join(item.name for item in items)
    raise ModelError(f"the model {model} has no {kind} {name}; it has {known}", SolverCode.UNKNOWN_NAME)


@dataclass(frozen=True, eq=False)
class AxisMotion:
    """Three rotations, then three translations, about or along axes of the parent frame.

    axes        (6, 3) unit vectors; rotations are successive and body-fixed, translations add up
    coordinate  (6,) index of the coordinate that drives the axis, or NO_COORDINATE
    functions   six functions of that coordinate: angle or distance [rad or m]; an undriven axis takes the value at 0
    """

    axes: Array
    coordinate: NDArray[np.int64]
    functions: tuple[Function, ...]

    def __post_init__(self) -> None:
        freeze_arrays(self, axes=(6, 3))
        coordinate = np.array(self.coordinate, dtype=np.int64)
        coordinate.flags.writeable = False
        object.__setattr__(self, "coordinate", coordinate)

    @property
    def coordinates(self) -> tuple[int, ...]:
        """Indices of the coordinates that drive axes, without repetition, in the order of the axes."""
        return tuple(dict.fromkeys(int(c) for c in self.coordinate if c != NO_COORDINATE))


@dataclass(frozen=True)
class BallMotion:
    """Any rotation, and any translation if there are `sliding` coordinates (a free joint).

    turning  indices of three body-fixed x-y-z angles; their speeds are the components of the angular velocity in the
             parent frame, not the rates of the angles
    sliding  none, or indices of the position x, y, z of the child frame in the parent frame
    """

    turning: tuple[int, int, int]
    sliding: tuple[int, int, int] | tuple[()]

    @property
    def coordinates(self) -> tuple[int, ...]:
        return (*self.turning, *self.sliding)


@dataclass(frozen=True, eq=False)
class ScapulothoracicMotion:
    """The scapula glides on an ellipsoid of the thorax and wings about an axis of the tangent plane.

    coordinates        indices of abduction, elevation, upward rotation, winging
    radii              (3,) semi-axes of the thoracic ellipsoid [m], in the order of OpenSim's property
    winging_origin     (2,) point of the winging axis in the tangent plane [m]
    winging_direction  angle of that axis in the plane [rad]
    """

    coordinates: tuple[int, int, int, int]
    radii: Array
    winging_origin: Array
    winging_direction: float

    def __post_init__(self) -> None:
        freeze_arrays(self, radii=(3,), winging_origin=(2,))

    @property
    def turning(self) -> tuple[int, ...]:
        """The three coordinates whose speeds are components of an angular velocity in the parent frame."""
        return self.coordinates[:3]


Motion = AxisMotion | BallMotion | ScapulothoracicMotion


def with_mass_ratios(model: Model, ratios: Mapping[str, float]) -> Model:
    """The model with bodies of these multiples of their masses and inertias, by name."""
    bodies = [(body, ratios.get(body.name, 1.0)) for body in model.bodies]
    return replace(model, bodies=tuple(replace(b, mass=k * b.mass, inertia=k * b.inertia) for b, k in bodies))


def with_point_mass(model: Model, body: str, mass: float, location: ArrayLike) -> Model:
    """The model with a point of `mass` [kg] fixed to a body at `location` (3,) [m] in it, say a cuff or a dumb-bell."""
    index = model.body_index(body)
    bare, point = model.bodies[index], np.asarray(location, dtype=float)
    total = bare.mass + mass
    mass_center = (bare.mass * bare.mass_center + mass * point) / total
    inertia = bare.inertia + _steiner(bare.mass, bare.mass_center - mass_center) + _steiner(mass, point - mass_center)
    loaded = Body(bare.name, total, mass_center, inertia)
    return replace(model, bodies=(*model.bodies[:index], loaded, *model.bodies[index + 1 :]))


def _steiner(mass: float, offset: Array) -> Array:
    """Inertia (3, 3) of a point mass at `offset` (3,) from the axis point (parallel-axis theorem)."""
    return mass * (offset @ offset * np.eye(3) - np.outer(offset, offset))
