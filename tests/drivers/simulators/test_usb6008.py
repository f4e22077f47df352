"""The simulated instrument by itself, in a world whose clock is advanced by the test."""

import numpy as np
import pytest

from drivers.simulators.settings import DaqClockSettings
from drivers.simulators.usb6008 import AcquisitionTask, DaqmxError, Usb6008, default_buffer_size
from tests.drivers.stand_in_world import StandInWorld


def instrument(world: StandInWorld, offset_ppm: float = 0.0, drift_ppm_per_hour: float = 0.0) -> Usb6008:
    clock = DaqClockSettings(offset_ppm=offset_ppm, drift_ppm_per_hour=drift_ppm_per_hour)
    return Usb6008(world, name="Dev1", force_channel="ai0", sync_channel="ai1", clock=clock, seed=1)


def task_on(device: Usb6008, *channels: str, reach_v: float = 10.0, buffer_size: int = 0) -> AcquisitionTask:
    task = AcquisitionTask(device, "task")
    task.inputs = [device.input(f"Dev1/{channel}", -reach_v, reach_v) for channel in channels]
    task.set_clock(1000.0, buffer_size)
    return task


def started(world: StandInWorld, *channels: str, reach_v: float = 10.0) -> AcquisitionTask:
    """A task of an instrument in this world, a second after its start."""
    task = task_on(instrument(world), *channels, reach_v=reach_v)
    task.start()
    world.advance(1)
    return task


def raises_code(code: int) -> pytest.RaisesExc[DaqmxError]:
    return pytest.raises(DaqmxError, check=lambda error: error.error_code == code)


def test_volts_are_whole_codes_of_12_bits(world: StandInWorld) -> None:
    task = started(world, "ai0")
    codes = task.read(1000, 0) / (20 / 4096)
    assert np.allclose(codes, np.rint(codes), atol=1e-9)
    assert codes.mean() == pytest.approx(1.005 / (20 / 4096), abs=0.1)
    assert 0.3 < codes.std() < 1.0


def test_the_narrowest_range_that_holds_what_was_asked_is_taken_and_clips(world: StandInWorld) -> None:
    world.edge_s = 0
    task = started(world, "ai1", reach_v=4.5)
    assert task.read(100, 0).max() == pytest.approx(4.9976, abs=1e-4)


def test_a_range_beyond_20_v_a_fifth_input_and_more_than_10_000_samples_a_second_are_refused(
    world: StandInWorld,
) -> None:
    with raises_code(-200077):
        task_on(instrument(world), "ai0", reach_v=21)
    with raises_code(-200170):
        task_on(instrument(world), "ai4")
    task = task_on(instrument(world), "ai0", "ai1")
    task.set_clock(5001, 0)
    with raises_code(-200077):
        task.start()


def test_an_unwired_input_reads_noise_about_zero(world: StandInWorld) -> None:
    task = started(world, "ai3")
    assert abs(task.read(1000, 0).mean()) < 1e-3


def test_the_second_channel_is_converted_a_tenth_of_a_millisecond_later(world: StandInWorld) -> None:
    moments = []
    world.amplifier_voltage = lambda t: (moments.append(t), np.zeros_like(t))[1]  # type: ignore[method-assign]
    world.sync_voltage = lambda t: (moments.append(t), np.zeros_like(t))[1]  # type: ignore[method-assign]
    started(world, "ai0", "ai1").read(10, 0)
    assert np.allclose(moments[1] - moments[0], 1e-4)


@pytest.mark.parametrize(("offset_ppm", "drift_ppm_per_hour", "ahead"), [(100, 0, 100), (0, 100, 50), (-40, 20, -30)])
def test_the_crystal_runs_ahead_by_its_offset_and_drift(
    world: StandInWorld, offset_ppm: float, drift_ppm_per_hour: float, ahead: float
) -> None:
    task = task_on(instrument(world, offset_ppm, drift_ppm_per_hour), "ai0", buffer_size=4_000_000)
    task.start()
    world.advance(3600)
    expected = 3600 * 1000 * (1 + ahead * 1e-6)
    assert task.acquired() == pytest.approx(expected, abs=2)


def test_samples_are_taken_at_the_crystal_s_moments(world: StandInWorld) -> None:
    moments = []
    world.amplifier_voltage = lambda t: (moments.append(t), np.zeros_like(t))[1]  # type: ignore[method-assign]
    task = task_on(instrument(world, offset_ppm=1000), "ai0")
    world.advance(7)
    task.start()
    world.advance(1)
    task.read(1001, 0)
    assert moments[0][0] == 7.0
    assert np.allclose(np.diff(moments[0]), 1e-3 * (1 - 1e-3), atol=1e-12)


def test_a_read_gets_what_there_is_when_its_time_is_out(world: StandInWorld) -> None:
    task = task_on(instrument(world), "ai0", "ai1")
    task.start()
    world.advance(0.0495)
    assert task.read(100, 0).shape == (2, 50)
    assert task.read(100, 0).shape == (2, 0)


def test_unread_samples_are_overwritten_when_the_buffer_is_full_until_the_task_is_started_again(
    world: StandInWorld,
) -> None:
    task = task_on(instrument(world), "ai0")
    task.start()
    world.advance(9.9)
    assert task.available() == 9901
    world.advance(0.2)
    for _ in range(2):
        with raises_code(-200279):
            task.read(10, 0)
    task.stop()
    task.start()
    world.advance(0.1)
    assert task.read(10, 0).shape == (1, 10)


@pytest.mark.parametrize(("rate_hz", "size"), [(100, 1_000), (101, 10_000), (10_000, 10_000), (10_001, 100_000)])
def test_the_buffer_is_as_large_as_ni_makes_it(rate_hz: float, size: int) -> None:
    assert default_buffer_size(rate_hz) == size


@pytest.mark.parametrize(("edge_s", "acquired"), [(2.50005, 500), (1.0, 0)], ids=["an edge", "high already"])
def test_a_triggered_task_begins_within_a_tenth_of_a_millisecond_of_the_edge(
    world: StandInWorld, edge_s: float, acquired: int
) -> None:
    world.edge_s = edge_s
    world.advance(2)
    task = task_on(instrument(world), "ai1")
    task.waits_for_trigger = True
    task.start()
    assert task.acquired() == 0
    world.advance(1)
    assert task.acquired() == pytest.approx(acquired, abs=1 if acquired else 0)
