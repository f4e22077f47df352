"""Options that are given in Python: what is misspelt is refused, because it would act as the default does."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from solver.bundled import bundled_model
from solver.errors import SolverCode
from solver.multibody.joint_reactions import ReactionRequest
from solver.redundancy.redundancy_options import RedundancyOptions, effort_weights
from tests.refusals import raises_refusal


@pytest.mark.parametrize(
    ("option", "value", "known"),
    [
        ("tendons", "Elastic", "'elastic'"),
        ("path_mode", "geodesics", "'geodesic'"),
        ("muscle_force_model", "passive", "'active'"),
        ("solver", "slsqp", "'clarabel'"),
        ("exponent", 4, "2 or 3"),
        ("glenoid_aspect", np.nan, "above 0"),
        ("glenoid_aspect", -0.5, "above 0"),
        ("free_coordinates", "plane_elv", "('plane_elv',)"),
        ("unweighted_coordinates", "elbow_flexion", "('elbow_flexion',)"),
    ],
)
def test_a_value_that_is_not_known_is_refused_with_those_that_are(option: str, value: Any, known: str) -> None:
    with raises_refusal(SolverCode.WRONG_OPTION, naming=option) as caught:
        RedundancyOptions(**{option: value})
    assert known in str(caught.value)


@pytest.mark.parametrize(("option", "value"), [("joints", "knee_r"), ("on", "parents"), ("axes", "world")])
def test_a_request_of_reactions_is_checked_alike(option: str, value: Any) -> None:
    with raises_refusal(SolverCode.WRONG_OPTION, naming=f"{option} is '{value}'"):
        ReactionRequest(**{option: value})


@pytest.mark.parametrize("weight", [-1.0, np.nan])
def test_a_weight_is_a_number_from_zero(weight: float) -> None:
    with raises_refusal(SolverCode.NEGATIVE_WEIGHT, naming=f"{weight:g}"):
        effort_weights(bundled_model(), RedundancyOptions(muscle_weight=weight))
