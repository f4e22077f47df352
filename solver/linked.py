"""Compilers for kernels and for functions that only other compiled functions call: these are optimised in the kernels.

numba optimises a function together with all that it calls, and generates machine code for it, before its callers link
it, optimise it again and generate machine code for it again. Few of the solver's functions are called from Python; for
the other ones that machine code is never run (docs/decisions/settled.md, 0015).

Most of the rest is numba's own Python code. What of it is repeated or unused is avoided here, without a change in the
result (docs/decisions/settled.md, 0056).

Two thirds of the time in which a kernel compiles are spent in numba's own Python code. Some of it serves generators,
profilers of the compiler or types that are looked up again and again; it is replaced while a kernel compiles, and numba
is as before afterwards (docs/decisions/settled.md, 0057). If a part that is replaced here is
missing in another version of numba, AttributeError is raised at the first kernel that compiles.

Signatures of operators are looked up once for the same types of arguments. For `a * b` numba tries up to 18
implementations, most of which raise an error. It does so at every place in the code, and again when it lowers that
place to LLVM: a quarter of its own time, in which each answer is the same.
"""

from __future__ import annotations

import gc
import operator
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import cache
from importlib import import_module
from types import BuiltinFunctionType
from typing import Any, cast

from numba.core import base, codegen, compiler, compiler_machinery, event, ir, lowering, postproc, transforms, types
from numba.core.typed_passes import (
    AnnotateTypes,
    DumpParforDiagnostics,
    InlineOverloads,
    IRLegalization,
    NativeLowering,
    NopythonRewrites,
    NoPythonSupportedFeatureValidation,
)
from numba.core.typing import context
from numba.core.untyped_passes import (
    DeadBranchPrune,
    FindLiterallyCalls,
    InlineClosureLikes,
    InlineInlinables,
    LiteralPropagationSubPipelinePass,
    LiteralUnroll,
    MakeFunctionToJitFunction,
    RewriteDynamicRaises,
    RewriteSemanticConstants,
    WithLifting,
)

_Library: Any = codegen.JITCodeLibrary  # all of these are without types
_Compiler: Any = compiler.CompilerBase
_Passes: Any = compiler.DefaultPassBuilder
_Pass: Any = compiler_machinery.LoweringPass
_register_pass: Any = compiler_machinery.register_pass
_functions: Any = import_module("numba._dynfunc")
_Lifetimes: Any = postproc.VariableLifetime  # all of these are without types
_canonical: Any = transforms.canonicalize_cfg
_find_function: Any = base.BaseContext.get_function
_find_type: Any = context.BaseContext.resolve_value_type
_find_operand: Any = lowering._lit_or_omitted
_UNKNOWN: Any = _find_operand(ir.UNDEFINED)
FUNCTIONS = (
    *(operator.add, operator.sub, operator.mul, operator.truediv, operator.floordiv, operator.mod, operator.pow),
    *(operator.iadd, operator.isub, operator.imul, operator.itruediv, operator.neg, operator.not_),
    *(operator.lt, operator.le, operator.gt, operator.ge, operator.eq, operator.ne, operator.is_),
    *(operator.getitem, operator.setitem, abs, bool, len, max, min),
)


class KernelCompiler(_Compiler):  # type: ignore[misc]
    """For njit(pipeline_class=...) of a function that Python calls: numba's own passes, and what speeds them up."""

    def compile_extra(self, function: Callable[..., object]) -> Any:
        with short_compilation(self.state.typingctx):
            return super().compile_extra(function)

    def define_pipelines(self) -> list[Any]:
        return [_short_pipeline(self.state, "kernel")]


class PrivateKernelCompiler(KernelCompiler):
    """For a kernel as well, with the linked functions private to it."""

    def define_pipelines(self) -> list[Any]:
        pipeline = _short_pipeline(self.state, "private kernel")
        pipeline.add_pass_after(_ChooseKernelLibrary, AnnotateTypes)
        pipeline.finalize()
        return [pipeline]


class LinkedCompiler(_Compiler):  # type: ignore[misc]
    """For njit(pipeline_class=...): numba's own passes, and around the lowering to LLVM one before and one after it."""

    def define_pipelines(self) -> list[Any]:
        pipeline = _short_pipeline(self.state, "linked")
        pipeline.add_pass_after(_ChooseLibrary, AnnotateTypes)
        pipeline.add_pass_after(_OfferToCallers, NativeLowering)
        pipeline.finalize()
        return [pipeline]


