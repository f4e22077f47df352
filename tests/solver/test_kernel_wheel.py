"""A wheel with compiled kernels, built from this checkout and installed elsewhere."""

from __future__ import annotations

import importlib
import json
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
from solver.compiled import TARGETS, X86_64_V3, processor_of
from tests.solver.test_compile_ahead import CUFFS

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
    target = {"NUMBA_CPU_NAME": PROCESSOR, "NUMBA_CPU_FEATURES": "", "NUMBA_CACHE_DIR": str(folder / "cache")}
    paths = os.pathsep.join([str(folder), str(Path(compiled.__file__).parents[1])])
    command = [sys.executable, "-c", SHIP, str(folder / "kernels")]
    subprocess.run(command, env={**os.environ, **target, "PYTHONPATH": paths}, check=True)  # noqa: S603
    return folder


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
def test_a_shipped_kernel_is_loaded_and_no_file_is_written(
    module: ModuleType, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    assert module.kernel(3.0) == 6.0
    assert not caplog.records
    assert not [path for path in (tmp_path / "cache").rglob("*") if path.is_file()]


@has_instructions
def test_a_shipped_kernel_is_loaded_where_no_folder_is_writable(
    module: ModuleType, caplog: pytest.LogCaptureFixture
) -> None:
    module.kernel._cache = compiled._NoCache(module.kernel.py_func)
    assert module.kernel(3.0) == 6.0
    assert not caplog.records


@pytest.mark.parametrize("difference", ["numba", "processor", "source", "types", "damage"])
def test_a_kernel_that_does_not_fit_is_compiled(
    module: ModuleType,
    difference: str,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    argument, expected = 3.0, 6.0
    if difference == "numba":
        monkeypatch.setattr(numba, "__version__", "0.1.0")
    elif difference == "processor":
        monkeypatch.setattr(compiled, "processor_of", lambda *_: None)
    elif difference == "source":
        monkeypatch.setattr(module, "FACTOR", 5.0)
        expected = 15.0
    elif difference == "types":
        argument = 3
    else:
        for file in compiled.FOLDER.glob("*.nbc"):
            file.write_bytes(file.read_bytes()[:-100])
    assert module.kernel(argument) == expected
    assert any("compiling" in record.getMessage() for record in caplog.records)


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
    assert processor_of(architecture, frozenset(features)) == processor


ROOT = Path(__file__).parents[2]
MOST_BEYOND_WARM_S = 2.0
USE = """
import sys, time
from pathlib import Path
import cuffstation as cs
import solver
assert Path(solver.__file__).is_relative_to(sys.argv[1]), solver.__file__
model = cs.load_model()
times = []
for _ in range(2):
    began = time.process_time()
    cs.assess(cs.read_cuffs(sys.argv[2]), model, cs.load_motion(model, every=200), people=0)
    times.append(time.process_time() - began)
print(times[0] - times[1])
"""


@pytest.mark.slow
@pytest.mark.timeout(900)
@has_instructions
def test_an_installed_wheel_compiles_nothing(tmp_path: Path) -> None:
    wheels, installed, kept = tmp_path / "wheels", tmp_path / "installed", tmp_path / "kept"
    _run("-m", "solver.kernel_wheel", str(wheels))
    (wheel,) = wheels.iterdir()
    assert f"-cp{sys.version_info.major}{sys.version_info.minor}-none-" in wheel.name
    _run("-m", "pip", "install", "--no-deps", "--target", str(installed), str(wheel))
    environment = {"PYTHONPATH": str(installed), "NUMBA_CACHE_DIR": str(kept)}
    cuffs = tmp_path / "cuffs.json"
    cuffs.write_text(json.dumps({"cuffs": CUFFS}), encoding="utf-8")
    beyond_warm_s = float(_run("-c", USE, str(installed), str(cuffs), **environment))
    assert beyond_warm_s < MOST_BEYOND_WARM_S
    station = "from station.__main__ import main; main()"
    _run("-c", station, "rmr", "--every", "100", "--output", str(tmp_path / "rmr.csv"), **environment)
    assert not [path for path in kept.rglob("*") if path.is_file()], "what was compiled"


def _run(*arguments: str, **environment: str) -> str:
    """Run Python; stdout. From the checkout only to build, so that the rest imports the installed packages."""
    folder = ROOT if not environment else Path(environment["PYTHONPATH"])
    ran = subprocess.run(  # noqa: S603
        [sys.executable, *arguments],
        cwd=folder,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == 0, ran.stderr
    return ran.stdout
