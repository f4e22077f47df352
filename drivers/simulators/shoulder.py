"""Forward kinematics of a published shoulder as a product of exponentials (shoulder.toml).

The pose of a segment is T(q) = Π exp(ξᵢ qᵢ) T(0): ξᵢ are the screws of its joints in the posture where every coordinate
is 0, in the frame of ground (K. M. Lynch, F. C. Park, "Modern Robotics", Cambridge University Press, 2017, ch. 4). The
scapula's frame besides slides to the point of an ellipsoid whose normal it has (A. Seth et al., PLoS ONE 11(1),
e0141028, 2016). Metres and radians; ground is the model's: x forward, y up, z to the right.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.simulators.errors import SimulatorCode, SimulatorError
from drivers.simulators.markers import rotation_matrices

Floats = NDArray[np.float64]

SEGMENTS = ("thorax", "clavicle", "scapula", "humerus")
CLOSED_M = 1e-11
MOST_STEPS = 30
STEP_RAD = 1e-6


@dataclass(frozen=True)
class Screws:
    """Joint axes in the zero posture: turns about axes (m, 3) through points (m, 3), or slides along axes."""

    axes: Floats
    points: Floats
    is_turn: NDArray[np.bool_]

    def exponentials(self, amounts: Floats) -> Floats:
        """(n, m, 4, 4), for amounts (n, m) [rad or m]."""
        along = amounts[:, :, None] * self.axes
        moved = np.zeros((*amounts.shape, 4, 4))
        moved[..., :3, :3] = rotation_matrices(np.where(self.is_turn[:, None], along, 0.0))
        shifts = self.points - np.einsum("nmij,mj->nmi", moved[..., :3, :3], self.points)
        moved[..., :3, 3] = np.where(self.is_turn[:, None], shifts, along)
        moved[..., 3, 3] = 1.0
        return moved


@dataclass(frozen=True)
class _Segment:
    """The coordinates of a segment's joint, in order; home (4, 4) is its pose in the zero posture.

    joint (4, 4) is its joint's frame there, ellipsoid the semi-axes on which that frame glides by the first two turns.
    """

    on: str
    columns: tuple[int, ...]
    home: Floats
    joint: Floats
    ellipsoid: Floats | None


class Shoulder:
    """Thorax, clavicle, scapula and humerus of a table like shoulder.toml; coordinates (n, 15) are in the order of
    coordinate_names.
    """

    def __init__(self, table: Mapping[str, Any]) -> None:
        coordinates = [coordinate for name in SEGMENTS for coordinate in _coordinates(table[name])]
        self.coordinate_names: tuple[str, ...] = tuple(name for name, _, _ in coordinates)
        self.markers: dict[str, tuple[str, Floats]] = _points(table["markers"])
        self.cord: dict[str, tuple[str, Floats]] = _points(table["cord"])
        joined = table["acromioclavicular"]
        self._joined = np.array(joined["clavicle_m"]), np.array(joined["scapula_m"])
        self._segments: dict[str, _Segment] = {}
        for name in SEGMENTS:
            self._segments[name] = self._segment(table[name])
        joints = np.array([segment.joint for segment in self._segments.values() for _ in segment.columns])
        axes = _turned(joints[:, :3, :3], np.array([axis for _, axis, _ in coordinates], float))
        self._screws = Screws(axes, joints[:, :3, 3], np.array([is_turn for _, _, is_turn in coordinates]))

    def index(self, name: str) -> int:
        return self.coordinate_names.index(name)

    def poses(self, coordinates: Floats, segments: Sequence[str] = SEGMENTS) -> dict[str, Floats]:
        """transform_segment_to_ground (n, 4, 4) of segments, the first ones of SEGMENTS."""
        exponentials = self._screws.exponentials(coordinates)
        moved, poses = {"ground": np.tile(np.eye(4), (len(coordinates), 1, 1))}, {}
        for name in segments:
            segment = self._segments[name]
            pose = moved[segment.on]
            if segment.ellipsoid is not None:
                pose = pose @ _gliding(segment, coordinates)
            for column in segment.columns:
                pose = pose @ exponentials[:, column]
            moved[name] = pose
            poses[name] = pose @ segment.home
        return poses

    def places(self, coordinates: Floats, points: Sequence[tuple[str, Floats]]) -> Floats:
        """(n, points, 3) in ground, of points given by their segment and their place in it."""
        poses = self.poses(coordinates)
        return np.stack([_place(poses, point) for point in points], axis=1)

    def gap(self, coordinates: Floats) -> Floats:
        """(n, 3) in ground: from the clavicle's point of the acromioclavicular joint to the scapula's."""
        poses = self.poses(coordinates, ("thorax", "clavicle", "scapula"))
        clavicle, scapula = self._joined
        return _place(poses, ("scapula", scapula)) - _place(poses, ("clavicle", clavicle))

    def closed(self, coordinates: Floats, free: Sequence[str]) -> Floats:
        """The coordinates (n, 15) with the acromioclavicular joint closed by three or more of them, by Newton's method
        with the shortest steps.

        Raises SimulatorError where it does not converge.
        """
        columns, q = [self.index(name) for name in free], coordinates.copy()
        for _ in range(MOST_STEPS):
            gap = self.gap(q)
            if np.abs(gap).max() < CLOSED_M:
                return q
            nudged = np.tile(q, (len(columns), 1, 1))
            nudged[range(len(columns)), :, columns] += STEP_RAD
            nudged_gap = self.gap(nudged.reshape(-1, q.shape[1])).reshape(len(columns), *gap.shape)
            slope = np.moveaxis(nudged_gap - gap, 0, 2) / STEP_RAD
            q[:, columns] -= np.einsum("nij,nj->ni", np.linalg.pinv(slope), gap)
        raise SimulatorError(
            f"the simulated shoulder does not close: its joint stands open by {np.abs(gap).max():.2g} m",
            SimulatorCode.OPEN_JOINT,
        )

    def _segment(self, row: Mapping[str, Any]) -> _Segment:
        on = row.get("on", "ground")
        parent = self._segments[on].home if on in self._segments else np.eye(4)
        joint = parent @ _frame(row.get("origin_m"), row.get("angles_rad"))
        columns = tuple(self.index(name) for name, _, _ in _coordinates(row))
        home = joint @ np.linalg.inv(_frame(row.get("own_origin_m"), row.get("own_angles_rad")))
        ellipsoid = np.array(row["ellipsoid_m"]) if "ellipsoid_m" in row else None
        return _Segment(on, columns, home, joint, ellipsoid)


@cache
def published_shoulder() -> Shoulder:
    """The shoulder of shoulder.toml; it has no state."""
    return Shoulder(published_table())


def published_table() -> dict[str, Any]:
    """The content of shoulder.toml."""
    return tomllib.loads(Path(__file__).with_name("shoulder.toml").read_text(encoding="utf-8"))


def _gliding(segment: _Segment, coordinates: Floats) -> Floats:
    """(n, 4, 4) slide of the joint's frame to the point of the ellipsoid at longitude a and latitude e."""
    a, e = (coordinates[:, column] for column in segment.columns[:2])
    normal = np.stack([np.sin(a) * np.cos(e), np.sin(e), np.cos(a) * np.cos(e)], axis=1)
    slide = np.tile(np.eye(4), (len(coordinates), 1, 1))
    slide[:, :3, 3] = (normal * segment.ellipsoid) @ segment.joint[:3, :3].T
    return slide


