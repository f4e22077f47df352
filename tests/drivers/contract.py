"""What every device must do, simulated or real.

A test class inherits DeviceContract and offers a fixture `bench`, which knows how to make the devices the contract
speaks of. Bench.lose is None where the device cannot be unplugged.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import pytest

from drivers.device import Device
from drivers.errors import DeviceCode, DeviceError, DeviceLost, DeviceUnavailable
from recordings.samples import Item, Loss, Samples
from tests.timeout import scaled_timeout

TOPICS = {"/force", "/sync", "/markers", "/emg", "/emg_sync", "/emg_clock", "/analog"}
PATIENCE_S = 10.0  # wall; a bound on failing tests, not an expectation


@dataclass(frozen=True)
class Bench:
    """device streams; quiet_device opens and sends nothing; unreachable_device is not there; lose ends device."""

    device: Callable[[], Device]
    quiet_device: Callable[[], Device]
    unreachable_device: Callable[[], Device]
    lose: Callable[[], None] | None


def read_until(device: Device, is_enough: Callable[[list[Item]], bool]) -> list[Item]:
    """What the device delivers until it is enough; fails if that takes too long."""
    items: list[Item] = []
    give_up_s = time.perf_counter() + scaled_timeout(PATIENCE_S)
    while not is_enough(items):
        assert time.perf_counter() < give_up_s, f"{device.name} delivered only {len(items)} items"
        items += device.read(0.1)
    return items


def blocks(items: Sequence[Item], stream: str) -> list[Samples]:
    return [item for item in items if isinstance(item, Samples) and item.stream == stream]


def is_one_sentence(error: DeviceError) -> bool:
    """One line, and no vendor's stack of paragraphs."""
    text = str(error)
    return 20 < len(text) < 600 and "\n" not in text and "Traceback" not in text


@contextmanager
def raises_refusal(code: DeviceCode, naming: str = "") -> Iterator[None]:
    """The block raises a DeviceError of this code, in one sentence that names the device or the wrong value."""
    with pytest.raises(DeviceError) as caught:
        yield
    assert caught.value.code is code
    assert naming in str(caught.value)
    assert is_one_sentence(caught.value)


class DeviceContract:
    def test_an_open_device_describes_its_streams(self, bench: Bench) -> None:
        device = bench.device()
        device.open()
        streams = device.streams
        device.close()
        assert streams
        assert {stream.name for stream in streams} <= TOPICS
        assert len({stream.name for stream in streams}) == len(streams)
        assert all(stream.unit and stream.labels and stream.source and stream.rate_hz > 0 for stream in streams)

    def test_its_samples_are_numbered_without_holes_and_both_clocks_go_forward(self, bench: Bench) -> None:
        device = bench.device()
        device.open()
        names = [stream.name for stream in device.streams]
        items = read_until(device, lambda items: all(len(blocks(items, name)) >= 4 for name in names))
        device.close()
        assert not any(isinstance(item, Loss) for item in items)
        for stream in device.streams:
            received = blocks(items, stream.name)
            numbers = np.concatenate([block.sample_numbers for block in received])
            device_time_ns = np.concatenate([block.device_time_ns for block in received])
            host_time_ns = np.array([block.host_time_ns for block in received])
            assert numbers.dtype == np.uint64
            assert device_time_ns.dtype == np.int64
            assert np.all(np.diff(numbers) == 1)
            assert np.all(np.diff(device_time_ns) >= 0)
            assert np.all(np.diff(host_time_ns) >= 0)

    def test_its_values_have_the_shape_of_its_stream(self, bench: Bench) -> None:
        device = bench.device()
        device.open()
        names = [stream.name for stream in device.streams]
        items = read_until(device, lambda items: all(blocks(items, name) for name in names))
        device.close()
        for stream in device.streams:
            for block in blocks(items, stream.name):
                is_markers = stream.name == "/markers"
                expected = (block.sample_numbers.size, len(stream.labels), *((4,) if is_markers else ()))
                assert block.values.shape == expected
                assert block.values.dtype == (np.float32 if is_markers else np.float64)
                assert block.device_time_ns.shape == block.sample_numbers.shape

    def test_reading_a_quiet_device_returns_nothing(self, bench: Bench) -> None:
        device = bench.quiet_device()
        device.open()
        deliveries = [list(device.read(0.02)) for _ in range(3)]
        device.close()
        assert [item for items in deliveries for item in items if isinstance(item, Samples)] == []

    def test_it_can_be_closed_twice_and_before_it_was_opened(self, bench: Bench) -> None:
        device = bench.device()
        device.close()
        device.open()
        device.close()
        device.close()

    def test_reading_a_closed_device_is_an_error(self, bench: Bench) -> None:
        device = bench.device()
        device.open()
        device.close()
        with pytest.raises(DeviceLost) as caught:
            device.read(0.01)
        assert is_one_sentence(caught.value)

    def test_it_can_be_opened_again(self, bench: Bench) -> None:
        device = bench.device()
        for _ in range(3):
            device.open()
            name = device.streams[0].name
            items = read_until(device, lambda items, name=name: bool(blocks(items, name)))  # type: ignore[misc]
            device.close()
            assert blocks(items, name)[0].sample_numbers.size > 0

    def test_a_device_that_is_not_there_is_refused_in_a_sentence_that_names_it(self, bench: Bench) -> None:
        device = bench.unreachable_device()
        with pytest.raises(DeviceUnavailable) as caught:
            device.open()
        device.close()
        assert is_one_sentence(caught.value)
        assert device.name in str(caught.value)

    def test_a_device_that_goes_is_lost_in_a_sentence_and_can_still_be_closed(self, bench: Bench) -> None:
        if bench.lose is None:
            pytest.skip("the device cannot be unplugged")
        device = bench.device()
        device.open()
        name = device.streams[0].name
        read_until(device, lambda items: bool(blocks(items, name)))
        bench.lose()
        with pytest.raises(DeviceLost) as caught:
            read_until(device, lambda _: False)
        device.close()
        device.close()
        assert is_one_sentence(caught.value)
        assert device.name in str(caught.value)
