"""The model that comes with the solver: the published thoracoscapular shoulder, read from thoracoscapular.toml.

The bundled motion: an arm raised in front of the body and lowered again, computed from a few figures.

No person was measured. The shoulder elevation follows minimum-jerk curves. Scapula and clavicle follow a rhythm that is
linear in the elevation; then these six coordinates change by the least sum of squares that closes the acromioclavicular
joint. Thorax and forearm stay at the default posture.
"""

from __future__ import annotations

import tomllib
from functools import cache, lru_cache
from importlib.resources import files
from typing import Any

import numpy as np

from solver.errors import MotionError, SolverCode
from solver.functions.coordinate_functions import polynomial
from solver.functions.muscle_curves import MillardCurves, MillardTendon
from solver.model import (
    NO_COORDINATE,
    AnyPathPoint,
    Array,
    AxisMotion,
    Body,
    Coordinate,
    CoordinateActuator,
    Joint,
    Marker,
    Model,
    MovingPathPoint,
    Muscle,
    Path,
    PathPoint,
    PathWrap,
    Placement,
    PointConstraint,
    ScapulothoracicMotion,
    WrapSurface,
)
from solver.motion import Motion
from solver.multibody.constraints import constraint_gaps
from solver.multibody.postures import postures, rotation_body_fixed_xyz

Table = dict[str, Any]


@cache  # a model is frozen
def bundled_model() -> Model:
    """The thoracoscapular model: 7 bodies, 17 coordinates, 33 muscles, 17 actuators; the table names the sources."""
    table = tomllib.loads(files("solver").joinpath("thoracoscapular.toml").read_text(encoding="utf-8"))
    return _TableReader(table).model()


class _TableReader:
    """Resolves names of the table to indices; the order of the table is that of the model."""

    def __init__(self, table: Table) -> None:
        self.table = table
        self.bodies = ["ground", *table["bodies"]]
        self.surfaces = list(table["surfaces"])
        self.coordinates: list[Coordinate] = []

    def model(self) -> Model:
        table = self.table
        joints = tuple(self.joint(name, row) for name, row in table["joints"].items())
        ground = Body("ground", 0.0, np.zeros(3), np.zeros((3, 3)))
        return Model(
            name=table["name"],
            gravity=np.array(table["gravity_m_s2"]),
            bodies=(ground, *(_body(name, row) for name, row in table["bodies"].items())),
            coordinates=tuple(self.coordinates),
            joints=joints,
            surfaces=tuple(self.surface(name, row) for name, row in table["surfaces"].items()),
            muscles=tuple(self.muscle(name, row) for name, row in table["muscles"].items()),
            constraints=tuple(self.constraint(name, row) for name, row in table["constraints"].items()),
            actuators=tuple(self.actuator(name, row) for name, row in table["actuators"].items()),
            markers=tuple(Marker(name, *self.station(row)) for name, row in table["markers"].items()),
        )

    def coordinate(self, name: str) -> int:
        return [coordinate.name for coordinate in self.coordinates].index(name)

    def station(self, row: Table) -> tuple[int, Array]:
        """The body and the point in it of a row such as { thorax = [x, y, z] }."""
        body = next(iter(row))
        return self.bodies.index(body), np.array(row[body])

    def joint(self, name: str, row: Table) -> Joint:
        motion = self.gliding(row) if "thoracic_ellipsoid_m" in row else self.axes(row)
        parent, child = self.bodies.index(row["parent"]), self.bodies.index(row["child"])
        in_parent, in_child = _placement(row.get("frame_in_parent", {})), _placement(row.get("frame_in_child", {}))
        return Joint(name, parent, child, in_parent, in_child, motion)

    def gliding(self, row: Table) -> ScapulothoracicMotion:
        abduction, elevation, upward_rotation, winging = (
            self.add_coordinate(name, "rotation", figures) for name, *figures in row["coordinates"]
        )
        return ScapulothoracicMotion(
            coordinates=(abduction, elevation, upward_rotation, winging),
            radii=np.array(row["thoracic_ellipsoid_m"]),
            winging_origin=np.array(row["winging_origin_m"]),
            winging_direction=row["winging_direction_rad"],
        )

    def axes(self, row: Table) -> AxisMotion:
        axes, driver = np.vstack([np.eye(3), np.eye(3)]), np.full(6, NO_COORDINATE)
        for first, motion in ((0, "rotation"), (3, "translation")):
            for index, (name, axis, *figures) in enumerate(row.get(f"{motion}s", []), start=first):
                axes[index] = np.array(axis) / np.linalg.norm(axis)
                driver[index] = self.add_coordinate(name, motion, figures)
        still, driven = polynomial([0.0]), polynomial([0.0, 1.0])
        return AxisMotion(axes, driver, tuple(still if d == NO_COORDINATE else driven for d in driver))

    def add_coordinate(self, name: str, motion: Any, figures: list[float]) -> int:
        default, lowest, highest = figures
        self.coordinates.append(Coordinate(name, motion, default, (lowest, highest)))
        return len(self.coordinates) - 1

    def surface(self, name: str, row: Table) -> WrapSurface:
        body, side = self.bodies.index(row["body"]), row.get("side", "all")
        if "ellipsoid_m" in row:
            return WrapSurface(name, body, _placement(row), "ellipsoid", np.array(row["ellipsoid_m"]), side)
        if "sphere_m" in row:
            return WrapSurface(name, body, _placement(row), "sphere", np.repeat(row["sphere_m"], 3), side)
        radius, length = row["cylinder_m"]
        return WrapSurface(name, body, _placement(row), "cylinder", np.array([radius, radius, length]), side)

    def muscle(self, name: str, row: Table) -> Muscle:
        shared, method = self.table["every_muscle"], row.get("wrap_method", "hybrid")
        return Muscle(
            name=name,
            path=Path(
                points=tuple(map(self.path_point, row["path"])),
                wraps=tuple(PathWrap(self.surfaces.index(surface), method) for surface in row.get("wraps", [])),
            ),
            max_isometric_force=row["max_isometric_force_n"],
            optimal_fiber_length=row["optimal_fiber_length_m"],
            tendon_slack_length=row["tendon_slack_length_m"],
            pennation_at_optimal=row.get("pennation_rad", 0.0),
            maximum_pennation=float(np.arccos(0.1)),
            max_contraction_velocity=shared["max_contraction_velocity_per_s"],
            activation_time_constant=shared["activation_time_constant_s"],
            deactivation_time_constant=shared["deactivation_time_constant_s"],
            curves=MillardCurves(minimum=0.0),
            tendon=None if row.get("has_rigid_tendon", False) else MillardTendon(),
            fiber_damping=shared["fiber_damping"],
            min_control=0.01,
        )

    def path_point(self, row: Table) -> AnyPathPoint:
        body, location = self.station(row)
        if "moves_with" not in row:
            return PathPoint(body, location)
        coordinate = self.coordinate(row["moves_with"])
        x, y, z = (polynomial(line) for line in zip(location, row["by_m_per_rad"], strict=True))
        return MovingPathPoint(body, _placement({}), coordinate, (x, y, z), self.coordinates[coordinate].range)

    def constraint(self, name: str, row: Table) -> PointConstraint:
        (body_1, location_1), (body_2, location_2) = row["points_m"].items()
        indices = self.bodies.index(body_1), self.bodies.index(body_2)
        return PointConstraint(name, *indices, np.array(location_1), np.array(location_2))

    def actuator(self, name: str, row: Table) -> CoordinateActuator:
        return CoordinateActuator(name, self.coordinate(row["coordinate"]), row["optimal_force"])


