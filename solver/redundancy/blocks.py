"""Blocks of a motion, evaluated and solved one after the other, each from the activations at the end of the one before.

The arrays of a motion take 45 kB per frame, and new memory for them as long as half of the arithmetic. The memory of a
block is used again for the next one: of a block only its solution is kept.

In a regular motion the solution is that of all frames at once: all frames are finite, no constraint is redundant, and
all blocks have the same structure. Any other motion is solved as a whole, because then the solution of a frame depends
on all of them.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from solver.errors import SolverError
from solver.multibody.dynamics import EquationsOfMotion
from solver.redundancy.motion_solution import MotionSolution
from solver.redundancy.sequence import (
    OUTCOME_OF_CODE,
    BlockSolver,
    FrameOutcome,
    FrameSequence,
    Outcomes,
    Progress,
    determined,
)

Array = NDArray[np.float64]

FRAMES_AT_ONCE = 256
"""A block takes 1 ms for the calls of its stages, which is 4 µs a frame, and 12 MB with 33 muscles."""
KEPT = 60_000_000  # bytes, at most


def blocks_of(frames: int, size: int) -> list[slice]:
    """Blocks of equal length, as near to this size as possible."""
    edges = np.linspace(0, frames, max(round(frames / size), 1) + 1).astype(int).tolist()
    return [slice(start, end) for start, end in pairwise(edges)]


class IrregularMotion(SolverError):
    """A block does not show how all frames have to be solved; caught by solve_motion, which then solves all at once."""

    def __init__(self) -> None:
        super().__init__("the motion cannot be solved in blocks")


class BlockRun:
    """The compiled solver for one scenario, called with the blocks of a motion in turn."""

    def __init__(self) -> None:
        self._solver = BlockSolver()
        self._weights: Array | None = None

    def solve(
        self,
        block: FrameSequence,
        progress: Progress,  # noqa: ARG002 (the caller counts blocks)
        workers: int | None,  # noqa: ARG002 (one scenario)
    ) -> tuple[Array, Outcomes]:
        """As solve_sequence. Raises IrregularMotion where the compiled solver cannot solve the block, or not as those
        before.
        """
        weights = determined(block.weights, block.matrix, block.cone_matrix)
        if self._weights is None:
            self._weights = weights
        if block.has_limits or not np.array_equal(weights, self._weights):
            raise IrregularMotion
        scenarios, frames = block.target.shape[:2]
        controls, codes = np.empty((scenarios, frames, len(weights))), np.empty((scenarios, frames), np.int8)
        if not self._solver.solve(replace(block, weights=weights), controls, codes, map):
            raise IrregularMotion
        return controls, OUTCOME_OF_CODE[codes]


def ensure_regular(equations: EquationsOfMotion, solution: MotionSolution) -> None:
    """Raise IrregularMotion for a block with redundant constraints or with frames that are not finite."""
    if not equations.is_regular or FrameOutcome.NOT_FINITE in solution.outcomes:
        raise IrregularMotion


def keep_freed_memory() -> None:
    """Have this process keep the memory that a block frees for the next one; it costs no more than two system calls.

    The GNU C library gives memory at the end of its heap back where that is more than twice the largest array freed so
    far, and a block has many arrays of similar size. To get a page of 4 kB again takes 2 µs.
    """
    np.empty(KEPT // 2, np.int8)  # freed at once, untouched
