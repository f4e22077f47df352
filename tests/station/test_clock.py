from __future__ import annotations

import pytest

from station.clock import ManualClock, RealClock


def test_station_time_runs_faster_by_the_speed_and_wall_time_does_not() -> None:
    clock = ManualClock(speed=30)
    before = clock.utc_ns()
    clock.advance(2.0)
    assert clock.wall_s() == 2.0
    assert clock.station_s() == 60.0
    assert clock.utc_ns() - before == 60_000_000_000


def test_the_real_clock_never_goes_back() -> None:
    clock = RealClock(speed=10)
    readings = [clock.utc_ns() for _ in range(1000)]
    assert readings == sorted(readings)


@pytest.mark.parametrize("speed", [0.0, -1.0, float("nan")])
def test_a_speed_that_is_not_positive_is_refused(speed: float) -> None:
    with pytest.raises(ValueError, match="speed"):
        RealClock(speed)
