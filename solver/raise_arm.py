"""The bundled motion: an arm raised in front of the body and lowered again, computed from a few figures.

No person was measured. The shoulder elevation follows minimum-jerk curves. Scapula and clavicle follow a rhythm that is
linear in the elevation; then these six coordinates change by the least sum of squares that closes the acromioclavicular
joint. Thorax and forearm stay at the default posture.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from solver.errors import MotionError, SolverCode
from solver.model import Model
from solver.motion import Motion
from solver.multibody.constraints import constraint_gaps
from solver.multibody.postures import postures

Array = NDArray[np.float64]

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


def simulate_arm_raise(model: Model) -> Motion:
    """From 15° of elevation to 100° and back in 6 s at 100 Hz, acromioclavicular gap below 1e-10 m.

    Raises ModelError where the model lacks one of these coordinates, MotionError where its joint does not close.
    """
    share = _share_of_elevation()
    coordinates = np.tile(model.default_coordinates, (len(share), 1))
    guided = {"shoulder_elv": (LOWEST, HIGHEST), **{name: (value, value) for name, value in STEADY.items()}, **RHYTHM}
    for name, (lowest, highest) in guided.items():
        coordinates[:, model.coordinate_index(name)] = np.radians(lowest + share * (highest - lowest))
    _close_joint(model, coordinates, [model.coordinate_index(name) for name in RHYTHM])
    return Motion(model.coordinate_names, np.arange(len(share)) / RATE, coordinates)


def _share_of_elevation() -> Array:
    """(frames,) from 0 to 1 and back by minimum-jerk curves, at rest at both ends and on top."""
    half = REST + RAISE + HOLD / 2
    time = np.arange(round(2 * half * RATE) + 1) / RATE
    s = np.clip((half - REST - np.abs(time - half)) / RAISE, 0.0, 1.0)
    share: Array = s**3 * (10 - 15 * s + 6 * s**2)
    return share


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