def _place(poses: Mapping[str, Floats], point: tuple[str, Floats]) -> Floats:
    segment, place = point
    return np.asarray(poses[segment][:, :3, :3] @ place + poses[segment][:, :3, 3])


def _coordinates(row: Mapping[str, Any]) -> list[tuple[str, Sequence[float], bool]]:
    """Name and axis of every coordinate of a joint, in order, and whether it is a turn."""
    return [(name, axis, kind == "turns") for kind in ("slides", "turns") for name, axis in row.get(kind, ())]


def _points(table: Mapping[str, Mapping[str, Sequence[float]]]) -> dict[str, tuple[str, Floats]]:
    return {name: (segment, np.array(place)) for name, row in table.items() for segment, place in row.items()}


def _frame(origin: Sequence[float] | None, angles: Sequence[float] | None) -> Floats:
    frame = np.eye(4)
    frame[:3, 3] = origin or (0.0, 0.0, 0.0)
    about_x, about_y, about_z = rotation_matrices(np.diag(angles or (0.0, 0.0, 0.0)))
    frame[:3, :3] = about_x @ about_y @ about_z
    return frame


def _turned(frames: Floats, axes: Floats) -> Floats:
    """Unit vectors (m, 3) along axes (m, 3) of frames (m, 3, 3)."""
    turned = np.einsum("mij,mj->mi", frames, axes)
    return np.asarray(turned / np.linalg.norm(turned, axis=1, keepdims=True))
