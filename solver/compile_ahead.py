"""Compile the kernels of an assessment before it needs them: `python -m solver.compile_ahead`.

The machine code is kept on disk (compiled.py), so this can be done once after an installation, or in a second process
while trials are recorded. A second process beside one that needs the kernels now begins with the last ones
(--last-first), so that both together take half the time. stdout has one line of JSON per kernel: how many are ready,
and how many there are.
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
from numpy.typing import NDArray

from solver import compiled
from solver.bundled import bundled_model
from solver.cuff import CuffParameters
from solver.functions.bezier import evaluate_chain
from solver.inverse_kinematics.information import fill_information
from solver.inverse_kinematics.sensitivity import fill_sensitivities
from solver.inverse_kinematics.sequence import solve_frames as solve_postures
from solver.inverse_kinematics.solve import TrackingTasks
from solver.inverse_kinematics.uncertainty import posture_uncertainty
from solver.model import Marker, Model
from solver.motion import differentiate
from solver.multibody.bodies import move_bodies
from solver.multibody.dynamics import equations_of_motion, response_to_loads
from solver.multibody.masses import mass_matrix_and_bias
from solver.multibody.postures import points_in_ground, postures
from solver.multibody.responses import fill_responses
from solver.path_lines import path_lines
from solver.personalisation.estimate import estimate_body
from solver.raise_arm import simulate_arm_raise
from solver.redundancy.elimination import eliminate
from solver.redundancy.frames import solve_frames
from solver.redundancy.sequence import FrameSequence, solve_sequence
from solver.stream.fixed_lag import smooth_window
from solver.stream.stream_solver import StreamSolver
from solver.suit.assessment import assess
from solver.suit.scenarios import LoadedMotion
from solver.suit.suit import read_suit
from solver.suit.uncertainty import DrawSettings
from solver.wrapping.moving_points import place_points
from solver.wrapping.path_nodes import place_path_nodes
from solver.wrapping.tension import evaluate_wrapped_paths

KERNELS: tuple[Any, ...] = (
    move_bodies,
    place_points,
    evaluate_wrapped_paths,
    evaluate_chain,
    mass_matrix_and_bias,
    fill_responses,
    eliminate,
    solve_frames,
    solve_postures,
    fill_sensitivities,
    fill_information,
    smooth_window,
    place_path_nodes,
)
"""Kernels that an assessment and its drawings call, in order of use; a test finds a missing one."""

SKIN_MARKERS = ("ij", "px", "c7", "t8", "ac", "aa", "ts", "ai", "EpL", "EpM")
WITH_PARENT = "--with-parent"
LAST_FIRST = "--last-first"
NICENESS = 2
"""The parent has priority, but finally waits for this process: with 5 on a busy machine, for minutes."""
FRAMES_APART = 300


def compile_ahead() -> None:
    """Compile what is not on disk yet, and load the rest: assess a suit in three frames of the bundled motion."""
    model = bundled_model()
    suit = read_suit()
    suit = replace(suit, rest_lengths=np.array([suit.reference_rest_length]))
    cuff = CuffParameters("hand", "arm", stiffness=8520.0, damping=210.0, migration=0.012)
    motion = LoadedMotion(model, differentiate(simulate_arm_raise(model)))
    assess(motion, suit, [cuff], every=FRAMES_APART, draws=DrawSettings(count=0))
    path_lines(model, postures(model, motion.kinematics.positions[:1], motion.kinematics.speeds[:1]))
    observed = _estimate_a_body(model, motion.kinematics.positions[:: FRAMES_APART // 3])
    _stream(model, observed)


def compile_last_first() -> None:
    """Compile what a first process needs after the muscle paths, which take it longest, and then the rest.

    Nothing of this needs the paths: to call what does, this process would wait until the first has compiled them.
    """
    one, equation, no_cone = np.ones(1), np.ones((1, 1, 1)), np.zeros((1, 3, 1))
    problem = FrameSequence(one, equation, equation, no_cone, np.eye(1, 3)[None], rise=one, fall=one)
    solve_sequence(problem, progress=lambda *_: None, workers=1)
    model = bundled_model()
    rest = model.default_coordinates[None]
    equations = equations_of_motion(model, postures(model, rest, np.zeros_like(rest)))
    response_to_loads(equations, np.zeros((1, 1, len(model.bodies), 6)))
    compile_ahead()


def _estimate_a_body(model: Model, coordinates: NDArray[np.float64]) -> NDArray[np.float64]:
    """From the markers of a few postures (frames, markers, 3), which are returned, with its uncertainty."""
    markers = _skin_markers(model)
    state = postures(model, coordinates, np.zeros_like(coordinates))
    observed = np.stack([points_in_ground(state, marker.body, marker.location) for marker in markers], axis=1)
    estimate = estimate_body(model, markers, [observed])
    posture_uncertainty(estimate.model, observed, estimate.tasks, estimate.postures[0], 1e-3)
    return observed


def _stream(model: Model, observed: NDArray[np.float64]) -> None:
    """A few frames of markers (frames, markers, 3), frame by frame."""
    markers = _skin_markers(model)
    stream = StreamSolver(model, TrackingTasks(markers, np.ones(len(markers))), {"bare": None}, lag_s=0.0)
    for frame, positions in enumerate(observed):
        stream.push(float(frame), positions)


def _skin_markers(model: Model) -> tuple[Marker, ...]:
    return tuple(marker for marker in model.markers if marker.name in SKIN_MARKERS)


def count_ready() -> int:
    """How many of KERNELS this process has compiled or loaded."""
    return sum(bool(kernel.signatures) for kernel in KERNELS)


class CompilationCount(logging.Handler):
    """Counts kernels in place of the warnings of compiled.py: report(ready, all) before and after each kernel."""

    def __init__(self, report: Callable[[int, int], None]) -> None:
        super().__init__()
        self._report = report

    def emit(self, record: logging.LogRecord) -> None:  # noqa: ARG002 (the event itself is enough)
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
        compile_last_first() if LAST_FIRST in sys.argv[1:] else compile_ahead()
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
