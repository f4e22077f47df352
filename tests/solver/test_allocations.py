"""Compiled code allocates once for all frames: what threads allocate, they wait for each other for."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest
from numba.core.runtime import _nrt_python, rtsys

from solver.bundled import bundled_model
from solver.motion import decimate, differentiate
from solver.paths import PathMode
from solver.raise_arm import simulate_arm_raise
from solver.redundancy.mechanics import evaluate_motion
from solver.redundancy.motion_solution import solve_motion
from solver.redundancy.problem import FrameOutcome, LoadResponse, build_redundancy
from solver.redundancy.redundancy_options import RedundancyOptions
from solver.redundancy.sequence import solve_redundancy

MODEL = bundled_model()
MOTION = differentiate(simulate_arm_raise(MODEL))


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
