"""numba while a kernel compiles: the same answers with less work, and as before afterwards."""

from __future__ import annotations

import gc
import math
import operator
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from numba.core import base, event, ir, lowering, postproc
from numba.core import types as numba_types
from numba.core.registry import cpu_target
from numba.core.typing import context

from solver.compiled import compiled_for_python
from solver.short_compilation import short_compilation

types: Any = numba_types  # without types of its own


def _replaceable() -> list[object]:
    owners = (postproc.PostProcessor, base.BaseContext, context.BaseContext, event, base, lowering)
    return [value for owner in owners for value in vars(owner).values() if callable(value)]


def test_numba_is_as_before_after_a_kernel() -> None:
    before = _replaceable()
    kernel: Any = compiled_for_python(lambda x: x[0] ** 2 + 1.0)
    assert kernel(np.array([3.0])) == 10.0
    assert _replaceable() == before


def test_constant_operands_have_the_types_that_numba_gives_them() -> None:
    operands = (2, True, "a", 2.0, ir.UNDEFINED)
    expected = [lowering._lit_or_omitted(operand) for operand in operands]
    with short_compilation(cpu_target.typing_context):
        assert [lowering._lit_or_omitted(operand) for operand in operands] == expected


def test_global_values_have_the_types_that_numba_gives_them() -> None:
    typing: Any = cpu_target.typing_context
    typing.refresh()
    values = (operator.add, math.sin, np.empty, len, abs, 2.0, (1, 2.0), float, np)
    expected = [typing.resolve_value_type(value) for value in values]
    with short_compilation(typing):
        assert [typing.resolve_value_type(value) for value in values] == expected
        with pytest.raises(ValueError, match="Cannot determine Numba type"):
            typing.resolve_value_type(object())


def test_no_array_is_converted_to_an_array() -> None:
    """Or numba would find an implementation where short_compilation says that there is none."""
    target: Any = cpu_target.target_context
    target.refresh()
    array = types.Array(types.float64, 2, "C")
    with pytest.raises(NotImplementedError):
        target.get_function("__array__", array(array))


def test_objects_of_the_compiler_are_collected_with_the_old_ones(unfrozen: None) -> None:
    gc.collect()
    with short_compilation(cpu_target.typing_context):
        cycle: list[object] = []
        cycle.append(cycle)
        number = id(cycle)
        del cycle
    assert gc.get_freeze_count() == 0
    assert number in map(id, gc.get_objects(generation=2))
    gc.collect()
    assert number not in map(id, gc.get_objects(generation=2))


def test_objects_that_others_have_frozen_stay_frozen(unfrozen: None) -> None:
    gc.freeze()
    frozen = gc.get_freeze_count()
    with short_compilation(cpu_target.typing_context):
        pass
    assert gc.get_freeze_count() == frozen > 0
    assert gc.isenabled()


@pytest.fixture
def unfrozen() -> Iterator[None]:
    """No frozen objects at the start; those of the test session are frozen again at the end."""
    gc.unfreeze()
    yield
    gc.freeze()
