"""Compile the kernels of an assessment before it needs them: `python -m solver.compile_ahead`.

The machine code is kept on disk (compiled.py), so this can be done once after an installation, or in a second process
while trials are recorded. stdout has one line of JSON per kernel: how many are ready, and how many there are.
"""

from __future__ import annotations

import json
import logging
import os
import signal
import sys
import threading
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from solver import compiled
from solver.bundled import bundled_model
from solver.cuff import CuffParameters
from solver.functions.bezier import follow_chain
from solver.motion import differentiate
from solver.multibody.bodies import move_bodies
from solver.multibody.joint_loads import add_joint_loads
from solver.multibody.masses import mass_matrix_and_bias
from solver.raise_arm import simulate_arm_raise
from solver.redundancy.frames import solve_frames
from solver.redundancy.householder import triangularise
from solver.suit.assessment import assess
from solver.suit.suit import read_suit
from solver.wrapping.moving_points import place_points
from solver.wrapping.tension import evaluate_wrapped_paths

KERNELS: tuple[Any, ...] = (
    move_bodies,
    place_points,
    evaluate_wrapped_paths,
    follow_chain,
    mass_matrix_and_bias,
    add_joint_loads,
    triangularise,
    solve_frames,
)
"""Kernels that an assessment calls, in order of use; a test finds a missing one."""

WITH_PARENT = "--with-parent"
NICENESS = 2
"""The parent goes first, but in the end it waits for this process: at 5 on a busy machine, for minutes."""
FRAMES_APART = 300


def compile_ahead() -> None:
    """Compile what is not on disk yet, and load the rest: assess a suit in three frames of the bundled motion."""
    model = bundled_model()
    suit = read_suit()
    suit = replace(suit, rest_lengths=np.array([suit.reference_rest_length]))
    cuff = CuffParameters("hand", "arm", stiffness=8520.0, damping=210.0, migration=0.012)
    assess(model, differentiate(simulate_arm_raise(model)), suit, [cuff], every=FRAMES_APART, draws=0)


def count_ready() -> int:
    """How many of KERNELS this process has compiled or loaded."""
    return sum(bool(kernel.signatures) for kernel in KERNELS)


class CompilationCount(logging.Handler):
    """Counts kernels instead of the warning that each is being compiled: report(ready, all) before and after each."""

    def __init__(self, report: Callable[[int, int], None]) -> None:
        super().__init__()
        self._report = report

    def emit(self, record: logging.LogRecord) -> None:  # noqa: ARG002 (that a kernel is compiled is all that counts)
        self._report(count_ready(), len(KERNELS))

    def __enter__(self) -> CompilationCount:
        compiled.logger.addHandler(self)
        return self

    def __exit__(self, *_: object) -> None:
        compiled.logger.removeHandler(self)


def main() -> None:
    """With --with-parent this process yields to others, and ends when its standard input does."""
    if WITH_PARENT in sys.argv[1:]:
        _follow_parent()
    with CompilationCount(_print_count):
        compile_ahead()
    _print_count(count_ready(), len(KERNELS))


def _follow_parent() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C goes to both; the parent decides
    if hasattr(os, "nice"):
        os.nice(NICENESS)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    sys.stdin.buffer.read()
    os._exit(1)  # at once: what is on disk is whole, since numba renames its files into place


def _print_count(ready: int, total: int) -> None:
    print(json.dumps({"ready": ready, "kernels": total}), flush=True)


if __name__ == "__main__":
    main()
