"""Kernels that a wheel carries; tests/house/test_distribution.py builds and installs one."""

import importlib
import logging
import os
import platform
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numba
import pytest

from solver import compiled
from solver.compiled import TARGETS, X86_64_V3, find_processor

MODULE = "shipped_kernel"
KERNEL = """
from solver.compiled import compiled_for_python
FACTOR = 2.0

@compiled_for_python
def kernel(x):
    return FACTOR * x
"""
SHIP = f"""
import sys
from pathlib import Path
from {MODULE} import kernel
from solver.compiled import ship_kernel
kernel(3.0)
ship_kernel(kernel, Path(sys.argv[1]))
"""
PROCESSOR, NEEDED = TARGETS[platform.machine().lower().replace("amd64", "x86_64")]
has_instructions = pytest.mark.skipif(
    not compiled._host_features() >= NEEDED, reason=f"this processor is older than {PROCESSOR}"
)


@pytest.fixture(scope="module")
def shipped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The source of a kernel, and its machine code from another process in kernels/."""
    folder = tmp_path_factory.mktemp("shipped")
    (folder / f"{MODULE}.py").write_text(KERNEL, encoding="utf-8")
    assert "compiling" in _ship(folder, folder / "kernels")
    return folder


def _ship(source: Path, kernels: Path) -> str:
    """What a process says that ships the kernel of a source, which is not compiled again if the cache has it."""
    target = {"NUMBA_CPU_NAME": PROCESSOR, "NUMBA_CPU_FEATURES": "", "NUMBA_CACHE_DIR": str(source / "cache")}
    paths = os.pathsep.join([str(source), str(Path(compiled.__file__).parents[1])])
    environment = {**os.environ, **target, "PYTHONPATH": paths}
    command = [sys.executable, "-c", SHIP, str(kernels)]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stderr  # noqa: S603


@pytest.fixture
def module(
    shipped: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> ModuleType:
    """The module as it is installed elsewhere, with an empty cache."""
    caplog.set_level(logging.WARNING)
    installed = Path(shutil.copytree(shipped, tmp_path / "installed"))
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(compiled, "FOLDER", installed / "kernels")
    monkeypatch.syspath_prepend(str(installed))
    monkeypatch.delitem(sys.modules, MODULE, raising=False)
    return importlib.import_module(MODULE)


@has_instructions
@pytest.mark.parametrize("is_writable", [True, False])
def test_a_shipped_kernel_is_loaded_and_no_file_is_written(
    module: ModuleType, tmp_path: Path, caplog: pytest.LogCaptureFixture, is_writable: bool
) -> None:
    if not is_writable:
        module.kernel._cache = compiled._NoCache(module.kernel.py_func)
    assert module.kernel(3.0) == 6.0
    assert not caplog.records
    assert not [path for path in (tmp_path / "cache").rglob("*") if path.is_file()]


@pytest.mark.parametrize("difference", ["numba", "processor", "source", "compiler", "types", "damage"])
def test_a_kernel_that_does_not_fit_is_compiled(
    module: ModuleType, difference: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    argument, expected = 3.0, 6.0
    if difference == "numba":
        monkeypatch.setattr(numba, "__version__", "0.1.0")
    elif difference == "processor":
        monkeypatch.setattr(compiled, "find_processor", lambda *_: None)
    elif difference == "source":
        monkeypatch.setattr(module, "FACTOR", 5.0)
        expected = 15.0
    elif difference == "compiler":
        monkeypatch.setattr(compiled, "_compiler_digest", lambda: "another")
    elif difference == "types":
        argument = 3
    else:
        for file in compiled.FOLDER.glob("*.nbc"):
            file.write_bytes(file.read_bytes()[:-100])
    assert module.kernel(argument) == expected
    assert any("compiling" in record.getMessage() for record in caplog.records)


@has_instructions
def test_what_is_compiled_is_shipped_and_of_a_source_that_has_changed_the_new_code_is(
    shipped: Path, module: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    assert "compiling" not in _ship(shipped, tmp_path / "same")
    (shipped / f"{MODULE}.py").write_text(KERNEL.replace("2.0", "12.0"), encoding="utf-8")
    assert "compiling" in _ship(shipped, tmp_path / "changed")
    monkeypatch.setattr(compiled, "FOLDER", tmp_path / "changed")
    monkeypatch.setattr(module, "FACTOR", 12.0)
    assert module.kernel(3.0) == 36.0
    assert not caplog.records


@pytest.mark.parametrize(
    ("architecture", "features", "processor"),
    [
        ("x86_64", X86_64_V3 | {"avx512f"}, "x86-64-v3"),
        ("x86_64", X86_64_V3 - {"avx2"}, None),
        ("aarch64", {"neon"}, "generic"),
        ("arm64", set(), "generic"),
        ("riscv64", X86_64_V3, None),
    ],
)
def test_code_runs_on_a_processor_that_has_all_its_instructions(
    architecture: str, features: set[str], processor: str | None
) -> None:
    assert find_processor(architecture, frozenset(features)) == processor
