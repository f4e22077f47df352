"""The driver against another process's outlet, in a network of its own (test_lsl.py runs this file there)."""

import time
from collections.abc import Iterator

import numpy as np
import pytest

from drivers import lsl
from drivers.errors import DeviceCode
from drivers.lsl import LslEmg
from drivers.reconnecting import make_device
from recordings.samples import Event, Item, Loss
from tests.drivers.contract import Bench, DeviceContract, blocks, raises_refusal, read_until
from tests.drivers.lsl_sender import RATE_HZ, LslSender
from tests.timeout import scaled_timeout

NAME = "an amplifier"
CONSUMER_S = 20.0


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lsl, "TWIN_TIMEOUT_S", 0.1)
    monkeypatch.setattr(lsl, "CLOCK_INTERVAL_S", 0.02)


@pytest.fixture(scope="module")
def sender() -> Iterator[LslSender]:
    with LslSender(NAME) as sender:
        yield sender


def driver(stream: str = NAME, **options: object) -> LslEmg:
    return LslEmg(stream=stream, host_clock=time.time_ns, sync_channel="trigger", **options)  # type: ignore[arg-type]


def received(items: list[Item]) -> int:
    return sum(len(block.sample_numbers) for block in blocks(items, "/emg"))


class TestScenario:
    def test_samples_arrive_as_they_were_sent_with_the_sender_s_stamps(self, sender: LslSender) -> None:
        device = driver(channels={"upper_trapezius": "trapezius"})
        device.open()
        assert sender.ask(consumer=CONSUMER_S)["consumer"] is True
        sent = sender.ask(push=300)["sent"]
        items = read_until(device, lambda items: received(items) >= 300 and bool(blocks(items, "/emg_clock")))
        device.close()
        emg, pulse, clock = device.streams
        assert (emg.labels, emg.unit, emg.rate_hz) == (("upper_trapezius",), "uV", RATE_HZ)
        assert (pulse.labels, clock.labels) == (("trigger",), ("offset", "uncertainty"))
        assert (device.identity.text, device.identity.is_simulated) == ("Maker M1", False)
        number = np.arange(sent - 300, sent)
        values = np.concatenate([block.values for block in blocks(items, "/emg")])
        np.testing.assert_array_equal(values[:, 0], (number + 0.1).astype(np.float32))
        np.testing.assert_array_equal(
            np.concatenate([block.values for block in blocks(items, "/emg_sync")])[:, 0],
            (number + 0.2).astype(np.float32),
        )
        stamps = np.concatenate([block.device_time_ns for block in blocks(items, "/emg")])
        np.testing.assert_allclose(stamps * 1e-9, sender.base_s + number / RATE_HZ, atol=1e-8)
        assert not any(isinstance(item, Loss) for item in items)

    def test_the_clock_offset_ties_the_sender_s_clock_to_the_station_s(self, sender: LslSender) -> None:
        import pylsl

        began_ns = time.perf_counter_ns()
        device = driver()
        device.open()
        sender.ask(consumer=CONSUMER_S)
        sender.ask(push=10)
        items = read_until(device, lambda items: bool(blocks(items, "/emg_clock")))
        device.close()
        block = blocks(items, "/emg_clock")[0]
        offset_s, uncertainty_s = block.values[0]
        assert abs(offset_s) <= uncertainty_s + 1e-3, "both processes have this computer's clock"
        here = time.time_ns() - round(1e9 * pylsl.local_clock())
        late_ns = block.host_time_ns - int(block.device_time_ns[0]) - here
        elapsed_ns = time.perf_counter_ns() - began_ns
        assert abs(late_ns) <= 1e9 * (uncertainty_s + 1e-3) + elapsed_ns, "a busy computer may pause between two clocks"

    def test_what_the_amplifier_lost_is_counted_for_both_streams(self, sender: LslSender) -> None:
        device = driver()
        device.open()
        sender.ask(consumer=CONSUMER_S)
        sender.ask(push=50)
        sender.ask(skip=400)
        sender.ask(push=50)
        items = read_until(device, lambda items: received(items) >= 100)
        device.close()
        losses = [item for item in items if isinstance(item, Loss)]
        assert [(loss.stream, loss.cause, loss.first_missing, loss.count) for loss in losses] == [
            ("/emg", "skipped", 50, 400),
            ("/emg_sync", "skipped", 50, 400),
        ]
        numbers = np.concatenate([block.sample_numbers for block in blocks(items, "/emg")])
        assert numbers.tolist() == [*range(50), *range(450, 500)]

    def test_a_sender_that_dies_is_lost_and_its_successor_continues_the_numbers(self) -> None:
        device = make_device("lsl", stream="mortal", host_clock=time.time_ns, channels={"a": "deltoid"})
        with LslSender("mortal") as first:
            device.open()
            first.ask(consumer=CONSUMER_S)
            first.ask(push=100)
            items = read_until(device, lambda items: received(items) >= 100)
        items = read_until(device, lambda items: any(isinstance(item, Event) for item in items))
        with LslSender("mortal") as second:
            items += read_until(device, lambda items: "connection_restored" in _kinds(items))
            second.ask(consumer=CONSUMER_S)
            second.ask(push=100)
            items += read_until(device, lambda items: received(items) >= 100)
            away_s = second.base_s - first.base_s
        device.close()
        assert _kinds(items) == ["connection_lost", "connection_restored"]
        loss = next(item for item in items if isinstance(item, Loss))
        assert (loss.stream, loss.cause, loss.first_missing) == ("/emg", "disconnected", 100)
        assert loss.count == pytest.approx(away_s * RATE_HZ - 100, abs=1)
        assert int(blocks(items, "/emg")[-1].sample_numbers[-1]) == 100 + loss.count + 99


