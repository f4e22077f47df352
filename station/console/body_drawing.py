"""The body of the live page, drawn as lines in millimetres: bones, muscles, cord."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from solver.drawing import bone_lines, path_lines, skeleton
from solver.errors import SolverError
from solver.model import Array, Model
from solver.multibody.postures import points_in_ground, postures
from solver.suit.suit import Suit
from station.live.published import LiveSetup
from station.sources import drawn_body

MM = 1e3


def prepare_drawing(setup: LiveSetup) -> tuple[BodyDrawing | None, Suit | None]:
    """The drawing of the body, with its kernels loaded; None for a model that this station cannot read."""
    try:
        model, suit = drawn_body(setup.subject.model_osim, setup.suit_toml)
        drawing = BodyDrawing(model, suit)
        drawing.lines(model.default_coordinates.tolist())
    except SolverError:
        return None, None
    return drawing, suit


class BodyDrawing:
    """suit is None without one. The first lines load the compiled kernels, which takes a second or more."""

    def __init__(self, model: Model, suit: Suit | None) -> None:
        self._model, self._suit = model, suit
        self._bones = skeleton(model)

    def lines(self, coordinates: Sequence[float]) -> dict[str, Any]:
        """Bones with their kind, muscles in the order of the model, and the cord (no points without a suit).

        coordinates (coordinates,) [rad or m] in the order of the model, finite. Points are x, y, z [mm] in ground.
        """
        q = np.array(coordinates, dtype=float)[None]
        state = postures(self._model, q, np.zeros_like(q))
        bones = zip(self._bones, bone_lines(self._bones, state), strict=True)
        suit = self._suit
        parts = () if suit is None else suit.line
        cord = [points_in_ground(state, self._model.body_index(part.body), part.location)[0] for part in parts]
        return {
            "bones": [[bone.kind, _in_mm(line[0])] for bone, line in bones],
            "muscles": [_in_mm(line) for line in path_lines(self._model, state)[0]],
            "cord": _in_mm(np.array(cord).reshape(-1, 3)),
        }


def _in_mm(points: Array) -> list[list[int]]:
    rounded: list[list[int]] = np.rint(MM * points).astype(int).tolist()
    return rounded
