"""The bundled arm raise as a stream of markers, with a suit on the body."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from solver.bundled import Array, bundled_model, simulate_arm_raise
from solver.cuff import CuffParameters
from solver.inverse_kinematics.solve import TrackingTasks
from solver.redundancy.mechanics import CENTER_MARKER, EDGE_MARKER, HEAD_MARKER
from solver.stream.frame_muscles import StreamScenario
from solver.stream.stream_frame import StreamFrame
from solver.stream.stream_solver import StreamSolver
from solver.suit.suit import read_suit
from tests.solver.inverse_kinematics.marked import seen_from, with_markers

SKIN = with_markers(bundled_model()).markers
GLENOID = tuple(bundled_model().marker(name) for name in (CENTER_MARKER, HEAD_MARKER, EDGE_MARKER))
MODEL = replace(bundled_model(), markers=(*SKIN, *GLENOID))
TASKS = TrackingTasks(SKIN, np.ones(len(SKIN)))
NAMES = tuple(marker.name for marker in SKIN)
SUIT = read_suit()
ARM = CuffParameters("hand", "arm", stiffness=8520.0, damping=210.0, migration=0.012)
WAIST = CuffParameters("waist", "waist", stiffness=2140.0, damping=124.0, migration=0.012)
WORN = StreamScenario(SUIT.reference_rest_length, "both", WAIST, ARM)
INTERVAL, NOISE = 0.01, 2e-4
FIRST, FRAMES = 100, 60
"""Frames of the arm raise that are streamed: it is under way."""


@cache
def raised() -> Array:
    """(frames, coordinates) of the arm raise."""
    return simulate_arm_raise(bundled_model()).coordinates


@cache
def clean() -> Array:
    """(frames, markers, 3) without noise."""
    return seen_from(MODEL, raised()[FIRST : FIRST + FRAMES], SKIN)


@cache
def seen() -> Array:
    """(frames, markers, 3) with noise."""
    return clean() + NOISE * np.random.default_rng(3).standard_normal(clean().shape)


def solver(scenarios: Mapping[str, StreamScenario | None] | None = None, **options: Any) -> StreamSolver:
    return StreamSolver(MODEL, TASKS, {"bare": None} if scenarios is None else scenarios, suit=SUIT, **options)


def stream(pushed: Iterable[Array], to: StreamSolver | None = None, interval: float = INTERVAL) -> list[StreamFrame]:
    """Push frames at even times, and finish."""
    to, found = to or solver(), []
    for k, positions in enumerate(pushed):
        found += to.push(k * interval, positions)
    return [*found, *to.finish()]
