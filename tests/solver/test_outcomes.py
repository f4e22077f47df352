"""Every compiled iteration of the solver, starved of rounds, says so."""

import ast
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
    assert outcomes["opensim_outcomes"] == outcomes["geodesic_outcomes"] == outcomes["curve_outcomes"] == ["converged"]
    assert outcomes["frame_outcomes"] == outcomes["interior_point_outcomes"] == ["solved"]


@pytest.mark.parametrize("limit", LIMITS)
def test_an_iteration_at_its_limit_has_not_converged(outcomes: dict[str, list[str]], limit: str) -> None:
    expected = "curve_not_converged" if "bezier" in limit else "not_converged"
    assert expected in outcomes[limit]


def test_no_iteration_is_left_out() -> None:
    """Inverse kinematics and personalisation have tests of their own outcomes."""
    elsewhere = {"inverse_kinematics", "personalisation"}
    sources = [file for file in (ROOT / "solver").rglob("*.py") if not elsewhere & {*file.parts}]
    found = {
        f"{'.'.join(file.relative_to(ROOT).with_suffix('').parts)}.{name.id}"
        for file in sources
        for loop in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(loop, ast.For)
        for name in ast.walk(loop.iter)
        if isinstance(name, ast.Name) and (name.id.startswith("MOST_") or name.id.endswith("_STEPS"))
    }
    assert found - LIMITS.keys() == {
        "solver.bundled.MOST_STEPS",  # raises
        "solver.cuff.MOST_STEPS",  # raises
        "solver.suit.cord.MOST_STEPS",  # a suit whose forces do not balance within a residual is refused
        "solver.uncertainty.people.MOST_EXTENSIONS",  # an optimum that is still at an end is NaN
        "solver.wrapping.sphere_and_cylinder.MOST_PARAMETERS",  # of a step, as in MINPACK, which takes the last one
        "solver.wrapping.ellipsoid.MOST_TRIALS",  # of a step; the iteration around it has the outcome
    }
