"""Compilers for kernels and for functions that only other compiled functions call: these are optimised in the kernels.

numba optimises a function together with all that it calls, and generates machine code for it, before its callers link
it, optimise it again and generate machine code for it again. Few of the solver's functions are called from Python;
for the other ones that machine code is never run (docs/decisions/0015-linking-of-compiled-functions.md).

Most of the rest is numba's own Python code. What of it is repeated or unused is avoided here, without a change in the
result (docs/decisions/0056-first-use-in-two-processes.md).
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any, cast

from numba.core import codegen, compiler, compiler_machinery, types
from numba.core.typed_passes import (
    AnnotateTypes,
    DumpParforDiagnostics,
    InlineOverloads,
    IRLegalization,
    NativeLowering,
    NopythonRewrites,
    NoPythonSupportedFeatureValidation,
)
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

from solver.short_compilation import short_compilation

_Library: Any = codegen.JITCodeLibrary  # all of these are without types
_Compiler: Any = compiler.CompilerBase
_Passes: Any = compiler.DefaultPassBuilder
_Pass: Any = compiler_machinery.LoweringPass
_register_pass: Any = compiler_machinery.register_pass
_functions: Any = import_module("numba._dynfunc")


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
    them in place of its own (docs/decisions/0055-private-functions-of-a-kernel.md).
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
