"""Machine code of the kernels that a platform wheel brings (kernel_wheel.py).

It is loaded where the processor has the instructions that it was compiled for, the version of numba is the same, and
neither a kernel nor what it calls has changed. Elsewhere kernels are compiled, as from source.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from numba.core.caching import IndexDataCacheFile
from numba.core.codegen import get_host_cpu_features
from numba.core.compiler import CompileResult

FOLDER = Path(__file__).parent / "kernels"
X86_64_V3 = frozenset({"avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe", "xsave"})
"""What x86-64-v3 has beyond x86-64-v2, in LLVM's names: System V ABI of x86-64, table 3.1."""
TARGETS = {"x86_64": ("x86-64-v3", X86_64_V3), "aarch64": ("generic", frozenset()), "arm64": ("generic", frozenset())}
"""Architecture → LLVM's name of the processor that a wheel is compiled for, and the features that it needs."""

_Result: Any = CompileResult  # without types
_File: Any = IndexDataCacheFile
_find_features: Any = get_host_cpu_features


def load_shipped(function: Callable[..., object], digest: str, signature: Any, target: Any) -> Any:
    """The compiled kernel, or None where none is shipped for these types, this processor and this version of numba.

    digest: of all that the machine code depends on (compiled.py).
    """
    triple = target.codegen().magic_tuple()[0]
    processor = processor_of(triple.partition("-")[0], _host_features())
    if processor is None:
        return None
    found = _file(FOLDER, function).load((signature, (triple, processor, ""), digest))
    return None if found is None else _Result._rebuild(target, *found)


def ship(kernel: Any, digest: str, folder: Path) -> None:
    """Write the machine code of a kernel that this process has compiled into a folder."""
    folder.mkdir(exist_ok=True)
    for signature, result in kernel.overloads.items():
        _file(folder, kernel.py_func).save((signature, result.codegen.magic_tuple(), digest), result._reduce())


def processor_of(architecture: str, features: frozenset[str]) -> str | None:
    """The processor that a wheel for this architecture is compiled for; None if one with these features lacks some."""
    name, needed = TARGETS.get(architecture, (None, frozenset()))
    return name if needed <= features else None


@cache
def _host_features() -> frozenset[str]:
    """Instructions of this processor, without those that numba is configured not to use."""
    return frozenset(name[1:] for name in _find_features().split(",") if name.startswith("+"))


def _file(folder: Path, function: Callable[..., object]) -> Any:
    """numba's file of compiled functions. It reads none of another version of numba."""
    return _File(str(folder), f"{function.__module__}.{function.__name__}", None)
