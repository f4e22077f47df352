"""Calls of every kernel with little work, for compilation ahead of its use (compile_ahead.py)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from solver.bundled import bundled_model, simulate_arm_raise
from solver.cuff import CuffParameters
from solver.drawing import path_lines
from solver.inverse_kinematics.solve import TrackingTasks, posture_uncertainty
from solver.model import Marker, Model
from solver.motion import differentiate
from solver.multibody.postures import points_in_ground, postures
from solver.personalisation.estimate import estimate_body
from solver.redundancy.motion_solution import LoadedMotion
from solver.stream.stream_solver import StreamSolver
from solver.suit.assessment import assess
from solver.suit.suit import read_suit

SKIN_MARKERS = ("ij", "px", "c7", "t8", "ac", "aa", "ts", "ai", "EpL", "EpM")
FRAMES_APART = 300


def call_every_kernel() -> None:
    """Assess a suit in three frames of the bundled motion, estimate a body, and solve a stream of markers."""
    model = bundled_model()
    suit = read_suit()
    suit = replace(suit, rest_lengths=np.array([suit.reference_rest_length]))
    cuff = CuffParameters("hand", "arm", stiffness=8520.0, damping=210.0, migration=0.012)
    motion = LoadedMotion(model, differentiate(simulate_arm_raise(model)))
    assess(motion, suit, [cuff], every=FRAMES_APART)
    path_lines(model, postures(model, motion.kinematics.positions[:1], motion.kinematics.speeds[:1]))
    observed = _estimate_a_body(model, motion.kinematics.positions[:: FRAMES_APART // 3])
    _stream(model, observed)


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
