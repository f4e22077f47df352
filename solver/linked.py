"""A compiler for functions that only other compiled functions call: they are linked into these and optimised there.

numba optimises a function together with all that it calls, and generates machine code for it, before its callers link
it, optimise it again and generate machine code for it again. Few of the solver's functions are called from Python;
for the other ones that machine code is never run (docs/decisions/0015-linking-of-compiled-functions.md).
"""

from __future__ import annotations

from importlib import import_module
from typing import Any, cast

from numba.core import codegen, compiler, compiler_machinery, types
from numba.core.typed_passes import AnnotateTypes, NativeLowering

_Library: Any = codegen.JITCodeLibrary  # all of these are without types
_Compiler: Any = compiler.CompilerBase
_Passes: Any = compiler.DefaultPassBuilder
_Pass: Any = compiler_machinery.LoweringPass
_register_pass: Any = compiler_machinery.register_pass
_functions: Any = import_module("numba._dynfunc")


class LinkedCompiler(_Compiler):  # type: ignore[misc]
    """For njit(pipeline_class=...): numba's own passes, and around the lowering to LLVM one before and one after it."""

    def define_pipelines(self) -> list[Any]:
        pipeline = _Passes.define_nopython_pipeline(self.state, "linked")
        pipeline.add_pass_after(_ChooseLibrary, AnnotateTypes)
        pipeline.add_pass_after(_OfferToCallers, NativeLowering)
        pipeline.finalize()
        return [pipeline]


class _LinkedLibrary(_Library):  # type: ignore[misc]
    """Code of one function and of those that it calls, as lowered; its callers optimise what they link."""

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        """Ready to be linked. The module is not given to the execution engine, which would generate machine code."""
        self._finalize_dynamic_globals()
        self._finalized = True


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


def _has_array(returned: Any) -> bool:
    """Whether an array is in the type of a returned value: its caller would release a reference that nobody counted."""
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
