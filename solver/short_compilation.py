"""numba without the parts that take time and have no effect on the solver's kernels.

Two thirds of the time in which a kernel compiles are spent in numba's own Python code. Some of it serves generators,
profilers of the compiler or types that are looked up again and again; it is replaced while a kernel compiles, and
numba is as before afterwards (docs/decisions/0057-compilation-without-unused-analyses.md). If a part that is replaced
here is missing in another version of numba, AttributeError is raised at the first kernel that compiles.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import cache
from types import BuiltinFunctionType
from typing import Any

from numba.core import base, event, ir, lowering, postproc, transforms
from numba.core.typing import context

from solver.operator_signatures import remember_signatures

_Lifetimes: Any = postproc.VariableLifetime  # all of these are without types
_canonical: Any = transforms.canonicalize_cfg
_find_function: Any = base.BaseContext.get_function
_find_type: Any = context.BaseContext.resolve_value_type
_find_operand: Any = lowering._lit_or_omitted
_UNKNOWN: Any = _find_operand(ir.UNDEFINED)


@contextmanager
def short_compilation(typing: Any) -> Iterator[None]:
    """In this context numba compiles the same code in less time; typing is its typing context.

    numba compiles one function at a time, so that no other thread sees the replaced parts.
    """
    remember_signatures(typing)
    with ExitStack() as parts:
        parts.enter_context(_collection_paused())
        parts.enter_context(_replaced(postproc.PostProcessor, "run", _post_process))
        parts.enter_context(_replaced(event, "start_event", _ignore_event))
        parts.enter_context(_replaced(event, "end_event", _ignore_event))
        parts.enter_context(_replaced(base, "_has_loc", cache(base._has_loc)))
        parts.enter_context(_replaced(base.BaseContext, "get_function", _get_function))
        parts.enter_context(_replaced(context.BaseContext, "resolve_value_type", _resolve_value_type))
        parts.enter_context(_replaced(lowering, "_lit_or_omitted", _literal_or_omitted))
        yield


@contextmanager
def _collection_paused() -> Iterator[None]:
    """Without garbage collection, which in vain looks through the many objects of the compiler again and again.

    Freezing and unfreezing makes them old, so that the next full collection frees them; as young objects they would be
    collected at once, which takes a fifteenth of the time of the kernel.
    """
    is_paused = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if is_paused:
            if not gc.get_freeze_count():  # else objects that others have frozen would be unfrozen
                gc.freeze()
                gc.unfreeze()
            gc.enable()


@contextmanager
def _replaced(owner: Any, name: str, replacement: Callable[..., Any]) -> Iterator[None]:
    original = getattr(owner, name)
    setattr(owner, name, replacement)
    try:
        yield
    finally:
        setattr(owner, name, original)


def _post_process(self: Any, emit_dels: bool = False, extend_lifetimes: bool = False) -> None:  # noqa: FBT001, FBT002
    """PostProcessor.run for what is no generator: lifetimes of variables are found only where they are used.

    numba's own finds them after every pass, for the variables that a generator has to keep.
    """
    function = self.func_ir
    function.blocks = _canonical(function.blocks)
    function.variable_lifetime = _Lifetimes(function.blocks)
    function.generator_info = None
    if emit_dels:
        self._insert_var_dels(extend_lifetimes=extend_lifetimes)


def _ignore_event(*_: Any, **__: Any) -> None:
    """In place of events for profilers of the compiler, two for each call of LLVM."""


def _get_function(self: Any, function: Any, signature: Any, **options: bool) -> Any:
    """BaseContext.get_function, which finds no conversion of an array to an array, and then loads all registries again.

    numba asks for the conversion at every use of an array, because other packages can define types that have one.
    """
    if function == "__array__":
        raise NotImplementedError
    return _find_function(self, function, signature, **options)


def _resolve_value_type(self: Any, value: object) -> Any:
    """BaseContext.resolve_value_type, which takes built-in functions for constants first and catches an exception."""
    found = self._get_global_type(value) if isinstance(value, BuiltinFunctionType) else None
    return _find_type(self, value) if found is None else found


def _literal_or_omitted(value: Any) -> Any:
    """Type of a constant operand. Nearly all are unknown, of which numba finds out with two exceptions for each."""
    return _UNKNOWN if value is ir.UNDEFINED else _find_operand(value)
