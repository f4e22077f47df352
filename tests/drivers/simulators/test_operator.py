from __future__ import annotations

import threading

import pytest

from drivers.simulators.operator import Operator
from drivers.simulators.settings import Settings
from drivers.simulators.world import World


@pytest.fixture
def world() -> World:
    return World(Settings(), speed=None)


def put_at_the_pc(
    world: World, *streams: threading.Event, control: threading.Event | None = None, delay_s: float = 3.0
) -> None:
    taken = control or threading.Event()
    world.clock.follow(Operator(world, delay_s, [stream.is_set for stream in streams], taken.is_set))


def stream(is_on: bool = True) -> threading.Event:
    event = threading.Event()
    if is_on:
        event.set()
    return event


def test_a_capture_starts_some_seconds_after_all_devices_stream(world: World) -> None:
    mocap = stream(is_on=False)
    put_at_the_pc(world, stream(), mocap)
    world.clock.advance(10.0)
    mocap.set()
    world.clock.advance(10.0)
    assert world.capture is not None
    assert 13.0 <= world.capture.start <= 14.0


def test_nothing_starts_while_one_of_them_is_silent(world: World) -> None:
    put_at_the_pc(world, stream(), stream(is_on=False), delay_s=0.0)
    world.clock.advance(10.0)
    assert world.capture is None


def test_a_client_in_control_is_left_alone(world: World) -> None:
    put_at_the_pc(world, stream(), control=stream(), delay_s=0.0)
    world.clock.advance(10.0)
    assert world.capture is None


def test_one_capture_for_each_time_that_streaming_begins(world: World) -> None:
    mocap = stream()
    put_at_the_pc(world, mocap, delay_s=0.0)
    world.clock.advance(2.0)
    world.stop_capture()
    world.clock.advance(10.0)
    assert world.capture is not None
    assert world.capture.number == 1
    mocap.clear()
    world.clock.advance(10.0)
    mocap.set()
    world.clock.advance(2.0)
    assert world.capture is not None and world.capture.number == 2


def test_a_capture_that_still_runs_is_waited_for(world: World) -> None:
    world.start_capture()
    put_at_the_pc(world, stream(), delay_s=0.0)
    world.clock.advance(5.0)
    world.stop_capture()
    world.clock.advance(1.0)
    assert world.capture is not None and world.capture.number == 2
