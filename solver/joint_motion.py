"""How the coordinates of a joint move its child frame in its parent frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.frozen import freeze_arrays
from solver.functions.coordinate import Function

Array = NDArray[np.float64]

NO_COORDINATE = -1


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