def _body(name: str, row: Table) -> Body:
    xx, yy, zz, xy, xz, yz = row["inertia_kg_m2"]
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return Body(name, row["mass_kg"], np.array(row["center_m"]), inertia)


def _placement(row: Table) -> Placement:
    angles = np.array(row.get("angles_rad", [0.0, 0.0, 0.0]))
    return Placement(rotation_body_fixed_xyz(angles), np.array(row.get("origin_m", [0.0, 0.0, 0.0])))


RATE = 100.0  # Hz
REST, RAISE, HOLD = 0.4, 2.4, 0.4  # s: before and after, up and down, on top
LOWEST, HIGHEST = 15.0, 100.0  # degrees of shoulder_elv

# degrees at the lowest and at the highest elevation
STEADY = {"plane_elv": 50.0, "axial_rot": -25.0}
RHYTHM = {
    "clav_prot": (-22.0, -36.0),
    "clav_elev": (-7.0, 6.0),
    "scapula_abduction": (-12.0, -2.0),
    "scapula_elevation": (-7.0, -5.0),
    "scapula_upward_rot": (11.0, 66.0),
    "scapula_winging": (6.0, -9.0),
}
CLOSED = 1e-10  # m
MOST_STEPS = 20


@lru_cache(maxsize=1)
def simulate_arm_raise(model: Model) -> Motion:
    """From 15° of elevation to 100° and back in 6 s at 100 Hz, acromioclavicular gap below 1e-10 m.

    The arrays are read-only: a second call for the same model returns the same motion. Raises ModelError where the
    model lacks one of these coordinates, MotionError where its joint does not close.
    """
    share = _share_of_elevation()
    coordinates = np.tile(model.default_coordinates, (len(share), 1))
    guided = {"shoulder_elv": (LOWEST, HIGHEST), **{name: (value, value) for name, value in STEADY.items()}, **RHYTHM}
    for name, (lowest, highest) in guided.items():
        coordinates[:, model.coordinate_index(name)] = np.radians(lowest + share * (highest - lowest))
    _close_joint(model, coordinates, [model.coordinate_index(name) for name in RHYTHM])
    time = np.arange(len(share)) / RATE
    for array in (time, coordinates):
        array.setflags(write=False)
    return Motion(model.coordinate_names, time, coordinates)


def _share_of_elevation() -> Array:
    """(frames,) from 0 to 1 and back by minimum-jerk curves, at rest at both ends and on top."""
    half = REST + RAISE + HOLD / 2
    time = np.arange(round(2 * half * RATE) + 1) / RATE
    s = np.clip((half - REST - np.abs(time - half)) / RAISE, 0.0, 1.0)
    return np.asarray(s**3 * (10 - 15 * s + 6 * s**2))


def _close_joint(model: Model, coordinates: Array, free: list[int]) -> None:
    """Gauss-Newton steps of least length, in place."""
    step = 1e-6
    for _ in range(MOST_STEPS):
        gap = _gap(model, coordinates)
        if np.abs(gap).max() <= CLOSED:
            return
        slope = np.empty((*gap.shape, len(free)))
        for column, coordinate in enumerate(free):
            moved = coordinates.copy()
            moved[:, coordinate] += step
            slope[..., column] = (_gap(model, moved) - gap) / step
        coordinates[:, free] -= np.einsum("fij,fj->fi", np.linalg.pinv(slope), gap)
    raise MotionError(
        f"the arm raise should close the joints of the model {model.name} within {CLOSED:g} m and leaves "
        f"{np.abs(gap).max():g} m; give a motion of your own for this model",
        SolverCode.OPEN_JOINT,
    )


def _gap(model: Model, coordinates: Array) -> Array:
    """(frames, 3 per constraint) [m] between the points that the model's constraints hold together."""
    state = postures(model, coordinates, np.zeros_like(coordinates))
    return constraint_gaps(model, state).reshape(len(coordinates), -1)
