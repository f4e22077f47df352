"""The World and its clock at times that a test chooses."""

import logging
import math
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.simulators import world_clock
from drivers.simulators.errors import SimulatorCode
from drivers.simulators.settings import settings_from_dict
from drivers.simulators.world import Capture, World
from drivers.simulators.world_clock import LONGEST_STEP_S, ClockStopped, WorldClock
from tests.refusals import raises_refusal
from tests.timeout import scaled_timeout

SHORT = {"repeats": 1, "static": {"hold_s": 3.0, "lead_in_s": 1.0}, "dynamic": {"swing_s": 6.0}}
LED = {
    "operator": {"capture": "remote", "hands": "led"},
    "protocol": {"static": {"step_masses_kg": [2.0, 2.0]}, "dynamic": {"swing_s": 4.0}},
}
WEIGHT_N = 2.0 * 9.80665
PATIENCE_S = 30.0  # wall; a bound on failing tests, not an expectation


def world(**settings: Any) -> World:
    return World(settings_from_dict({"protocol": SHORT, **settings}), speed=None, seed=2)


def go_to(bench: World, world_time: float) -> None:
    bench.clock.advance(world_time - bench.now())


def play(bench: World) -> tuple[Capture, NDArray[np.float64]]:
    """One whole capture, half a minute from now; its times at 100 Hz."""
    go_to(bench, bench.now() + 30.0)
    capture = bench.start_capture()
    go_to(bench, capture.end + 5.0)
    return capture, np.arange(capture.start, capture.end - 1e-6, 0.01)


def test_a_capture_lasts_whole_frames_also_when_it_is_stopped() -> None:
    bench = world()
    ended, _ = play(bench)
    bench.start_capture()
    go_to(bench, bench.now() + 1.2345)
    for capture in (ended, bench.stop_capture()):
        frames = (capture.end - capture.start) * bench.settings.mocap.rate_hz
        assert frames == pytest.approx(round(frames), abs=1e-6)


def test_the_sync_line_is_high_exactly_during_the_capture_and_low_where_it_is_inverted() -> None:
    bench, inverted = world(), world(sync={"is_inverted": True, "low_v": 0.2, "high_v": 4.8})
    capture, t = play(bench)
    around = np.array([capture.start - 0.001, *t[[0, -1]], capture.end, capture.end + 1])
    assert bench.sync_voltage(around).tolist() == [0.0, 5.0, 5.0, 0.0, 0.0]
    capture, _ = play(inverted)
    assert inverted.sync_voltage(np.array([capture.start - 1, capture.start + 1])).tolist() == [4.8, 0.2]


def test_a_capture_starts_after_all_earlier_requests_to_the_devices() -> None:
    bench = world()
    go_to(bench, 10.0)
    bench.sync_voltage(np.array([10.2]))  # a device whose clock runs ahead a little
    assert bench.start_capture().start >= 10.2


def test_a_stopped_capture_lowers_the_line_and_unloads_the_cuff() -> None:
    bench = world()
    go_to(bench, 5.0)
    bench.start_capture()
    go_to(bench, 12.0)
    capture = bench.stop_capture()
    go_to(bench, 30.0)
    assert capture.end == pytest.approx(12.0)
    assert bench.sync_voltage(np.array([11.9, 12.1])).tolist() == [5.0, 0.0]
    assert bench.cell_force(np.array([11.9]))[0] > 30.0
    assert bench.cell_force(np.array([20.0]))[0] == pytest.approx(2.0, abs=0.2)


def test_the_amplifier_gives_its_full_scale_at_capacity_above_its_zero_and_5_mv_of_noise() -> None:
    bench = world(amplifier={"zero_v": 0.1})
    _, t = play(bench)
    volts, newtons = bench.amplifier_voltage(t), bench.cell_force(t)
    assert (volts - newtons * 5.0 / (50 * 9.80665)).mean() == pytest.approx(0.1, abs=1e-3)
    assert (volts - newtons * 5.0 / (50 * 9.80665)).std() == pytest.approx(0.005, rel=0.1)


def test_the_plan_is_played_in_order_and_every_cuff_is_donned_once() -> None:
    bench = world()
    played, slips = [], []
    for _ in range(5):
        capture, _ = play(bench)
        played.append((capture.trial.cuff, capture.trial.test))
        slips.append(bench.truth()["slip_m"][capture.trial.cuff])
    order = ["waist", "static"], ["waist", "dynamic"], ["hand", "static"], ["hand", "dynamic"], ["tube", "static"]
    assert [list(trial) for trial in played] == list(order)
    assert slips[0] == slips[1] > 0.01, "what slipped stays until the cuff is donned again"
    bench.don("tube")
    assert slips[4] > 0.005 and bench.truth()["slip_m"]["tube"] == 0.0


