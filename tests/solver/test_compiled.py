"""Compiled kernels: their cache, what they log, and frames that allocate nothing."""

import errno
import logging
import os
import subprocess
import sys
from collections import namedtuple
from collections.abc import Callable, Iterator
from itertools import product
from pathlib import Path
from types import ModuleType
from typing import Any

import numba
import numpy as np
import pytest
from numba.core import caching
from numba.core.runtime import _nrt_python, rtsys

from solver import compiled
from solver.bundled import bundled_model, simulate_arm_raise
from solver.motion import decimate, differentiate
from solver.muscle import PathMode
from solver.redundancy.effort import RedundancyOptions
from solver.redundancy.mechanics import evaluate_motion
from solver.redundancy.motion_solution import solve_motion
from solver.redundancy.problem import FrameOutcome, LoadResponse, build_redundancy
from solver.redundancy.sequence import solve_redundancy

KERNEL = """
from collections import namedtuple
from solver.compiled import compiled_for_python
from solver.compiled import {compiler} as compiled
FACTOR = {factor}
Pair = namedtuple("Pair", "{fields}")

@compiled
def scaled(x):
    first, _ = Pair(x=FACTOR * x{more}, y=0.0)
    return first

@compiled_for_python
def kernel(x):
    return scaled(x)
"""
KEYS_OF_KERNELS = """
from hashlib import sha256
from importlib import import_module
from solver.compile_ahead import KERNELS
from solver.compiled import _parts

for module, name in KERNELS:
    kernel = getattr(import_module(module), name)
    print(name, sha256(repr(list(_parts(kernel.py_func, set()))).encode()).hexdigest())
"""
MODEL = bundled_model()
MOTION = differentiate(simulate_arm_raise(MODEL))


@pytest.fixture(autouse=True)
def _cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))


def _kernel(folder: Path, factor: float = 2.0, more: str = "", fields: str = "x y", compiler: str = "compiled") -> Any:
    file = folder / "kernel.py"
    if not file.exists():  # the source as the compiler sees it never changes
        file.write_text(KERNEL, encoding="utf-8")
    module = ModuleType("kernel")
    module.__file__ = str(file)
    source = KERNEL.format(factor=factor, more=more, fields=fields, compiler=compiler)
    exec(compile(source, file, "exec"), vars(module))  # noqa: S102
    return vars(module)["kernel"]


def test_the_first_call_reports_the_compilation(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    assert _kernel(tmp_path)(3.0) == 6.0
    first, last = [record.getMessage() for record in caplog.records if record.name == compiled.__name__]
    assert first.startswith("compiling kernel.kernel")
    assert last.startswith("compiled kernel.kernel in")


def test_what_is_kept_on_disk_is_not_compiled_again(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    _kernel(tmp_path)(3.0)
    caplog.clear()
    assert _kernel(tmp_path)(3.0) == 6.0
    assert not caplog.records


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"factor": 5.0}, 15.0),
        ({"more": " + 1.0"}, 7.0),
        ({"fields": "y x"}, 0.0),
        ({"compiler": "compiled_with_allocation"}, 6.0),
    ],
)
def test_a_change_in_what_a_kernel_calls_compiles_it_again(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, change: dict[str, Any], expected: float
) -> None:
    caplog.set_level(logging.WARNING)
    _kernel(tmp_path)(3.0)
    assert _kernel(tmp_path, **change)(3.0) == expected
    assert sum("compiling" in record.getMessage() for record in caplog.records) == 2


def test_a_kernel_that_was_kept_for_a_type_of_another_name_is_compiled_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As after an update that renames it, on a machine that has compiled the old one."""
    types = ModuleType("types_of_kernel")
    monkeypatch.setitem(sys.modules, types.__name__, types)
    for name in ("Before", "After"):
        pair = namedtuple(name, "x y", module=types.__name__)  # type: ignore[misc]
        monkeypatch.setattr(types, name, pair, raising=False)
        assert _kernel(tmp_path, more="[1] + x[0]")(pair(3.0, 4.0)) == 2.0 * 4.0 + 3.0
        monkeypatch.delattr(types, name)


def test_a_kernel_whose_cached_file_was_damaged_is_compiled_again_and_kept(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """As after a power failure: a file without its end, or zeros in its place."""
    _kernel(tmp_path)(3.0)
    for suffix, rest in product(("nbi", "nbc"), (b"", b"\0" * 500, b"\x80\x05\x95")):
        (file,) = tmp_path.rglob(f"*.{suffix}")
        file.write_bytes(rest)
        assert _kernel(tmp_path)(3.0) == 6.0
        caplog.clear()
        assert _kernel(tmp_path)(3.0) == 6.0
        assert not caplog.records, (suffix, rest)


def test_machine_code_that_was_damaged_is_not_run(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Zeros in the middle, of a sector that was not written: LLVM or the code itself would end the process."""
    _kernel(tmp_path)(3.0)
    for part in range(8):
        (file,) = tmp_path.rglob("*.nbc")
        code = bytearray(file.read_bytes())
        at = len(code) * (2 * part + 1) // 16
        code[at : at + 64] = bytes(64)
        file.write_bytes(code)
        caplog.clear()
        assert _kernel(tmp_path)(3.0) == 6.0
        assert any("compiling" in record.getMessage() for record in caplog.records), f"part {part}"


