"""Formulas in text: values by hand, and none that takes long."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from solver.errors import SolverCode
from solver.functions.coordinate_functions import (
    Expression,
    Function,
    Sine,
    natural_spline,
    piecewise_constant,
    piecewise_linear,
    polynomial,
    scaled,
    simm_spline,
    smooth_step,
)
from tests.refusals import raises_refusal

X = np.array([-2.1, -0.9, -0.2, 0.4, 0.7, 1.9])
Y = np.array([0.3, -0.2, 0.5, 0.4, -0.3, 0.2])
BETWEEN = np.linspace(-3.0, 3.0, 301) + 1e-3
FUNCTIONS = {
    "polynomial": polynomial([0.2, -0.5, 0.3, 0.1]),
    "lines": piecewise_linear(X, Y),
    "spline": simm_spline(X, Y),
    "natural": natural_spline(X, Y, 3),
    "step": smooth_step(-0.6, 0.9, 0.1, -0.4),
    "step down": smooth_step(0.9, -0.6, 0.1, -0.4),
    "sine": Sine(0.5, 1.7, 0.3, 0.1),
    "scaled sine": scaled(Sine(0.5, 1.7, 0.3, 0.1), -2.0),
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_slope_and_curvature_are_the_derivatives(name: str) -> None:
    function, step = FUNCTIONS[name], 1e-6
    away = BETWEEN[np.abs(BETWEEN[:, None] - np.array([*X, -0.6, 0.9])).min(axis=1) > 2 * step]
    _, slope, curvature = function.derivatives(away)
    before, after = function.derivatives(away - step), function.derivatives(away + step)
    assert np.allclose(slope, (after[0] - before[0]) / (2 * step), atol=1e-8)
    assert np.allclose(curvature, (after[1] - before[1]) / (2 * step), atol=1e-7)


@pytest.mark.parametrize(
    "function", [piecewise_linear(X, Y), simm_spline(X, Y), natural_spline(X, Y, 2), piecewise_constant(X, Y)]
)
def test_a_function_through_points_goes_through_them(function: Function) -> None:
    assert np.allclose(function.derivatives(X)[0], Y, atol=1e-14)


def test_a_cubic_natural_spline_is_the_textbook_one() -> None:
    inside = np.linspace(X[0], X[-1], 50)
    value, slope, curvature = natural_spline(X, Y, 2).derivatives(inside)
    textbook = CubicSpline(X, Y, bc_type="natural")
    for found, order in ((value, 0), (slope, 1), (curvature, 2)):
        assert np.allclose(found, textbook(inside, order), atol=1e-12)


def test_simm_splines_reproduce_a_cubic_and_are_straight_beyond_their_ends() -> None:
    cubic = polynomial([0.1, -0.4, 0.3, 0.2])
    spline = simm_spline(X, cubic.derivatives(X)[0])
    inside, beyond = np.linspace(X[0], X[-1], 40), np.array([-4.0, -3.0, 3.0, 4.0])
    assert np.allclose(spline.derivatives(inside)[:2], cubic.derivatives(inside)[:2], atol=1e-13)
    assert not spline.derivatives(beyond)[2].any()


def test_a_step_stays_at_its_ends() -> None:
    for start, end in ((-0.6, 0.9), (0.9, -0.6)):
        value, slope, curvature = smooth_step(start, end, 0.1, -0.4).derivatives(np.array([start, end, 2 * start]))
        assert np.allclose(value, [0.1, -0.4, 0.1], atol=1e-15)
        assert np.allclose([slope, curvature], 0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("formula", "value"),
    [("-2^2", -4.0), ("2^3^2", 512.0), ("6/2*3", 9.0), ("7-2-3", 2.0), ("k*x; k=m+1; m=2", 12.0), ("1/(x-4)", np.inf)],
)
def test_operators_bind_as_in_arithmetic(formula: str, value: float) -> None:
    np.testing.assert_array_equal(Expression(formula, ("x",)).at(np.full(2, 4.0)), [value, value])


def test_a_definition_is_evaluated_once_however_often_it_is_used() -> None:
    """Each definition doubles the next: inserted in place of their names they would be 2 to the power of 300 terms."""
    names = [f"v{index}" for index in range(300)]
    doubled = "; ".join(f"{name}={later}+{later}" for name, later in zip(names, [*names[1:], "x"], strict=True))
    value = Expression(f"v0*0.5^300; {doubled}", ("x",)).at(np.array([3.0]))
    np.testing.assert_allclose(value, 3.0)


def test_a_definition_serves_only_those_before_it() -> None:
    with raises_refusal(SolverCode.MODEL, naming="unknown variable b"):
        Expression("a; b=1; a=b", ("x",))
