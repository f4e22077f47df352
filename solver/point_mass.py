"""A mass that is fixed to a body: a cuff, or a dumb-bell in the hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from solver.model import Body, Model

Array = NDArray[np.float64]


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
