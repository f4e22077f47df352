"""Functions that only compiled code calls: the same figures as numba's own compiler gives, and no machine code."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numba import njit

from solver.compiled import compiled, compiled_with_allocation


def _spread(x: Any, out: Any) -> float:
    total = 0.0
    for i in range(len(x)):
        out[i] = np.sin(x[i]) / (x[i] - x[0]) + np.sqrt(np.abs(x[i])) * x[i]
        total += out[i] * x[i]
    return total


def _kernel(inner: Any, outer: Any) -> Any:
    @outer
    def middle(x: Any, out: Any) -> float:
        return inner(x, out) / 3.0 + inner(x[::2], out)

    @njit(error_model="numpy")
    def kernel(x: Any, out: Any) -> float:
        return middle(x, out)

    return kernel


def test_they_give_the_same_bits_as_the_compiler_s_own_way() -> None:
    plain: Any = njit(error_model="numpy")
    x = np.random.default_rng(3).normal(size=1001)
    outs = np.empty((2, len(x)))
    linked, usual = _kernel(compiled(_spread), compiled), _kernel(plain(_spread), plain)
    with np.errstate(all="ignore"):
        sums = np.array([linked(x, outs[0]), usual(x, outs[1])])
    assert outs[0].tobytes() == outs[1].tobytes()
    assert sums[:1].tobytes() == sums[1:].tobytes()
    assert np.isnan(outs[0, 0]) or np.isinf(outs[0, 0]), "a division by zero is no error"


def test_they_are_not_given_to_the_execution_engine() -> None:
    inner: Any = compiled(_spread)
    _kernel(inner, compiled)(np.ones(3), np.empty(3))
    for lowered in inner.overloads.values():
        library = lowered.library
        assert not library.codegen._engine.is_symbol_defined(lowered.fndesc.mangled_name)


def test_constant_arguments_are_not_compiled_once_more() -> None:
    inner: Any = compiled(_power)

    @njit
    def kernel(x: float, exponent: int) -> float:
        return float(inner(x, 2) + inner(x, 3) + inner(x, exponent))

    assert kernel(2.0, 4) == 4.0 + 8.0 + 16.0
    assert len(inner.signatures) == 1


def _power(x: float, exponent: int) -> float:
    return float(x**exponent)


def test_a_function_without_counts_of_references_returns_no_array() -> None:
    def piece(x: Any) -> Any:
        return 1.0, x[1:]

    kernel = _kernel(compiled(lambda x, out: piece_of(x)[0]), compiled)
    piece_of: Any = compiled(piece)
    with pytest.raises(TypeError, match="piece returns an array"):
        kernel(np.ones(3), np.empty(3))


def test_an_array_allocated_by_an_inner_function_lives_in_the_kernel() -> None:
    @compiled_with_allocation
    def doubled(x: Any) -> Any:
        return 2.0 * x

    @njit(error_model="numpy")
    def kernel(x: Any) -> Any:
        return doubled(x)

    assert (kernel(np.ones(3)) == 2.0).all()
