"""A suit whose cord meets the body where markers on its cuffs were seen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from solver.errors import SolverCode
from solver.model import Array, Model
from solver.multibody.postures import postures
from solver.suit.cord import cord_line
from solver.suit.suit import PARTS, Suit, SuitError, SuitMass, SuitPoint


@dataclass(frozen=True, eq=False)
class DigitisedSuit:
    """suit with the points that were seen; spread is the RMS distance [m] of each part's marker from its point."""

    suit: Suit
    spread: Mapping[str, float]


def suit_from_markers(suit: Suit, model: Model, coordinates: Array, observed: Array) -> DigitisedSuit:
    """Move the suit's points to where markers on waist, shoulder and arm were seen.

    coordinates (frames, coordinates) [rad or m] are the postures in which observed (frames, 3, 3) [m] in ground was
    recorded, NaN where a marker is hidden. A point is the mean of its marker in the body that the suit names for it;
    the mass follows it. Raises SuitError for a marker that is never seen.
    """
    state = postures(model, coordinates, np.zeros_like(coordinates))
    points, spread = {}, {}
    for place, part in enumerate(PARTS):
        body = model.body_index(getattr(suit, part).body)
        offset = observed[:, place] - state.origin_in_ground[:, body]
        in_body = np.einsum("fji,fj->fi", state.rotation_to_ground[:, body], offset)
        in_body = in_body[np.isfinite(in_body).all(axis=1)]
        if not len(in_body):
            raise SuitError(
                f"the marker on the suit's {part} is visible in no frame with a known posture; label it",
                SolverCode.POINT_NOT_SEEN,
            )
        points[part] = in_body.mean(axis=0)
        spread[part] = float(np.sqrt(((in_body - points[part]) ** 2).sum(axis=1).mean()))
    return DigitisedSuit(_with_points(suit, points), spread)


def fitted_to(suit: Suit, model: Model, posture: Array, pattern: tuple[Suit, Model, Array]) -> Suit:
    """The suit with rest lengths as long, relative to its cord's line, as those of the pattern.

    posture (coordinates,) is one of the model; pattern is another suit, its model, and the same posture of that body.
    """
    ratio = _line_length(suit, model, posture) / _line_length(*pattern)
    return replace(
        suit, rest_lengths=ratio * suit.rest_lengths, reference_rest_length=ratio * suit.reference_rest_length
    )


def _line_length(suit: Suit, model: Model, posture: Array) -> float:
    state = postures(model, posture[None], np.zeros((1, len(posture))))
    return float(cord_line(suit, model, state, 1.0).length[0])


def _with_points(suit: Suit, points: Mapping[str, Array]) -> Suit:
    moved = {part: SuitPoint(getattr(suit, part).body, location) for part, location in points.items()}
    masses = tuple(
        SuitMass(
            cuff_mass.body,
            cuff_mass.mass,
            cuff_mass.center + points[part] - getattr(suit, part).location,
            cuff_mass.inertia,
        )
        for part, cuff_mass in zip(PARTS, suit.masses, strict=False)
    )
    return replace(suit, waist=moved["waist"], shoulder=moved["shoulder"], arm=moved["arm"], masses=masses)
