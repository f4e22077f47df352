"""A path's contact with a surface, as the compiled code keeps it."""

from __future__ import annotations

import numpy as np

from solver.compiled import compiled
from solver.geodesics.trace import normal_at, normal_curvature, trace_geodesic
from solver.vectors import Array, Vector, add, cross, read, subtract, turn, turn_back, write
from solver.wrapping.path_tables import Codes, Record

# One end of a contact in ground: the place, the path's direction t, the outward normal n and b = n × t; and the
# curvatures II(t, t), II(t, b), II(b, b) of the surface there [1/m].
END = np.dtype(
    [
        ("place", np.float64, (3,)),
        ("t", np.float64, (3,)),
        ("n", np.float64, (3,)),
        ("b", np.float64, (3,)),
        ("curvatures", np.float64, (3,)),
    ]
)

# The surface: its kind and dimensions as in WRAP, its pose in ground. The geodesic: in the surface's frame it leaves
# `start` in direction `heading` and is `length` long. From these follow both ends and the Jacobi scalars (trace.py). A
# surface is left out of a segment that it cannot or must not deflect.
CONTACT = np.dtype(
    [
        ("kind", np.int64),
        ("size", np.float64, (3,)),
        ("rotation", np.float64, (3, 3)),
        ("origin", np.float64, (3,)),
        ("start", np.float64, (3,)),
        ("heading", np.float64, (3,)),
        ("length", np.float64),
        ("first", END),
        ("last", END),
        ("jacobi", np.float64, (4,)),
        ("is_left_out", np.int64),
    ]
)


@compiled
def set_geodesic(
    contact: Record, start: Vector, heading: Vector, length: float, accuracy: float, series: Array, code: Codes
) -> None:
    """Set the geodesic of the contact and compute both ends; accuracy, series and code as in series.py."""
    kind, size = contact["kind"], read(contact["size"])
    write(contact["start"], start)
    write(contact["heading"], heading)
    contact["length"] = length
    end, direction, (a, r, da, dr) = trace_geodesic(kind, size, start, heading, length, accuracy, series, code)
    jacobi = contact["jacobi"]
    jacobi[0], jacobi[1], jacobi[2], jacobi[3] = a, r, da, dr
    _set_end(contact, contact["first"], start, heading)
    _set_end(contact, contact["last"], end, direction)


@compiled
def to_surface_frame(contact: Record, point: Vector) -> Vector:
    """A point of the ground in the surface's frame."""
    return turn_back(contact["rotation"], subtract(point, read(contact["origin"])))


@compiled
def _set_end(contact: Record, end: Record, x: Vector, t: Vector) -> None:
    kind, size, rotation = contact["kind"], read(contact["size"]), contact["rotation"]
    n = normal_at(kind, size, x)
    b = cross(n, t)
    write(end["place"], add(turn(rotation, x), read(contact["origin"])))
    write(end["t"], turn(rotation, t))
    write(end["n"], turn(rotation, n))
    write(end["b"], turn(rotation, b))
    curvatures = end["curvatures"]
    curvatures[0], curvatures[1] = normal_curvature(kind, size, x, t, t), normal_curvature(kind, size, x, t, b)
    curvatures[2] = normal_curvature(kind, size, x, b, b)
