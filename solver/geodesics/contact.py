"""A path's contact with a surface, as the compiled code keeps it."""

from __future__ import annotations

import numpy as np

from solver.compiled import compiled
from solver.geodesics.series import Trace
from solver.geodesics.trace import normal_at, normal_curvatures, trace_geodesic
from solver.vectors import Array, Vector, add, cross, read, subtract, turn, turn_back, write
from solver.wrapping.path_tables import Codes, Record

# One end of a contact in ground: the place, the path's direction t, the outward normal n and b = n × t; the curvatures
# II(t, t), II(t, b), II(b, b) of the surface there [1/m]; and the Jacobi scalars (trace.py).
END = np.dtype(
    [
        ("place", np.float64, (3,)),
        ("t", np.float64, (3,)),
        ("n", np.float64, (3,)),
        ("b", np.float64, (3,)),
        ("curvatures", np.float64, (3,)),
        ("jacobi", np.float64, (4,)),
    ]
)

# The surface: its kind and dimensions as in WRAP, its pose in ground. The geodesic: in the surface's frame it passes
# `middle` in direction `heading`, and is `length` long; both ends follow from these. A surface is left out of a segment
# that it cannot or must not deflect.
CONTACT = np.dtype(
    [
        ("kind", np.int64),
        ("size", np.float64, (3,)),
        ("rotation", np.float64, (3, 3)),
        ("origin", np.float64, (3,)),
        ("middle", np.float64, (3,)),
        ("heading", np.float64, (3,)),
        ("length", np.float64),
        ("first", END),
        ("last", END),
        ("is_left_out", np.int64),
    ]
)


@compiled
def set_geodesic(
    contact: Record, middle: Vector, heading: Vector, length: float, accuracy: float, series: Array, code: Codes
) -> None:
    """Set the geodesic of the contact and compute both ends; accuracy, series and code as in series.py."""
    write(contact["middle"], middle)
    write(contact["heading"], heading)
    contact["length"] = length
    first, last = trace_geodesic(
        contact["kind"], read(contact["size"]), middle, heading, length, accuracy, series, code
    )
    _set_end(contact, contact["first"], first)
    _set_end(contact, contact["last"], last)


@compiled
def to_surface_frame(contact: Record, point: Vector) -> Vector:
    """A point of the ground in the surface's frame."""
    return turn_back(contact["rotation"], subtract(point, read(contact["origin"])))


@compiled
def _set_end(contact: Record, end: Record, trace: Trace) -> None:
    kind, size, rotation = contact["kind"], read(contact["size"]), contact["rotation"]
    x, t, jacobi = trace
    n = normal_at(kind, size, x)
    b = cross(n, t)
    write(end["place"], add(turn(rotation, x), read(contact["origin"])))
    write(end["t"], turn(rotation, t))
    write(end["n"], turn(rotation, n))
    write(end["b"], turn(rotation, b))
    write(end["curvatures"], normal_curvatures(kind, size, x, t, b))
    scalars = end["jacobi"]
    scalars[0], scalars[1], scalars[2], scalars[3] = jacobi
