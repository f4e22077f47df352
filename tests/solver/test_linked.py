"""Functions that only compiled code calls: the same figures as numba's own compiler gives, and no machine code."""

from __future__ import annotations

import gc
import tomllib
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numba import njit
from numba.core.errors import TypingError
from packaging.requirements import Requirement
from packaging.version import Version

from solver.compiled import compiled, compiled_for_python, compiled_with_allocation
from solver.linked import PrivateKernelCompiler


def test_the_newest_numba_that_may_be_installed_is_the_one_under_test() -> None:
    """The solver uses undocumented parts of numba, which any version may change."""
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    (declared,) = (Requirement(text) for text in project["dependencies"] if text.startswith("numba"))
    (limit,) = (Version(part.version) for part in declared.specifier if part.operator == "<")
    tested = Version(version("numba"))
    assert limit.release == (tested.major, tested.minor + 1), (
        f"numba {tested} is installed and pyproject.toml allows those below {limit}: if all other tests pass with the "
        "newest numba, set the limit to the next minor version; otherwise install the newest that is allowed"
    )


def _spread(x: Any, out: Any) -> float:
    total = 0.0
    for i in range(len(x)):
        out[i] = np.sin(x[i]) / (x[i] - x[0]) + np.sqrt(np.abs(x[i])) * x[i]
        total += out[i] * x[i]
    return total


def _kernel(inner: Any, outer: Any, **options: Any) -> Any:
    @outer
    def middle(x: Any, out: Any) -> float:
        return inner(x, out) / 3.0 + inner(x[::2], out)

    @njit(error_model="numpy", **options)
    def kernel(x: Any, out: Any) -> float:
        return middle(x, out)

    return kernel


def test_they_give_the_same_bits_as_the_compiler_s_own_way() -> None:
    plain: Any = njit(error_model="numpy")
    x = np.random.default_rng(3).normal(size=1001)
    outs = np.empty((3, len(x)))
    linked, usual = _kernel(compiled(_spread), compiled), _kernel(plain(_spread), plain)
    private = _kernel(compiled(_spread), compiled, pipeline_class=PrivateKernelCompiler)
    with np.errstate(all="ignore"):
        sums = np.array([linked(x, outs[0]), private(x, outs[1]), usual(x, outs[2])])
    assert outs[0].tobytes() == outs[1].tobytes() == outs[2].tobytes()
    assert sums[:1].tobytes() == sums[1:2].tobytes() == sums[2:].tobytes()
    assert np.isnan(outs[0, 0]) or np.isinf(outs[0, 0]), "a division by zero is no error"


def test_they_are_not_given_to_the_execution_engine() -> None:
    inner: Any = compiled(_spread)
    _kernel(inner, compiled)(np.ones(3), np.empty(3))
    for lowered in inner.overloads.values():
        library = lowered.library
        assert not library.codegen._engine.is_symbol_defined(lowered.fndesc.mangled_name)


def test_a_kernel_exports_only_its_own_entries() -> None:
    kernel = _kernel(compiled(_spread), compiled, pipeline_class=PrivateKernelCompiler)
    kernel(np.ones(3), np.empty(3))
    (lowered,) = kernel.overloads.values()
    exported = [f.name for f in lowered.library.get_defined_functions() if f.linkage.name != "private"]
    assert exported
    assert all("kernel" in name for name in exported)


def test_kernels_that_share_a_function_each_call_their_own() -> None:
    spread: Any = compiled(_spread)

    @compiled
    def several(x: Any, y: Any) -> float:  # so long that LLVM calls it instead of inlining it
        return float(spread(x, y) + spread(y, x) - spread(x[1:], y) + spread(y[1:], x) - spread(x[2:], y))

    def twice(x: Any, y: Any) -> float:
        return several(x, y) - several(y, x)

    kernels: list[Any] = [njit(twice, pipeline_class=PrivateKernelCompiler), njit(twice)]
    sums = np.array([kernel(np.linspace(1.0, 2.0, 7), np.linspace(3.0, 4.0, 7)) for kernel in kernels])
    assert sums[:1].tobytes() == sums[1:].tobytes()


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


def test_garbage_is_collected_again_after_a_kernel_that_cannot_be_compiled() -> None:
    kernel: Any = compiled_for_python(lambda x: x.there_is_no_such_attribute)
    assert gc.isenabled()
    with pytest.raises(TypingError):
        kernel(1.0)
    assert gc.isenabled()
