"""Formulas in text: values by hand, and none that takes long."""

from __future__ import annotations

import numpy as np
import pytest

from solver.errors import SolverCode
from solver.functions.expression import Expression
from tests.solver.refusals import raises_refusal


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
