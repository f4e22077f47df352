"""What every device must do, simulated or real.

A test class inherits DeviceContract and offers a fixture `bench`, which knows how to make the devices the contract
speaks of. Bench.lose is None where the device cannot be unplugged.
"""

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
    def test_its_samples_are_those_of_its_streams_numbered_without_holes_and_both_clocks_go_forward(
        self, bench: Bench
    ) -> None:
        device = bench.device()
        device.open()
        streams, names = device.streams, {stream.name for stream in device.streams}
        items = read_until(device, lambda items: all(len(blocks(items, name)) >= 4 for name in names))
        device.close()
        assert streams and names <= TOPICS and len(names) == len(streams)
        assert all(stream.unit and stream.labels and stream.source and stream.rate_hz > 0 for stream in streams)
        assert not any(isinstance(item, Loss) for item in items)
        for stream in streams:
            received, is_markers = blocks(items, stream.name), stream.name == "/markers"
            for block in received:
                expected = (block.sample_numbers.size, len(stream.labels), *((4,) if is_markers else ()))
                assert block.values.shape == expected
                assert block.values.dtype == (np.float32 if is_markers else np.float64)
                assert block.device_time_ns.shape == block.sample_numbers.shape
            numbers = np.concatenate([block.sample_numbers for block in received])
            device_time_ns = np.concatenate([block.device_time_ns for block in received])
            assert numbers.dtype == np.uint64 and np.all(np.diff(numbers) == 1)
            assert device_time_ns.dtype == np.int64 and np.all(np.diff(device_time_ns) >= 0)
            assert np.all(np.diff([block.host_time_ns for block in received]) >= 0)

    def test_reading_a_quiet_device_returns_nothing(self, bench: Bench) -> None:
        device = bench.quiet_device()
        device.open()
        deliveries = [list(device.read(0.02)) for _ in range(3)]
        device.close()
        assert [item for items in deliveries for item in items if isinstance(item, Samples)] == []

    def test_it_can_be_closed_twice_and_before_it_was_opened_and_is_not_read_when_closed(self, bench: Bench) -> None:
        device = bench.device()
        device.close()
        device.open()
        device.close()
        with pytest.raises(DeviceLost) as caught:
            device.read(0.01)
        device.close()
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
