"""Functions that only compiled code calls: the same figures as numba's own compiler gives, and no machine code.

numba while a kernel compiles: the same answers with less work, and as before afterwards.

Remembered signatures of operators are those that numba finds, and nothing is remembered that it did not find.
"""

import gc
import math
import operator
import tomllib
from collections.abc import Iterator
from importlib.metadata import version
from itertools import product
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numba import njit
from numba.core import base, event, ir, lowering, postproc
from numba.core import types as numba_types
from numba.core.errors import TypingError
from numba.core.registry import cpu_target
from numba.core.typing import context
from packaging.requirements import Requirement
from packaging.version import Version

from solver.compiled import compiled, compiled_for_python, compiled_with_allocation
from solver.dense import invert_part, matrix_times
from solver.linked import FUNCTIONS, PrivateKernelCompiler, remember_signatures, short_compilation
from solver.redundancy.reduction import CACHE_LINE, aligned

types: Any = numba_types  # without types of its own
KINDS = (
    types.float64,
    types.int64,
    types.literal(2),
    types.Array(types.float64, 2, "C"),
    types.UniTuple(types.int64, 2),
)
UNARY = (operator.neg, operator.not_, abs, bool, len)


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


def _replaceable() -> list[object]:
    owners = (postproc.PostProcessor, base.BaseContext, context.BaseContext, event, base, lowering)
    return [value for owner in owners for value in vars(owner).values() if callable(value)]


def test_numba_is_as_before_after_a_kernel() -> None:
    before = _replaceable()

    def square(x: Any) -> Any:  # the kernel of the test above still holds the lock of its name
        return x[0] ** 2 + 1.0

    kernel: Any = compiled_for_python(square)
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


# Compiled linear algebra against that of NumPy.


@compiled_for_python
def _run(system: Any, count: int, pivot: Any, matrix: Any, rows: Any, product: Any) -> None:
    invert_part(system, count, pivot)
    matrix_times(matrix, rows, product)


def test_a_part_of_a_matrix_is_inverted_and_a_product_fills_the_first_columns() -> None:
    random, count, rows, width = np.random.default_rng(7), 7, 2, 12
    root, B, C = random.normal(size=(count, count)), random.normal(size=(rows, count)), random.normal(size=(rows, rows))
    A = root @ root.T + np.eye(count)
    system = np.zeros((count + rows, width))
    system[:, : count + rows] = np.block([[A, B.T], [B, C]])
    matrix, factor, product = random.normal(size=(3, 6)), random.normal(size=(6, 33)), np.full((3, 35), 9.0)
    _run(system, count, np.zeros(width), matrix, factor, product)
    inverse = np.linalg.inv(A)
    expected = np.block([[inverse, inverse @ B.T], [-B @ inverse, C - B @ inverse @ B.T]])
    np.testing.assert_allclose(system[:, : count + rows], expected, atol=1e-12)
    assert not system[:, count + rows :].any()
    np.testing.assert_allclose(product[:, :33], matrix @ factor, atol=1e-13)
    assert (product[:, 33:] == 9.0).all()


def test_aligned_memory_starts_at_a_cache_line() -> None:
    arrays = [aligned(rows, 33) for rows in range(1, 12)]
    assert {array.ctypes.data % CACHE_LINE for array in arrays} == {0}
    assert all(array.flags.c_contiguous and array.shape == (rows, 33) for rows, array in enumerate(arrays, 1))
    assert not any(array.any() for array in arrays)
