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
from typing import Any

from numba.core import base, event, postproc, transforms

from solver.operator_signatures import remember_signatures

_Lifetimes: Any = postproc.VariableLifetime  # all of these are without types
_canonical: Any = transforms.canonicalize_cfg


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
        yield


@contextmanager
def _collection_paused() -> Iterator[None]:
    """Without garbage collection, which in vain looks through the many objects of the compiler again and again."""
    is_paused = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if is_paused:
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
