"""Rows against finite differences of the gaps along a true motion, while the gaps stay closed in velocity."""

from dataclasses import replace

import numpy as np
import pytest

from solver.constraint import ConstantDistanceConstraint, CoordinatePrescription, PointOnLineConstraint, WeldConstraint
from solver.functions.coordinate_functions import Sine
from solver.model import Constraint, CoordinateCoupler, CoordinateLock, Model, PointConstraint
from solver.multibody.constraints import constraint_gaps, constraint_rows
from solver.multibody.postures import Postures, postures, rotate, rotation_body_fixed_xyz, speeds_from_rates
from tests.solver.linkage import linkage

LINKAGE = linkage()
RANDOM = np.random.default_rng(3)
Q = 0.4 * RANDOM.normal(size=(5, len(LINKAGE.coordinates)))
RATES, SECOND = RANDOM.normal(size=Q.shape), RANDOM.normal(size=Q.shape)
STEP = 1e-5

GEAR = Sine(0.5, 1.7, 0.3, 0.1)
COORDINATES: dict[str, Constraint] = {
    "a lock": CoordinateLock("lock", 6, 0.2),
    "a lock on a ball": CoordinateLock("lock", 9, 0.2),
    "a coupling": CoordinateCoupler("gear", dependent=7, independents=(6,), functions=(GEAR,)),
    "a coupling of two balls": CoordinateCoupler("gear", dependent=1, independents=(10,), functions=(GEAR,)),
}
COORDINATES["a coupling to several"] = CoordinateCoupler("gear", 7, (6, 10), (GEAR, Sine(0.7, 0.9, 0.1, 0.0)))
PLACES = np.array([0.1, 0.2, 0.3]), np.array([0.0, -0.2, 0.1])
TURNS = rotation_body_fixed_xyz([0.1, 0.4, -0.3]), rotation_body_fixed_xyz([-0.5, 0.2, 0.3])
BODIES: dict[str, Constraint] = {
    "a weld to the ground": WeldConstraint("weld", 0, 3, *PLACES, *TURNS),
    "a distance": ConstantDistanceConstraint("rod", 1, 3, *PLACES, 0.4),
    "a line of the ground": PointOnLineConstraint("rail", 0, 3, *PLACES, np.array([0.6, 0.0, 0.8])),
}
POINTS = PointConstraint("pin", 0, 3, *PLACES)
ALL = COORDINATES | BODIES | {"a pin to the ground": POINTS}


def _with(constraint: Constraint) -> Model:
    return replace(LINKAGE, constraints=(constraint,))


def _moving(model: Model, time: float) -> Postures:
    q, rates = Q + time * RATES + time**2 / 2 * SECOND, RATES + time * SECOND
    return postures(model, q, speeds_from_rates(model, q, rates), np.full(len(q), 0.7 + time))


@pytest.mark.parametrize("constraint", ALL.values(), ids=ALL)
def test_rows_and_bias_give_the_first_and_second_rate_of_the_gap(constraint: Constraint) -> None:
    model = _with(constraint)
    before, now, after = (_moving(model, time) for time in (-STEP, 0.0, STEP))
    rows, bias = constraint_rows(model, now)
    rate = (constraint_gaps(model, after) - constraint_gaps(model, before)) / (2 * STEP)
    assert np.allclose(rotate(rows, now.speeds), rate, atol=1e-8)
    rates = [rotate(constraint_rows(model, s)[0], s.speeds) for s in (before, after)]
    acceleration = (after.speeds - before.speeds) / (2 * STEP)
    assert np.allclose(rotate(rows, acceleration) + bias, (rates[1] - rates[0]) / (2 * STEP), atol=1e-7)


def test_row_and_bias_of_a_prescription_give_the_second_rate_of_its_gap() -> None:
    model = _with(CoordinatePrescription("rise", 8, GEAR))
    step = 1e-4
    before, now, after = (_moving(model, time) for time in (-step, 0.0, step))
    gaps = [constraint_gaps(model, state) for state in (before, now, after)]
    row, bias = constraint_rows(model, now)
    acceleration = (after.speeds - before.speeds) / (2 * step)
    assert np.array_equal(gaps[1][:, 0], Q[:, 8] - GEAR.derivatives(np.full(len(Q), 0.7))[0])
    np.testing.assert_allclose(rotate(row, acceleration) + bias, (gaps[2] - 2 * gaps[1] + gaps[0]) / step**2, atol=1e-6)


def test_rows_are_in_the_order_of_the_constraints() -> None:
    model = replace(LINKAGE, constraints=(COORDINATES["a lock"], POINTS, COORDINATES["a coupling"]))
    state = _moving(model, 0.0)
    rows, bias = constraint_rows(model, state)
    gaps = constraint_gaps(model, state)
    assert (rows.shape[1], bias.shape[1], gaps.shape[1]) == (5, 5, 5)
    assert np.array_equal(gaps[:, 0], Q[:, 6] - 0.2)
    assert np.array_equal(gaps[:, 4], GEAR.derivatives(Q[:, 6])[0] - Q[:, 7])


def test_a_model_without_constraints_has_no_rows() -> None:
    state = _moving(LINKAGE, 0.0)
    rows, bias = constraint_rows(LINKAGE, state)
    assert (rows.shape, bias.shape, constraint_gaps(LINKAGE, state).shape) == ((5, 0, 11), (5, 0), (5, 0))