def test_the_session_of_a_cuff_ends_near_its_configured_migration() -> None:
    bench = world(cuffs={"tube": {"migration_m": 0.015}})
    bench.select_trial("tube", "static")
    for _ in range(3):
        play(bench)
    assert bench.truth()["slip_m"]["tube"] == pytest.approx(0.015, rel=0.05)


def test_unloaded_the_cuff_has_moved_by_what_slipped() -> None:
    bench = world(mocap={"noise_mm": 0.0, "occlusions_per_minute": 0}, wearer={"sway_mm": 0, "sway_deg": 0})
    bench.select_trial("elbow", "static")
    capture, _ = play(bench)
    before, after = bench.markers(np.array([capture.start + 0.5, capture.end - 0.5]))[:, bench.labels.index("cuff_1")]
    assert np.linalg.norm(after - before) * 1e-3 == pytest.approx(bench.truth()["slip_m"]["elbow"], rel=1e-3)


def test_after_hours_without_anyone_looking_the_cuff_still_hangs_at_rest() -> None:
    bench = world()
    go_to(bench, 20 * 3600.0)
    assert bench.cell_force(np.array([bench.now()]))[0] == pytest.approx(2.0, abs=0.3)


def test_the_same_seed_gives_the_same_world_whatever_the_devices_did_before() -> None:
    forces = []
    for is_sampled in (False, True):
        bench = world()
        play(bench)
        if is_sampled:
            bench.amplifier_voltage(np.linspace(bench.now() - 1, bench.now(), 777))
        _, t = play(bench)
        forces.append(bench.cell_force(t[::50]))
    assert np.array_equal(*forces)


def test_how_often_devices_look_does_not_change_what_happens() -> None:
    forces = []
    for looks in (3, 400):
        bench = world()
        go_to(bench, 5.0)
        capture = bench.start_capture()
        for moment in np.linspace(capture.start, capture.end, looks):
            go_to(bench, float(moment))
            bench.sync_voltage(np.array([moment]))
        forces.append(bench.cell_force(np.linspace(capture.start, capture.end - 0.1, 500)))
    assert forces[0] == pytest.approx(forces[1], abs=1e-9)


def test_a_device_that_lags_behind_still_sees_the_end_of_the_capture() -> None:
    """On a busy machine one device asks for seconds after the capture before the other asked for its end."""

    def seen(is_late: bool) -> NDArray[np.float64]:
        bench = world()
        capture, t = play(bench)
        if is_late:
            bench.cell_force(np.array([capture.end + 4.0]))
        return bench.markers(t[-200:])

    np.testing.assert_array_equal(seen(is_late=True), seen(is_late=False))


def test_what_cannot_be_done_is_refused_in_a_sentence() -> None:
    bench = world()
    with raises_refusal(SimulatorCode.NO_CAPTURE):
        bench.stop_capture()
    with raises_refusal(SimulatorCode.UNKNOWN_TRIAL, "cuffs are waist, hand, tube, elbow"):
        bench.select_trial("foot", "static")
    go_to(bench, 5.0)
    bench.start_capture()
    with raises_refusal(SimulatorCode.CAPTURE_RUNNING):
        bench.start_capture()
    with raises_refusal(SimulatorCode.CAPTURE_RUNNING, "waist static"):
        bench.don("hand")


def test_devices_in_many_threads_see_one_world() -> None:
    def begun() -> tuple[World, Capture]:
        bench = world()
        go_to(bench, 2.0)
        return bench, bench.start_capture()

    bench, capture = begun()
    moments = np.linspace(capture.start, capture.end - 0.1, 200)
    seen: list[NDArray[np.float64]] = []

    def look() -> None:
        seen.append(np.concatenate([bench.cell_force(np.array([moment])) for moment in moments]))

    threads = [threading.Thread(target=look) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    alone = begun()[0].cell_force(moments)
    assert len(seen) == 4
    assert all(forces == pytest.approx(alone, abs=1e-9) for forces in seen)


# Hands that follow a page: a weight hangs when it was asked for, and no sooner.


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
    """A wall clock that a test moves, and that moves by look_s with every look at it."""

    def __init__(self, look_s: float = 0.0) -> None:
        self.seconds, self._look_s = 100.0, look_s

    def __call__(self) -> float:
        self.seconds += self._look_s
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
    wall = Wall(0.00025)

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
    reported: list[str] = []

    def wait() -> None:
        try:
            clock.advance(1e9)
        except ClockStopped as error:
            reported.append(str(error))

    waiting = threading.Thread(target=wait)
    waiting.start()
    clock.stop()
    waiting.join(scaled_timeout(PATIENCE_S))
    assert reported == ["the simulated bench has ended"]


def test_a_device_that_fails_ends_the_world_in_a_sentence() -> None:
    class Broken(Device):
        def step(self, now: float) -> None:
            raise ZeroDivisionError("oops")

    clock = WorldClock(None)
    clock.follow(Broken())
    with pytest.raises(ClockStopped, match="the simulated bench failed: ZeroDivisionError: oops"):
        clock.advance(1.0)