def _short_pipeline(state: Any, name: str) -> Any:
    """numba's passes but for those that the solver's functions do not need."""
    pipeline = _Passes.define_nopython_pipeline(state, name)
    unneeded = _UNNEEDED if state.flags.nrt else {*_UNNEEDED, IRLegalization}
    pipeline.passes = [described for described in pipeline.passes if described[0] not in unneeded]
    pipeline.finalize()
    return pipeline


_UNNEEDED = {
    WithLifting,
    InlineClosureLikes,
    MakeFunctionToJitFunction,
    InlineInlinables,
    InlineOverloads,
    FindLiterallyCalls,
    LiteralUnroll,
    LiteralPropagationSubPipelinePass,
    RewriteDynamicRaises,
    RewriteSemanticConstants,
    DeadBranchPrune,
    NopythonRewrites,
    NoPythonSupportedFeatureValidation,
    DumpParforDiagnostics,
}
"""Passes for with, closures, comprehensions, functions that are inlined as Python, literally, raise with values,
arguments that are None, and arithmetic with whole arrays; and a check for what the solver's functions do not use.

IRLegalization deletes variables after their last use, which only counts references.
"""


class _LinkedLibrary(_Library):  # type: ignore[misc]
    """Code of one function and of those that it calls, as lowered; its callers optimise what they link."""

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        """Ready to be linked. The module is not given to the execution engine, which would generate machine code."""
        self._finalize_dynamic_globals()
        self._finalized = True


class _KernelLibrary(_Library):  # type: ignore[misc]
    """Code of a kernel. Nothing else calls the functions linked into it, so LLVM may change how they are called.

    They are private, not internal: internal ones keep their names, by which another kernel of the process would find
    them in place of its own (docs/decisions/settled.md, 0055).
    """

    def _optimize_final_module(self) -> None:
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage.name == "linkonce_odr":
                function.linkage = "private"
        super()._optimize_final_module()


@_register_pass(mutates_CFG=False, analysis_only=False)
class _ChooseLibrary(_Pass):  # type: ignore[misc]
    _name = "choose_linked_library"

    def __init__(self) -> None:  # abstract in numba
        super().__init__()

    def run_pass(self, state: Any) -> bool:
        if not state.flags.nrt and _has_array(state.return_type):
            name = state.func_id.func_qualname
            raise TypeError(f"{name} returns an array, but is compiled without counts of the references to arrays")
        state.library = _LinkedLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        state.flags.no_compile = True  # the lowering asks for no address of the function
        return True


@_register_pass(mutates_CFG=False, analysis_only=False)
class _ChooseKernelLibrary(_Pass):  # type: ignore[misc]
    _name = "choose_kernel_library"

    def __init__(self) -> None:  # abstract in numba
        super().__init__()

    def run_pass(self, state: Any) -> bool:
        state.library = _KernelLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()  # as numba does for a library of its own
        return True


def _has_array(returned: Any) -> bool:
    """Whether an array is in the type of a returned value: its caller would release an uncounted reference."""
    if isinstance(returned, types.BaseTuple):
        return any(_has_array(part) for part in tuple(cast(Any, returned)))
    return isinstance(returned, types.Array)


@_register_pass(mutates_CFG=False, analysis_only=False)
class _OfferToCallers(_Pass):  # type: ignore[misc]
    """Register the function, by an object without an address, as numba does for one without a wrapper."""

    _name = "offer_linked_function"

    def __init__(self) -> None:
        super().__init__()

    def run_pass(self, state: Any) -> bool:
        lowered, library = state.cr, state.library
        described = lowered.fndesc
        module, name = described.lookup_module(), described.qualname.rpartition(".")[2]
        function = _functions.make_function(module, name, "", 0, lowered.env, (library,))
        state.targetctx.insert_user_function(function, described, [library])
        state.cr = lowered._replace(cfunc=function)
        return True


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


def remember_signatures(typing: Any) -> None:
    """Give the FUNCTIONS of numba's typing context a memory of the signatures that they have found."""
    for function in FUNCTIONS:
        resolved = typing.resolve_value_type(function)
        if "get_call_type" not in vars(resolved):  # else from an earlier kernel; numba replaces what it extends
            resolved.get_call_type = _remembering(resolved.get_call_type)


def _remembering(find: Callable[..., Any]) -> Callable[..., Any]:
    found: dict[tuple[Any, ...], Any] = {}

    def get_call_type(context: Any, arguments: Any, keywords: Any) -> Any:
        if keywords:
            return find(context, arguments, keywords)
        types = tuple(arguments)
        if types not in found:
            found[types] = find(context, arguments, keywords)
        return found[types]

    return get_call_type
