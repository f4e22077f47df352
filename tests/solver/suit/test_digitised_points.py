"""A suit fitted to a person by markers on its cuffs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from solver.bundled import bundled_model
from solver.errors import SolverCode
from solver.multibody.postures import points_in_ground, postures
from solver.raise_arm import simulate_arm_raise
from solver.scaling import Scaling, scale_model
from solver.suit.digitised_points import fitted_to, suit_from_markers
from solver.suit.suit import PARTS, SuitPoint, read_suit
from tests.refusals import raises_refusal

MODEL = bundled_model()
SUIT = read_suit()
POSTURES = simulate_arm_raise(MODEL).coordinates[::100]


def seen(suit):
    """Where the suit's points are in ground: (frames, 3, 3)."""
    state = postures(MODEL, POSTURES, np.zeros_like(POSTURES))
    points = (getattr(suit, part) for part in PARTS)
    return np.stack([points_in_ground(state, MODEL.body_index(p.body), p.location) for p in points], axis=1)


def test_the_points_come_back_with_the_noise_of_their_markers_and_masses_move_along():
    shift = {"waist": [0.01, -0.02, 0.0], "shoulder": [0.0, 0.03, 0.0], "arm": [0.0, 0.01, -0.01]}
    worn = replace(SUIT, **{p: SuitPoint(getattr(SUIT, p).body, getattr(SUIT, p).location + shift[p]) for p in PARTS})
    observed = seen(worn) + 1e-3 * np.random.default_rng(1).standard_normal((len(POSTURES), 3, 3))
    observed[0, 1] = np.nan
    found = suit_from_markers(SUIT, MODEL, POSTURES, observed)
    for place, part in enumerate(PARTS):
        np.testing.assert_allclose(getattr(found.suit, part).location, getattr(worn, part).location, atol=2.5e-3)
        assert 0.5e-3 < found.spread[part] < 3e-3
        moved = found.suit.masses[place].center - SUIT.masses[place].center
        np.testing.assert_allclose(moved, shift[part], atol=2.5e-3)


def test_a_marker_that_is_never_seen_is_refused_by_its_part():
    observed = seen(SUIT)
    observed[:, 2] = np.nan
    with raises_refusal(SolverCode.POINT_NOT_SEEN, naming="arm"):
        suit_from_markers(SUIT, MODEL, POSTURES, observed)


def test_rest_lengths_grow_with_a_body_that_is_larger_in_all_its_parts():
    bigger = scale_model(MODEL, Scaling({body.name: np.full(3, 1.1) for body in MODEL.bodies[1:]}))
    parts = {p: SuitPoint(getattr(SUIT, p).body, 1.1 * getattr(SUIT, p).location) for p in PARTS}
    posture = POSTURES[0].copy()
    grown = posture.copy()
    moves = [c.motion == "translation" for c in MODEL.coordinates]
    grown[moves] *= 1.1
    suit = fitted_to(replace(SUIT, **parts), bigger, grown, (SUIT, MODEL, posture))
    assert suit.reference_rest_length == pytest.approx(1.1 * SUIT.reference_rest_length, rel=1e-6)
    np.testing.assert_allclose(suit.rest_lengths, 1.1 * SUIT.rest_lengths, rtol=1e-6)
