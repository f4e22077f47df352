"""Hands that follow a page: a weight hangs when it was asked for, and no sooner."""

from __future__ import annotations

import math

import numpy as np
import pytest

from drivers.simulators.settings import settings_from_dict
from drivers.simulators.world import World

LED = {
    "operator": {"capture": "remote", "hands": "led"},
    "protocol": {"static": {"step_masses_kg": [2.0, 2.0]}, "dynamic": {"swing_s": 4.0}},
}
WEIGHT_N = 2.0 * 9.80665


def world_of(**changes: object) -> World:
    return World(settings_from_dict({**LED, **changes}), speed=None)


def force_after(world: World, seconds: float) -> float:
    """Advance by `seconds`; mean force [N] of their second half."""
    start = world.clock.now()
    world.clock.advance(seconds)
    return float(world.cell_force(np.linspace(start + seconds / 2, start + seconds, 200)).mean())


def test_each_weight_waits_for_its_step_however_long_that_takes() -> None:
    world = world_of()
    world.select_trial(next(iter(world.settings.cuffs)), "static")
    capture = world.start_capture()
    assert math.isinf(capture.end)
    empty = force_after(world, 30.0)
    levels = []
    for step in (1, 2, 3, 4):
        world.follow(step)
        levels.append(force_after(world, 5.0 + 7.0 * (step == 2)) - empty)
    assert levels == pytest.approx([WEIGHT_N, 2 * WEIGHT_N, WEIGHT_N, 0.0], abs=0.7)
    running = world.capture
    assert running is not None and math.isinf(running.end)
    world.follow(5)
    world.clock.advance(1.0)
    ended = world.capture
    assert ended is not None and ended.end <= world.now()


def test_a_swing_begins_when_it_is_asked_for_and_ends_by_itself() -> None:
    world = world_of()
    world.select_trial(next(iter(world.settings.cuffs)), "dynamic")
    world.start_capture()
    times = world.clock.now() + np.linspace(0.0, 20.0, 2000)
    world.clock.advance(20.0)
    assert np.ptp(world.cell_force(times)) < 1.0
    world.follow(1)
    begun = world.capture
    assert begun is not None and world.now() < begun.end < world.now() + 30.0
    world.clock.advance(begun.end - world.now())
    assert np.ptp(world.cell_force(np.linspace(begun.end - 8.0, begun.end, 2000))) > 10.0


def test_hands_by_the_script_take_no_steps() -> None:
    world = world_of(operator={"capture": "remote"})
    capture = world.start_capture()
    world.follow(3)
    assert world.capture == capture and math.isfinite(capture.end)
