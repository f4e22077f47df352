"""Every compiled iteration of the solver, starved of rounds, says so."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.solver.starved import LIMITS
from tests.timeout import scaled_timeout

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def outcomes() -> dict[str, list[str]]:
    """In a process of its own, in which numba compiles nothing."""
    ran = subprocess.run(
        [sys.executable, "-m", "tests.solver.starved"],
        cwd=ROOT,
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        check=False,
        timeout=scaled_timeout(200),
    )
    assert ran.returncode == 0, ran.stderr
    found: dict[str, list[str]] = json.loads(ran.stdout)
    return found


def test_with_their_rounds_all_iterations_converge(outcomes: dict[str, list[str]]) -> None:
    assert outcomes["opensim"] == outcomes["geodesic"] == ["converged"]
    assert outcomes["frames"] == ["SOLVED"]
    assert outcomes["interior_point"] == ["solved"]


@pytest.mark.parametrize("limit", [f"{module}.{name}" for _, module, name, _ in LIMITS])
def test_a_path_whose_iteration_is_starved_has_not_converged(outcomes: dict[str, list[str]], limit: str) -> None:
    assert "not_converged" in outcomes[limit]


def test_a_frame_whose_last_iteration_is_starved_has_not_converged(outcomes: dict[str, list[str]]) -> None:
    assert outcomes["solver.redundancy.newton.MOST_STEPS"] == ["NOT_CONVERGED"]


def test_an_interior_point_that_is_starved_has_not_converged(outcomes: dict[str, list[str]]) -> None:
    assert outcomes["solver.redundancy.interior_point.MOST_STEPS"] == ["not_converged"]
