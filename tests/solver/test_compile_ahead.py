"""Ahead of an assessment: what it will call is compiled, nothing is left out, and the process goes with its parent."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from numba.core import config

from solver import compile_ahead, compiled
from solver.compiled import compiled_for_python
from solver.functions.bezier import evaluate_chain
from solver.multibody.joints import move_bodies
from solver.multibody.mass_matrix import fill_responses, mass_matrix_and_bias
from solver.redundancy.frames import solve_activations
from solver.redundancy.reduction import eliminate
from solver.wrapping.wrapped_paths import evaluate_wrapped_paths, place_points

COMMAND = (sys.executable, "-m", "solver.compile_ahead")

ASSESS_AFTERWARDS = """
import sys
from pathlib import Path
from numba.core.dispatcher import Dispatcher
from solver.compile_ahead import KERNELS, SHARES, compile_ahead, count_ready, print_count

def signatures():
    return {
        f"{value.py_func.__module__}.{value.py_func.__name__}": len(value.signatures)
        for name, module in list(sys.modules.items()) if name.startswith("solver.")
        for value in vars(module).values() if isinstance(value, Dispatcher) and value.signatures
    }

file = Path(sys.argv.pop())
for compile_share in SHARES.values():
    compile_share()
compile_ahead(print_count)
before = signatures()
assert count_ready() == len(KERNELS) == 12, before
assert all(before[f"{module}.{name}"] == 1 for module, name in KERNELS), before

from fitting.cuffs.cuffs_file import read_cuffs
from station.assessment.assess import assess_cuffs
from station.assessment.assessment_inputs import AssessmentInputs
from tests.station.reported import few_people

assess_cuffs(read_cuffs(file), AssessmentInputs(file), most_frames=3, most_rest_lengths=4, people=few_people(2))
after = signatures()
assert after == before, {name: after[name] for name in after if after[name] != before.get(name)}
"""

CUFFS = {
    name: {
        "stiffness_n_per_m": {"value": k, "standard_error": 40.0},
        "damping_n_s_per_m": {"value": c, "standard_error": 4.0},
        "migration_m": {"value": 0.012, "standard_error": 0.0004},
        "site": "waist" if name == "waist" else "arm",
    }
    for name, k, c in (("waist", 2140.0, 124.0), ("hand", 8520.0, 210.0))
}
COMPILED_BY_A_SHARE = """
import sys
from solver.compile_ahead import SHARES
SHARES[sys.argv[1]]()
from numba.core.dispatcher import Dispatcher
for name, module in list(sys.modules.items()):
    if name.startswith("solver."):
        for value in vars(module).values():
            if isinstance(value, Dispatcher) and value.signatures and value.py_func.__module__ == name:
                print(f"{name}.{value.py_func.__name__}", len(value.signatures))
"""
DYNAMICS = (mass_matrix_and_bias, fill_responses, evaluate_chain)


@pytest.mark.slow
def test_after_it_an_assessment_compiles_nothing_and_it_says_how_many_kernels_are_ready(tmp_path: Path) -> None:
    """In a process without what other tests have compiled: ahead of an assessment, and the assessment."""
    file = tmp_path / "cuffs.json"
    file.write_text(json.dumps({"cuffs": CUFFS}), encoding="utf-8")
    command = [sys.executable, "-c", ASSESS_AFTERWARDS, str(file)]
    ran = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603
    assert (ran.returncode, ran.stderr) == (0, "")
    counts = [json.loads(line) for line in ran.stdout.splitlines()]
    assert counts[-1] == {"ready": 12, "kernels": 12}
    assert [count["ready"] for count in counts] == sorted(count["ready"] for count in counts)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("share", "kernels", "of_others"),
    [
        ("solving", (eliminate, solve_activations, *DYNAMICS), (move_bodies, place_points, evaluate_wrapped_paths)),
        ("dynamics", DYNAMICS, (move_bodies, place_points, evaluate_wrapped_paths, solve_activations, eliminate)),
        ("paths", (evaluate_wrapped_paths,), (move_bodies, place_points, solve_activations, eliminate, *DYNAMICS)),
    ],
)
def test_a_share_compiles_its_kernels_and_none_that_another_process_compiles_meanwhile(
    share: str, kernels: tuple[Any, ...], of_others: tuple[Any, ...]
) -> None:
    """In a process of its own, because this one has compiled some already."""
    command = [sys.executable, "-c", COMPILED_BY_A_SHARE, share]
    ran = subprocess.run(command, capture_output=True, text=True, check=True)  # noqa: S603
    names = {line.split()[0]: int(line.split()[1]) for line in ran.stdout.splitlines()}
    assert all(names.get(_name(kernel)) == 1 for kernel in kernels)
    assert not any(_name(kernel) in names for kernel in of_others)


def _name(kernel: Any) -> str:
    return f"{kernel.py_func.__module__}.{kernel.py_func.__name__}"


def test_every_kernel_is_called_and_counted() -> None:
    counts: list[tuple[int, int]] = []
    compile_ahead.compile_ahead(lambda *count: counts.append(count))
    assert counts == sorted(counts)
    assert counts[-1] == (12, 12)


@pytest.mark.parametrize(
    ("processors", "expected"),
    [(1, ["solving"]), (2, ["solving"]), (3, ["solving", "paths"]), (16, ["solving", "paths", "dynamics"])],
)
def test_more_processors_take_more_shares(processors: int, expected: list[str]) -> None:
    assert list(compile_ahead.shares(processors)) == expected


def test_a_first_use_follows_from_the_files_of_a_kernel(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    assert compile_ahead.is_first_use()
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path))  # read from the environment at the import of numba
    existing: Any = move_bodies
    kernel: Any = compiled_for_python(existing.py_func)
    Path(kernel._cache._cache_file._index_path).touch()
    assert not compile_ahead.is_first_use()
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "missing"))
    assert not compile_ahead.is_first_use(), "numba may keep the files elsewhere"


def test_it_ends_where_nothing_can_be_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiled._NoCache, "is_reported", True)
    with pytest.raises(SystemExit) as ended, compile_ahead.CompilationCount(compile_ahead.print_count):
        compile_ahead.COMPILER.warning("compiling %s", "a kernel")
    assert ended.value.code == 1
