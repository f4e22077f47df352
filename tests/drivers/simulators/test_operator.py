from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

from drivers.simulators.operator import Operator
from drivers.simulators.settings import Settings
from drivers.simulators.world import World

PATIENCE_S = 10.0


@pytest.fixture
def world() -> World:
    return World(Settings(), speed=100.0)


def comes_true(claim: Callable[[], bool]) -> bool:
    """Whether it does, in a bounded time."""
    give_up = time.monotonic() + PATIENCE_S
    while not claim() and time.monotonic() < give_up:
        threading.Event().wait(0.002)
    return claim()


@contextmanager
def at_the_pc(
    world: World, *streams: threading.Event, control: threading.Event | None = None, delay_s: float = 3.0
) -> Iterator[None]:
    taken = control or threading.Event()
    operator = Operator(world, delay_s, [stream.is_set for stream in streams], taken.is_set)
    operator.start()
    yield
    operator.stop()


def stream(is_on: bool = True) -> threading.Event:
    event = threading.Event()
    if is_on:
        event.set()
    return event


def test_a_capture_starts_some_seconds_after_all_devices_stream(world: World) -> None:
    mocap = stream(is_on=False)
    with at_the_pc(world, stream(), mocap):
        began = world.now()
        mocap.set()
        assert comes_true(lambda: world.capture is not None)
    assert world.capture is not None
    assert world.capture.start >= began + 3.0


def test_nothing_starts_while_one_of_them_is_silent(world: World) -> None:
    with at_the_pc(world, stream(), stream(is_on=False), delay_s=0.0):
        comes_true(lambda: world.now() > 10.0)
        assert world.capture is None


def test_a_client_in_control_is_left_alone(world: World) -> None:
    with at_the_pc(world, stream(), control=stream(), delay_s=0.0):
        comes_true(lambda: world.now() > 10.0)
        assert world.capture is None


def test_one_capture_for_each_time_that_streaming_begins(world: World) -> None:
    mocap = stream()
    with at_the_pc(world, mocap, delay_s=0.0):
        assert comes_true(lambda: world.capture is not None)
        world.stop_capture()
        began = world.now()
        comes_true(lambda: world.now() > began + 10.0)
        assert world.capture is not None
        assert world.capture.number == 1
        mocap.clear()
        comes_true(lambda: world.now() > began + 20.0)
        mocap.set()
        assert comes_true(lambda: world.capture is not None and world.capture.number == 2)


def test_a_capture_that_still_runs_is_waited_for(world: World) -> None:
    world.start_capture()
    with at_the_pc(world, stream(), delay_s=0.0):
        began = world.now()
        comes_true(lambda: world.now() > began + 5.0)
        world.stop_capture()
        assert comes_true(lambda: world.capture is not None and world.capture.number == 2)
