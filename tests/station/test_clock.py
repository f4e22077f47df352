from __future__ import annotations

from station.clock import ManualClock, RealClock, SteppedClock


def test_the_manual_clock_advances_on_request_and_by_steps() -> None:
    clock = ManualClock(step_s=0.5)
    before = clock.utc_ns()
    clock.advance(2.0)
    clock.step()
    assert clock.station_s() == 2.5
    assert clock.utc_ns() - before == 2_500_000_000


def test_only_a_simulated_clock_is_a_stepped_clock() -> None:
    assert isinstance(ManualClock(), SteppedClock)
    assert not isinstance(RealClock(), SteppedClock)


def test_the_real_clock_never_goes_back() -> None:
    clock = RealClock()
    readings = [clock.utc_ns() for _ in range(1000)]
    assert readings == sorted(readings)