class TestRefusals:
    def test_an_outlet_that_is_not_there_is_refused_by_name(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(lsl, "RESOLVE_TIMEOUT_S", 0.2)
        with raises_refusal(DeviceCode.NOT_FOUND, naming="LSL missing"):
            driver("missing").open()

    def test_a_channel_that_is_not_there_is_refused_with_those_that_are(self, sender: LslSender) -> None:
        with raises_refusal(DeviceCode.NO_CHANNEL, naming="biceps"):
            driver(channels={"biceps": "biceps"}).open()

    def test_two_outlets_of_one_name_are_refused(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(lsl, "TWIN_TIMEOUT_S", scaled_timeout(10.0))
        with LslSender("twin", "a"), LslSender("twin", "b"), raises_refusal(DeviceCode.SEVERAL_OUTLETS):
            driver("twin").open()


def _kinds(items: list[Item]) -> list[str]:
    return [item.kind for item in items if isinstance(item, Event)]


class TestLslKeepsTheContract(DeviceContract):
    @pytest.fixture
    def bench(self, monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
        def unreachable() -> LslEmg:
            monkeypatch.setattr(lsl, "RESOLVE_TIMEOUT_S", 0.2)
            return driver("missing")

        with LslSender(NAME + " 2") as flowing, LslSender("quiet"):
            yield Bench(
                device=lambda: _Fed(flowing),
                quiet_device=lambda: driver("quiet"),
                unreachable_device=unreachable,
                lose=flowing.kill,
            )


class _Fed:
    """The driver, with a sender that pushes whenever the driver is read."""

    def __init__(self, sender: LslSender) -> None:
        self._sender, self._device = sender, driver(sender.request["name"])  # type: ignore[arg-type]

    def __getattr__(self, name: str) -> object:
        return getattr(self._device, name)

    def open(self) -> None:
        self._device.open()
        assert self._sender.ask(consumer=CONSUMER_S)["consumer"] is True

    def read(self, timeout_s: float) -> object:
        if self._sender.process.poll() is None:
            self._sender.ask(push=100)
        return self._device.read(timeout_s)