@pytest.mark.parametrize("suffix", ["nbi", "nbc"])
def test_a_folder_in_place_of_a_cached_file_is_reported_and_the_kernel_runs(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, suffix: str
) -> None:
    _kernel(tmp_path)(3.0)
    (file,) = tmp_path.rglob(f"*.{suffix}")
    file.unlink()
    file.mkdir()
    assert _kernel(tmp_path)(3.0) == 6.0
    (message,) = [record.getMessage() for record in caplog.records if record.name == "solver.cache"]
    assert str(tmp_path) in message
    assert os.strerror(errno.EISDIR) in message or sys.platform == "win32"  # there, access is denied


def test_a_kernel_runs_on_a_full_disk_and_reports_that_it_is_not_cached(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def save(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(caching.IndexDataCacheFile, "_save_data", save)
    assert _kernel(tmp_path)(3.0) == 6.0
    (message,) = [record.getMessage() for record in caplog.records if record.name == "solver.cache"]
    assert os.strerror(errno.ENOSPC) in message
    monkeypatch.undo()
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    assert _kernel(tmp_path)(3.0) == 6.0


def test_a_kernel_that_another_process_compiles_meanwhile_is_waited_for_and_loaded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    ours, theirs = _kernel(tmp_path), _kernel(tmp_path)
    acquire, has_waited = compiled.FileLock.acquire, []

    def acquire_after_them(lock: Any) -> Any:
        if not has_waited:
            has_waited.append(True)
            assert theirs(3.0) == 6.0
            assert not theirs._cache._lock.is_locked, "who has compiled makes way"
            caplog.clear()
        return acquire(lock)

    monkeypatch.setattr(compiled.FileLock, "acquire", acquire_after_them)
    assert ours(3.0) == 6.0
    assert has_waited
    assert not caplog.records
    assert not ours._cache._lock.is_locked


def test_where_no_lock_can_be_had_a_kernel_is_compiled_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def acquire(lock: Any) -> None:
        raise compiled.Timeout(lock.lock_file)

    monkeypatch.setattr(compiled.FileLock, "acquire", acquire)
    assert _kernel(tmp_path)(3.0) == 6.0


def test_without_a_writable_folder_it_is_compiled_and_reported_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "__pycache__").write_text("a file where the folder would be")
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    monkeypatch.setattr("numba.core.caching.AppDirs.user_cache_dir", str(tmp_path / "__pycache__"))
    monkeypatch.setattr(compiled._NoCache, "is_reported", False)
    assert _kernel(tmp_path)(3.0) == 6.0
    assert _kernel(tmp_path, factor=5.0)(3.0) == 15.0
    (message,) = [record.getMessage() for record in caplog.records if record.name == "solver.cache"]
    assert "NUMBA_CACHE_DIR" in message
    assert str(tmp_path) in message
    assert sum(record.name == compiled.__name__ for record in caplog.records) == 2


def test_another_process_looks_for_a_kernel_under_the_same_key(capsys: pytest.CaptureFixture[str]) -> None:
    """Else it compiles the kernel again. The order of a set, for one, depends on the process."""
    exec(KEYS_OF_KERNELS, {})  # noqa: S102
    ours = capsys.readouterr().out
    assert ours.count("\n") == 12
    seed = "1" if os.environ.get("PYTHONHASHSEED") == "2" else "2"
    theirs = subprocess.run(  # noqa: S603
        [sys.executable, "-c", KEYS_OF_KERNELS],
        env={**os.environ, "PYTHONHASHSEED": seed},
        check=True,
        stdout=subprocess.PIPE,
        text=True,
    ).stdout
    assert theirs == ours


@pytest.fixture(autouse=True)
def _counted() -> Iterator[None]:
    _nrt_python.memsys_enable_stats()
    yield
    _nrt_python.memsys_disable_stats()


def _allocations(run: Callable[[], object]) -> int:
    run()  # compiled from here on
    before = rtsys.get_allocation_stats().alloc
    run()
    return int(rtsys.get_allocation_stats().alloc - before)


@pytest.mark.parametrize("mode", ["opensim", pytest.param("geodesic", marks=pytest.mark.slow)])
def test_more_frames_of_a_motion_allocate_no_more(mode: PathMode) -> None:
    few, many = (
        _allocations(
            lambda every=every: solve_motion(MODEL, decimate(MOTION, every), RedundancyOptions(path_mode=mode))
        )
        for every in (100, 20)
    )
    assert many == few > 0


def test_nor_do_frames_that_have_no_solution() -> None:
    problem = build_redundancy(MODEL, evaluate_motion(MODEL, decimate(MOTION, 40)), RedundancyOptions())
    frames, coordinates = len(problem.time), len(problem.tracked)
    reaction = np.zeros((2, frames, 6))
    reaction[1, :, 3:] = -1e5 * problem.cone[:, 0]  # N out of the glenoid, more than the muscles can make good
    loads = [LoadResponse(np.zeros((1, frames, coordinates)), each[None]) for each in reaction]
    assert (solve_redundancy(problem, loads[1]).outcomes == FrameOutcome.INFEASIBLE).all()
    solved, missed = (_allocations(lambda load=load: solve_redundancy(problem, load)) for load in loads)
    assert missed == solved
