"""World time: who moves it, how far, and who cannot hold it up."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable

import pytest

from drivers.simulators import world_clock
from drivers.simulators.world_clock import LONGEST_STEP_S, ClockStopped, WorldClock
from tests.timeout import scaled_timeout

PATIENCE_S = 30.0  # wall; a bound on failing tests, not an expectation


class Device:
    """Notes its steps; a laggard until it is dropped where it is made so."""

    def __init__(self, is_behind: bool = False) -> None:
        self.steps: list[float] = []
        self.is_behind = is_behind

    def step(self, now: float) -> None:
        self.steps.append(now)

    def find_slow_client(self) -> str | None:
        return "a client of the test" if self.is_behind else None

    def drop_slow_client(self) -> None:
        self.is_behind = False


class Wall:
    """A wall clock that a test moves."""

    def __init__(self) -> None:
        self.seconds = 100.0

    def __call__(self) -> float:
        return self.seconds


class PassingWall(Wall):
    """A wall clock on which time passes with every look at it."""

    def __init__(self, look_s: float) -> None:
        super().__init__()
        self.look_s = look_s

    def __call__(self) -> float:
        self.seconds += self.look_s
        return self.seconds


def comes_true(claim: Callable[[], bool]) -> bool:
    give_up_s = time.perf_counter() + scaled_timeout(PATIENCE_S)
    while not claim() and time.perf_counter() < give_up_s:
        threading.Event().wait(0.001)
    return claim()


def test_without_a_speed_it_stops_until_it_is_advanced() -> None:
    clock, device = WorldClock(None), Device()
    clock.follow(device)
    assert clock.advance(1.2) == pytest.approx(1.2)
    assert clock.now() == pytest.approx(1.2)
    assert device.steps == pytest.approx([LONGEST_STEP_S, 2 * LONGEST_STEP_S, 1.2]), "in steps, to the very moment"
    clock.stop()


def test_every_device_has_made_the_step_when_the_station_receives_the_reply() -> None:
    clock, devices = WorldClock(None), [Device(), Device()]
    for device in devices:
        clock.follow(device)
    with clock.attach() as station:
        for until in (0.1, 0.2, 0.3):
            assert station.advance_to(until) == until
            assert [device.steps[-1] for device in devices] == [until, until]
    clock.stop()


def test_it_goes_no_farther_than_the_slowest_station_allows() -> None:
    clock = WorldClock(None)
    with clock.attach("slow") as slow, clock.attach("fast") as fast:
        ahead = threading.Thread(target=fast.advance_to, args=(10.0,), daemon=True)
        ahead.start()
        assert slow.advance_to(0.25) == 0.25
        assert clock.now() == 0.25
        slow.advance_to(10.0)
        ahead.join(scaled_timeout(PATIENCE_S))
        assert not ahead.is_alive()
    clock.stop()


def test_with_a_speed_it_never_runs_ahead_of_its_pace() -> None:
    clock, device = WorldClock(50.0), Device()
    began_s = time.perf_counter()
    clock.follow(device)
    assert comes_true(lambda: clock.now() > 2.0)
    now, elapsed_s = clock.now(), time.perf_counter() - began_s
    assert now <= 50.0 * elapsed_s
    clock.stop()


def test_the_pace_of_a_station_ends_with_it_and_the_slowest_counts() -> None:
    clock = WorldClock(1.0)
    with clock.attach("fast", speed=30.0):
        assert clock.speed == 30.0
        with clock.attach("slow", speed=12.0):
            assert clock.speed == 12.0
        assert clock.speed == 30.0
    assert clock.speed == 1.0
    clock.stop()


def test_a_world_that_stopped_for_long_does_not_catch_up_with_wall_time() -> None:
    wall = Wall()
    clock, device = WorldClock(1.0, wall), Device()
    clock.follow(device)
    wall.seconds += 3600.0
    assert comes_true(lambda: len(device.steps) > 5)
    wall.seconds += 3600.0
    assert comes_true(lambda: len(device.steps) > 15)
    assert clock.now() < 1.0, "the hours are not made up for"
    clock.stop()


def test_the_time_that_devices_take_for_a_step_does_not_slow_the_world() -> None:
    wall = PassingWall(0.00025)

    class Worker(Device):
        def step(self, now: float) -> None:
            super().step(now)
            wall.seconds += 0.004

    clock = WorldClock(None, wall=wall)
    clock.follow(Worker())
    with clock.attach(speed=1.0) as station:
        begun_s = wall()
        for step in range(1, 11):
            station.advance_to(0.008 * step)
        assert wall() - begun_s == pytest.approx(0.08, abs=0.015), "0.12 s if every step began after the one before"
    clock.stop()


def test_its_rate_is_what_it_made_of_the_wall_s_time() -> None:
    wall = Wall()
    clock = WorldClock(None, wall)
    assert clock.rate() is None
    with clock.attach() as station:
        for step in range(1, 5):
            station.advance_to(0.5 * step)
            wall.seconds += 1.0
    assert clock.rate() == pytest.approx(1.5 / 4.0), "from the first step on"
    clock.stop()


def test_a_client_that_takes_nothing_holds_the_world_back_and_is_dropped_with_a_message(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(world_clock, "DROP_AFTER_S", 0.05)
    clock, device = WorldClock(100.0), Device(is_behind=True)
    with caplog.at_level(logging.WARNING):
        clock.follow(device)
        assert comes_true(lambda: clock.now() > 1.0)
    assert not device.is_behind
    assert "a client of the test has read nothing for 0.05 s and is dropped" in caplog.text
    clock.stop()


def test_a_station_that_asks_for_nothing_is_detached_with_a_message(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(world_clock, "IDLE_TIMEOUT_S", 0.05)
    clock = WorldClock(100.0)
    clock.follow(Device())
    with caplog.at_level(logging.WARNING), clock.attach("asleep") as station:
        before = clock.now()
        assert comes_true(lambda: clock.now() > before + 1.0), "the world goes on"
        with pytest.raises(ClockStopped, match="asleep was idle for"):
            station.advance_to(1e6)
    assert "asleep was idle for 0.05 s and is detached" in caplog.text
    clock.stop()


def test_a_waiting_station_receives_the_end_of_the_world() -> None:
    clock = WorldClock(1.0)
    told: list[str] = []

    def wait() -> None:
        try:
            clock.advance(1e9)
        except ClockStopped as error:
            told.append(str(error))

    waiting = threading.Thread(target=wait)
    waiting.start()
    clock.stop()
    waiting.join(scaled_timeout(PATIENCE_S))
    assert told == ["the simulated bench has ended"]


def test_a_device_that_fails_ends_the_world_in_a_sentence() -> None:
    class Broken(Device):
        def step(self, now: float) -> None:
            raise ZeroDivisionError("oops")

    clock = WorldClock(None)
    clock.follow(Broken())
    with pytest.raises(ClockStopped, match="the simulated bench failed: ZeroDivisionError: oops"):
        clock.advance(1.0)
