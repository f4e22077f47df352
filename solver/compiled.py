"""Python functions as machine code: compiled at their first call, then cached on disk.

A platform wheel brings the machine code of the kernels (kernel_wheel.py). It is loaded where the processor has the
instructions that it was compiled for, the version of numba is the same, and neither a kernel nor what it calls has
changed. Elsewhere kernels are compiled, as from source.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from functools import cache
from hashlib import sha256
from pathlib import Path
from pickle import UnpicklingError
from time import perf_counter
from types import CodeType
from typing import Any, TypeVar, cast

import numpy as np
from filelock import FileLock, Timeout
from numba import njit
from numba.core.caching import FunctionCache, IndexDataCacheFile, NullCache
from numba.core.codegen import get_host_cpu_features
from numba.core.compiler import CompileResult
from numba.core.dispatcher import Dispatcher
from numba.core.types import unliteral

from solver import linked
from solver.linked import KernelCompiler, LinkedCompiler, PrivateKernelCompiler

Function = TypeVar("Function", bound=Callable[..., object])

HASH_SIZE = sha256().digest_size
LOCK_TIMEOUT_S = 900.0  # the longest kernel takes half a minute; with 16 busy loops, ten times as long

_UNREADABLE = (AttributeError, ImportError, EOFError, IndexError, KeyError, TypeError, ValueError, UnpicklingError)
"""Of a kernel that was cached for a type that was renamed or moved, or of a file that lost its end as power failed."""

logger = logging.getLogger(__name__)
cache_logger = logging.getLogger("solver.cache")  # apart, because a progress bar replaces the messages of the other


def compiled(function: Function) -> Function:
    """The function as code for other compiled functions; division by zero gives inf or NaN, as in C.

    It cannot be called from Python: without the wrapper that it would need, it compiles in half the time. It neither
    allocates nor returns an array: in a function that does, numba counts the references to every view of an array,
    which takes longer than arithmetic with three components (docs/decisions/settled.md, 0050).
    Without _unliteral, it would be compiled once more for each constant argument.
    """
    return _linked(function, counts_references=False)


def compiled_with_allocation(function: Function) -> Function:
    """Like compiled, but the function may allocate arrays, and return them to a function that may, too."""
    return _linked(function, counts_references=True)


def compiled_with_sums_in_any_order(function: Function) -> Function:
    """Like compiled, but LLVM may add the terms of a sum in another order, and may round a product and a sum once. Only
    so it computes eight terms at once.
    """
    return _linked(function, counts_references=False, fastmath={"reassoc": True, "contract": True})


def compiled_for_python(function: Function) -> Function:
    """Like compiled, but callable from Python, and cached on disk until anything it depends on changes.

    Where no folder is writable for the cache, each process compiles it, and the first kernel says so.
    """
    return _kernel(function, KernelCompiler)


def compiled_with_private_functions(function: Function) -> Function:
    """Like compiled_for_python, with the functions that it calls private to it, so that LLVM may change how they are
    called: a third faster where they pass many arrays to one another, and half a second longer to compile
    (docs/decisions/settled.md, 0055).
    """
    return _kernel(function, PrivateKernelCompiler)


def keeps_code() -> bool:
    """Whether this process has found no kernel yet that has no folder for its code."""
    return not _NoCache.is_reported


def ship_kernel(kernel: Any, folder: Path) -> None:
    """Copy a kernel that this process has compiled, or loaded from its cache, into the folder of a wheel."""
    folder.mkdir(exist_ok=True)
    for signature, result in kernel.overloads.items():
        key = (signature, result.codegen.magic_tuple(), _digest(kernel.py_func))
        _file(folder, kernel.py_func).save(key, kernel._cache.read(signature, result.codegen))


def _kernel(function: Function, compiler: type) -> Function:
    options: dict[str, Any] = {
        "error_model": "numpy",
        "nogil": True,
        "no_cfunc_wrapper": True,
        "pipeline_class": compiler,
    }
    kernel: Any = njit(**options)(function)
    try:
        kernel._cache = _CodeCache(function)
    except RuntimeError:  # numba found no folder
        kernel._cache = _NoCache(function)
    return cast(Function, kernel)


def _linked(function: Function, *, counts_references: bool, fastmath: Mapping[str, bool] | bool = False) -> Function:
    options: dict[str, Any] = {
        "error_model": "numpy",
        "nogil": True,
        "no_cpython_wrapper": True,
        "no_cfunc_wrapper": True,
        "pipeline_class": LinkedCompiler,
        "_nrt": counts_references,
        "fastmath": fastmath,  # no set, the order of which differs between processes (_parts)
    }
    linked: Any = njit(**options)(function)
    if hasattr(linked, "get_call_template"):  # not with NUMBA_DISABLE_JIT
        find_template = linked.get_call_template
        linked.get_call_template = lambda types, names: find_template([_unliteral(kind) for kind in types], names)
    return cast(Function, linked)


_unliteral: Any = unliteral  # without types
_Cache: Any = FunctionCache
_File: Any = IndexDataCacheFile
_Null: Any = NullCache


class _HashedFile(_File):  # type: ignore[misc]
    """Files of machine code with its hash behind it: damaged code would end the process, or give another number."""

    def _dump(self, content: Any) -> bytes:
        packed: bytes = super()._dump(content)
        return packed + sha256(packed).digest()

    def _load_data(self, name: str) -> Any:
        """Raises ValueError for code that has changed since it was written."""
        packed = Path(self._data_path(name)).read_bytes()
        if sha256(packed[:-HASH_SIZE]).digest() != packed[-HASH_SIZE:]:
            raise ValueError(f"{name} has changed since it was compiled")
        return super()._load_data(name)  # which ignores what is behind it


class _CodeCache(_Cache):  # type: ignore[misc]
    """Cache of compiled kernels. numba's own checks only the file of the function itself, and ignores other processes.

    Here one process compiles, and others that need the kernel wait.
    """

    def __init__(self, function: Any) -> None:
        super().__init__(function)
        stamp = self._impl.locator.get_source_stamp()
        self._cache_file = _HashedFile(self._cache_path, self._impl.filename_base, stamp)
        name = function.__name__.strip("<>")  # of a lambda; Windows has no such file names
        lock = Path(self.cache_path) / f"{function.__module__}.{name}.lock"
        self._lock = FileLock(lock, LOCK_TIMEOUT_S, thread_local=False)

    def _index_key(self, signature: Any, codegen: Any) -> tuple[object, ...]:
        return (*super()._index_key(signature, codegen), _digest(self._py_func))

    def read(self, signature: Any, codegen: Any) -> Any:
        """The machine code that is kept of this source and processor. Raises FileNotFoundError where there is none."""
        kept = self._cache_file.load(self._index_key(signature, codegen))
        if kept is None:
            raise FileNotFoundError(f"{self.cache_path} has no machine code of {_title(self._py_func)}")
        return kept

    def _load_overload(self, signature: Any, target: Any) -> Any:
        found = self._cached(signature, target)
        if found is None:
            found = _load_shipped(self._py_func, signature, target)
        if found is not None:
            return found
        with suppress(Timeout, NotImplementedError):  # without locks on some network drives: then both compile
            self._lock.acquire()
        found = self._cached(signature, target)  # compiled by another process while this one waited
        if found is not None:
            self._lock.release(force=True)
            return found
        self._start = perf_counter()
        logger.warning("compiling %s, once on this machine; this takes up to half a minute", _title(self._py_func))
        return None

    def _cached(self, signature: Any, target: Any) -> Any:
        try:
            return super()._load_overload(signature, target)
        except (*_UNREADABLE, OSError):
            with suppress(OSError):
                self.flush()
            return None

    def _save_overload(self, signature: Any, data: Any) -> None:
        try:
            super()._save_overload(signature, data)
        except OSError as error:
            cache_logger.warning(
                "compiled code cannot be kept in %s (%s), so each process compiles it; free space there, or set "
                "NUMBA_CACHE_DIR to a folder with space",
                self.cache_path,
                error.strerror,
            )
        finally:
            self._lock.release(force=True)
        logger.warning("compiled %s in %.1f s", _title(self._py_func), perf_counter() - self._start)


class _NoCache(_Null):  # type: ignore[misc]
    """In place of a cache where no folder is writable."""

    is_reported = False  # in this process

    def __init__(self, function: Any) -> None:
        self._py_func = function

    def load_overload(self, signature: Any, target: Any) -> Any:
        target.refresh()
        found = _load_shipped(self._py_func, signature, target)
        if found is not None:
            return found
        if not _NoCache.is_reported:
            _NoCache.is_reported = True
            cache_logger.warning(
                "compiled code cannot be kept: neither __pycache__ beside %s nor the user's cache folder is writable, "
                "so each process compiles the solver for half a minute; set NUMBA_CACHE_DIR to a writable folder",
                self._py_func.__code__.co_filename,
            )
        logger.warning("compiling %s", _title(self._py_func))
        return None


def _load_shipped(function: Any, signature: Any, target: Any) -> Any:
    try:
        return load_shipped(function, _digest(function), signature, target)
    except (*_UNREADABLE, OSError):
        return None


def _title(function: Any) -> str:
    return f"{function.__module__}.{function.__name__}"


def _digest(function: Any) -> str:
    return sha256(repr([_compiler_digest(), *_parts(function, set())]).encode()).hexdigest()


@cache
def _compiler_digest() -> str:
    """Of how kernels are compiled: a wheel must not ship what an earlier compiler has left in the cache."""
    return sha256(b"".join(Path(file).read_bytes() for file in (__file__, linked.__file__))).hexdigest()


def _parts(function: Any, seen: set[object]) -> Iterator[object]:
    """Dependencies of the machine code: the function, the constants it names, the compiled functions it calls
    and their options.
    """
    seen.add(function)
    codes = [function.__code__]
    for code in codes:
        yield code.co_code
        codes += [constant for constant in code.co_consts if isinstance(constant, CodeType)]
        yield [constant for constant in code.co_consts if not isinstance(constant, CodeType)]
        for name in code.co_names:
            value = function.__globals__.get(name)
            if not isinstance(value, Dispatcher):
                fields = getattr(value, "_fields", None)  # of a NamedTuple
                yield name, value if isinstance(value, int | float | tuple | np.dtype) else fields
            elif value.py_func not in seen:
                yield value.targetoptions
                yield from _parts(value.py_func, seen)


FOLDER = Path(__file__).parent / "kernels"
X86_64_V3 = frozenset({"avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe", "xsave"})
"""Features of x86-64-v3 beyond x86-64-v2, in LLVM's names: System V ABI of x86-64, table 3.1."""
TARGETS = {"x86_64": ("x86-64-v3", X86_64_V3), "aarch64": ("generic", frozenset()), "arm64": ("generic", frozenset())}
"""Architecture → LLVM's name of the processor that a wheel is compiled for, and the features that it needs."""

