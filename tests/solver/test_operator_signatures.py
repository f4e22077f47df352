"""Remembered signatures of operators are those that numba finds, and nothing is remembered that it did not find."""

from __future__ import annotations

import operator
from itertools import product
from types import SimpleNamespace
from typing import Any

import pytest
from numba.core import types as numba_types
from numba.core.registry import cpu_target

from solver.operator_signatures import FUNCTIONS, remember_signatures

types: Any = numba_types  # without types of its own

KINDS = (
    types.float64,
    types.int64,
    types.literal(2),
    types.Array(types.float64, 2, "C"),
    types.UniTuple(types.int64, 2),
)
UNARY = (operator.neg, operator.not_, abs, bool, len)


@pytest.fixture(scope="module")
def typing() -> Any:
    context: Any = cpu_target.typing_context
    context.refresh()
    remember_signatures(context)
    return context


@pytest.mark.parametrize("function", FUNCTIONS, ids=lambda function: function.__name__)
def test_they_are_those_that_numba_finds(typing: Any, function: Any) -> None:
    resolved = typing.resolve_value_type(function)
    arguments = 1 if function in UNARY else 3 if function is operator.setitem else 2
    count = 0
    for kinds in product(KINDS, repeat=arguments):
        try:
            expected = type(resolved).get_call_type(resolved, typing, kinds, {})
        except Exception as error:  # some implementations fail themselves with types that they do not expect
            with pytest.raises(type(error)):
                resolved.get_call_type(typing, kinds, {})
            continue
        assert resolved.get_call_type(typing, kinds, {}) == expected
        assert resolved.get_call_type(typing, list(kinds), {}) == expected
        count += 1
    assert count


def test_they_are_looked_up_once_unless_there_is_none() -> None:
    asked = []

    def find(_context: object, kinds: Any, _keywords: object) -> str:
        asked.append(tuple(kinds))
        if "none" in kinds:
            raise ValueError("no match")
        return f"signature of {kinds}"

    resolved = type("Resolved", (), {"get_call_type": staticmethod(find)})()
    typing = SimpleNamespace(resolve_value_type=lambda _: resolved)
    remember_signatures(typing)
    first, again = (resolved.get_call_type(typing, ("a", "b"), {}) for _ in range(2))
    assert first == again
    for _ in range(2):
        with pytest.raises(ValueError, match="no match"):
            resolved.get_call_type(typing, ("none",), {})
        resolved.get_call_type(typing, ("c",), {"key": "d"})
    assert asked == [("a", "b"), ("none",), ("c",), ("none",), ("c",)]
