"""From a laboratory's frame to the model's ground: y up, and the person facing as the model does.

Only the turn about the vertical is free, so that gravity keeps its direction.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from solver.errors import SolverCode
from solver.inverse_kinematics.solve import assemble
from solver.model import Marker, Model, ModelError
from solver.multibody.postures import points_in_ground, postures

Array = NDArray[np.float64]
Vertical = Literal["x", "y", "z"]

TO_Y_UP: Final = {
    "x": np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
    "y": np.eye(3),
    "z": np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
}
"""Cyclic exchanges of axes by the laboratory's vertical one: (3, 3), laboratory vectors into vectors with y up."""


def rotation_laboratory_to_ground(
    model: Model, markers: Sequence[Marker], observed: Array, vertical: Vertical = "z"
) -> Array:
    """(3, 3) that turns laboratory vectors into vectors in the model's ground.

    observed (frames, markers, 3) [m] in the laboratory, NaN where a marker is hidden. The turn about the vertical is
    that in which the markers' mean places lie nearest to those of the model in its default posture (least squares).
    Raises ModelError where fewer than three of the markers are ever seen.
    """
    is_seen = np.isfinite(observed).all(axis=(2,)).any(axis=0)
    if is_seen.sum() < 3:
        raise ModelError(
            f"expected at least 3 of the markers {', '.join(marker.name for marker in markers)} and found "
            f"{int(is_seen.sum())}; label them",
            SolverCode.TOO_FEW_MARKERS,
        )
    posture = assemble(model)[None]
    state = postures(model, posture, np.zeros_like(posture))
    expected = np.array([points_in_ground(state, marker.body, marker.location)[0] for marker in markers])[is_seen]
    upright = np.nanmean(observed[:, is_seen], axis=0) @ TO_Y_UP[vertical].T
    expected, upright = expected - expected.mean(axis=0), upright - upright.mean(axis=0)
    along = (upright * expected)[:, [0, 2]].sum()
    across = (upright[:, 2] * expected[:, 0] - upright[:, 0] * expected[:, 2]).sum()
    angle = np.arctan2(across, along)
    cosine, sine = np.cos(angle), np.sin(angle)
    about_vertical = np.array([[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]])
    rotation: Array = about_vertical @ TO_Y_UP[vertical]
    return rotation