_Result: Any = CompileResult  # without types
_find_features: Any = get_host_cpu_features


def load_shipped(function: Callable[..., object], digest: str, signature: Any, target: Any) -> Any:
    """The compiled kernel, or None where none is shipped for these types, this processor and this version of numba.

    digest: of all that the machine code depends on (compiled.py).
    """
    triple = target.codegen().magic_tuple()[0]
    processor = find_processor(triple.partition("-")[0], _host_features())
    if processor is None:
        return None
    found = _file(FOLDER, function).load((signature, (triple, processor, ""), digest))
    return None if found is None else _Result._rebuild(target, *found)


def find_processor(architecture: str, features: frozenset[str]) -> str | None:
    """The processor that a wheel for this architecture is compiled for; None if one with these features lacks some."""
    name, needed = TARGETS.get(architecture, (None, frozenset()))
    return name if needed <= features else None


@cache
def _host_features() -> frozenset[str]:
    """Instructions of this processor, without those that numba is configured not to use."""
    return frozenset(name[1:] for name in _find_features().split(",") if name.startswith("+"))


def _file(folder: Path, function: Callable[..., object]) -> Any:
    """numba's file of compiled functions. It reads none of another version of numba."""
    return _HashedFile(str(folder), f"{function.__module__}.{function.__name__}", None)
