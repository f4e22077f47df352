from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
import pytest

from solver.bundled import bundled_model
from solver.errors import SolverCode, describe_codes
from solver.model import GROUND, Body, Marker, with_point_mass
from solver.multibody.dynamics import equations_of_motion
from solver.multibody.postures import postures
from tests.refusals import raises_refusal

MODEL = bundled_model()


def test_the_ground_is_the_first_body_and_weighs_nothing() -> None:
    assert MODEL.body_index("ground") == GROUND
    assert MODEL.bodies[GROUND].mass == 0.0


def test_a_name_that_is_not_there_is_answered_with_those_that_are() -> None:
    with raises_refusal(SolverCode.UNKNOWN_NAME, naming="foot"):
        MODEL.body_index("foot")


def test_arrays_cannot_be_written() -> None:
    location = np.zeros(3)
    marker = Marker("here", GROUND, location)
    with pytest.raises(ValueError, match="read-only"):
        marker.location[0] = 1.0
    location[0] = 1.0
    assert marker.location[0] == 0.0


def test_an_array_of_the_wrong_shape_is_refused() -> None:
    with raises_refusal(SolverCode.WRONG_SHAPE, naming="Body.inertia"):
        Body("stick", 1.0, np.zeros(3), np.ones(3))


def test_a_point_mass_adds_its_kinetic_energy() -> None:
    location, mass = np.array([0.1, -0.2, 0.05]), 1.3
    loaded = with_point_mass(MODEL, "humerus", mass, location)
    random = np.random.default_rng(3)
    q = MODEL.default_coordinates + 0.2 * random.normal(size=(5, len(MODEL.coordinates)))
    u = random.normal(size=q.shape)
    state = postures(MODEL, q, u)
    humerus = MODEL.body_index("humerus")
    lever = state.rotation_to_ground[:, humerus] @ location
    velocity = state.origin_velocity[:, humerus] + np.cross(state.angular_velocity[:, humerus], lever)
    added = [
        np.einsum("fi,fij,fj->f", u, equations_of_motion(model, state).mass_matrix, u) / 2 for model in (loaded, MODEL)
    ]
    assert np.allclose(added[0] - added[1], mass * (velocity**2).sum(axis=1) / 2, rtol=1e-12)


# The part of a repr that lists the codes of findings.


class Code(StrEnum):
    LENGTH = "rest_length.best"
    MODEL = "model.left_out"


@dataclass(frozen=True)
class Found:
    code: Code
    figures: Mapping[str, float | str] = field(default_factory=dict)


def test_a_code_that_several_findings_have_is_listed_once() -> None:
    found = [Found(Code.LENGTH), Found(Code.MODEL), Found(Code.LENGTH)]
    assert describe_codes(found) == "; findings: rest_length.best, model.left_out"
    assert describe_codes([]) == ""
