"""Rows against finite differences of the gaps along a true motion, while the gaps stay closed in velocity."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from solver.functions.coordinate import Sine
from solver.model import Constraint, CoordinateCoupler, CoordinateLock, Model, PointConstraint
from solver.multibody.constraints import constraint_gaps, constraint_rows
from solver.multibody.postures import Postures, postures, speeds_from_rates
from solver.multibody.rotations import rotate
from tests.solver.linkage import linkage

Array = NDArray[np.float64]

LINKAGE = linkage()
RANDOM = np.random.default_rng(3)
Q = 0.4 * RANDOM.normal(size=(5, len(LINKAGE.coordinates)))
RATES, SECOND = RANDOM.normal(size=Q.shape), RANDOM.normal(size=Q.shape)
STEP = 1e-5

GEAR = Sine(0.5, 1.7, 0.3, 0.1)
COORDINATES: dict[str, Constraint] = {
    "a lock": CoordinateLock("lock", 6, 0.2),
    "a lock on a ball": CoordinateLock("lock", 9, 0.2),
    "a coupling": CoordinateCoupler("gear", dependent=7, independent=6, function=GEAR),
    "a coupling of two balls": CoordinateCoupler("gear", dependent=1, independent=10, function=GEAR),
}
POINTS = PointConstraint("pin", 0, 3, np.array([0.1, 0.2, 0.3]), np.array([0.0, -0.2, 0.1]))


def _with(constraint: Constraint) -> Model:
    return replace(LINKAGE, constraints=(constraint,))


def _moving(model: Model, time: float) -> Postures:
    q, rates = Q + time * RATES + time**2 / 2 * SECOND, RATES + time * SECOND
    return postures(model, q, speeds_from_rates(model, q, rates))


@pytest.mark.parametrize("constraint", [*COORDINATES.values(), POINTS], ids=[*COORDINATES, "a pin to the ground"])
def test_the_rows_give_the_rate_of_the_gap(constraint: Constraint) -> None:
    model = _with(constraint)
    before, now, after = (_moving(model, time) for time in (-STEP, 0.0, STEP))
    rate = (constraint_gaps(model, after) - constraint_gaps(model, before)) / (2 * STEP)
    rows, _ = constraint_rows(model, now)
    assert np.allclose(rotate(rows, now.speeds), rate, atol=1e-8)


@pytest.mark.parametrize("name", COORDINATES)
def test_rows_and_bias_give_the_second_rate_of_the_gap(name: str) -> None:
    model = _with(COORDINATES[name])
    before, now, after = (_moving(model, time) for time in (-STEP, 0.0, STEP))
    rates = [rotate(constraint_rows(model, s)[0], s.speeds) for s in (before, after)]
    rows, bias = constraint_rows(model, now)
    acceleration = (after.speeds - before.speeds) / (2 * STEP)
    assert np.allclose(rotate(rows, acceleration) + bias, (rates[1] - rates[0]) / (2 * STEP), atol=1e-7)


def test_rows_stand_in_the_order_of_the_constraints() -> None:
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
