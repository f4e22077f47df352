"""EMG from a Lab Streaming Layer outlet: what the driver makes of chunks, and the driver on the real wire."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers import lsl
from drivers.errors import DeviceCode
from drivers.lsl import LslEmg
from recordings.samples import Event, Loss
from tests.drivers.contract import blocks, raises_refusal
from tests.drivers.pytest_on_loopback import passed_on_loopback

ROOT = Path(__file__).parents[2]
ON_LOOPBACK = "tests/drivers/lsl_on_loopback.py"


class _Description:
    def child(self, _name: str) -> _Description:
        return self

    def child_value(self, _name: str) -> str:
        return ""


@dataclass
class FakeOutlet:
    """chunks are (values, stamps) that its inlet hands out one by one; a RuntimeError among them is raised."""

    labels: list[str] | None = field(default_factory=lambda: ["a", "b"])
    units: list[str] | None = field(default_factory=lambda: ["microvolts", "microvolts"])
    rate_hz: float = 1000.0
    channels: int = 2
    is_text: bool = False
    chunks: list[tuple[np.ndarray, np.ndarray] | RuntimeError] = field(default_factory=list)
    id: str = "one"

    def send(self, first_s: float, count: int) -> None:
        stamps = first_s + np.arange(count) / self.rate_hz
        self.chunks.append((np.zeros((count, self.channels), np.float32), stamps))

    def info(self, _timeout_s: float) -> FakeOutlet:
        return self

    def uid(self) -> str:
        return self.id

    def hostname(self) -> str:
        return f"pc-{self.id}"

    def source_id(self) -> str:
        return ""

    def type(self) -> str:
        return "EMG"

    def nominal_srate(self) -> float:
        return self.rate_hz

    def channel_count(self) -> int:
        return self.channels

    def channel_format(self) -> int:
        return FakeLsl.cf_string if self.is_text else 1

    def get_channel_labels(self) -> list[str] | None:
        return self.labels

    def get_channel_units(self) -> list[str] | None:
        return self.units

    def desc(self) -> _Description:
        return _Description()


class FakeLsl:
    """Stands for the module; all its outlets have the name that is asked for."""

    cf_string, proc_none = 3, 0

    def __init__(self, *outlets: FakeOutlet) -> None:
        self.outlets = list(outlets)

    def resolve_byprop(self, _property: str, _name: str, _minimum: int, _timeout_s: float) -> list[FakeOutlet]:
        return self.outlets

    def local_clock(self) -> float:
        return 50.0

    def StreamInlet(self, outlet: FakeOutlet, *, recover: bool, processing_flags: int) -> _FakeInlet:  # noqa: N802
        assert not recover and processing_flags == self.proc_none, "the driver itself reconnects, and keeps the stamps"
        return _FakeInlet(outlet)


class _FakeInlet:
    def __init__(self, outlet: FakeOutlet) -> None:
        self._outlet = outlet
        self.info = outlet.info

    def open_stream(self, _timeout_s: float) -> None: ...

    def close_stream(self) -> None: ...

    def time_correction(self, _timeout_s: float) -> float:
        return 0.0

    def pull_chunk(self, _timeout_s: float, _most: int, *, as_numpy: bool) -> tuple[np.ndarray, np.ndarray]:
        assert as_numpy
        if not self._outlet.chunks:
            return np.zeros((0, self._outlet.channels), np.float32), np.zeros(0)
        chunk = self._outlet.chunks.pop(0)
        if isinstance(chunk, RuntimeError):
            raise chunk
        return chunk


def test_the_driver_agrees_with_another_process_s_outlet(tmp_path: Path) -> None:
    assert passed_on_loopback(ON_LOOPBACK, "TestScenario", tmp_path) == 4


@pytest.mark.slow
def test_the_driver_keeps_the_contract_of_all_devices_and_refuses_other_outlets(tmp_path: Path) -> None:
    assert passed_on_loopback(ON_LOOPBACK, "TestLslKeepsTheContract or TestRefusals", tmp_path) == 9


@pytest.fixture
def outlet(monkeypatch: pytest.MonkeyPatch) -> FakeOutlet:
    outlet = FakeOutlet()
    offer(monkeypatch, outlet)
    return outlet


def offer(monkeypatch: pytest.MonkeyPatch, *outlets: FakeOutlet) -> None:
    monkeypatch.setitem(sys.modules, "pylsl", FakeLsl(*outlets))  # type: ignore[arg-type]
    monkeypatch.setattr(lsl, "_time_correction", lambda *_: (-40.0, 2e-4))


def opened(**options: Any) -> LslEmg:
    ticks = iter(range(10**18, 2 * 10**18, 10**9))
    device = LslEmg(stream="amp", host_clock=lambda: next(ticks), **options)
    device.open()
    return device


def test_jitter_of_the_stamps_is_no_loss_and_a_jump_is(outlet: FakeOutlet) -> None:
    device = opened()
    outlet.send(10.0, 100)
    outlet.send(10.1 + 0.08, 100)  # a chunk that is stamped 80 ms late
    outlet.send(10.2, 100)
    outlet.send(10.8, 100)
    items = [item for _ in range(4) for item in device.read(0.0)]
    assert [(loss.first_missing, loss.count) for loss in items if isinstance(loss, Loss)] == [(300, 500)]
    numbers = np.concatenate([block.sample_numbers for block in blocks(items, "/emg")])
    assert numbers.tolist() == [*range(300), *range(800, 900)]


def test_a_jump_inside_a_chunk_parts_it(outlet: FakeOutlet) -> None:
    device = opened()
    stamps = np.concatenate([10 + np.arange(50) / 1000, 11 + np.arange(50) / 1000])
    outlet.chunks.append((np.zeros((100, 2), np.float32), stamps))
    items = device.read(0.0)
    assert [len(block.sample_numbers) for block in blocks(items, "/emg")] == [50, 50]
    assert [loss.count for loss in items if isinstance(loss, Loss)] == [950]


def test_a_sender_s_clock_that_is_set_back_is_an_event_and_no_loss(outlet: FakeOutlet) -> None:
    device = opened()
    outlet.send(100.0, 50)
    outlet.send(7.0, 50)
    items = [*device.read(0.0), *device.read(0.0)]
    assert [item.kind for item in items if isinstance(item, Event)] == ["emg_clock_reset"]
    assert not any(isinstance(item, Loss) for item in items)
    assert int(blocks(items, "/emg")[-1].sample_numbers[-1]) == 99


@pytest.mark.parametrize("wrong", [np.inf, -np.inf, np.nan, 1e300, -1e300, 5e9])
@pytest.mark.parametrize("place", [0, 7, 9])
@pytest.mark.parametrize("chunk", [0, 1])
def test_a_stamp_that_is_no_time_is_interpolated_and_reported(
    outlet: FakeOutlet, wrong: float, place: int, chunk: int
) -> None:
    device = opened()
    for first_s in (100.0, 100.01, 100.02):
        outlet.send(first_s, 10)
    outlet.chunks[chunk][1][place] = wrong  # type: ignore[index]
    items = [item for _ in range(3) for item in device.read(0.0)]
    assert [item.kind for item in items if isinstance(item, Event)] == ["emg_clock_unreadable"]
    assert not any(isinstance(item, Loss) for item in items)
    times_ns = np.concatenate([block.device_time_ns for block in blocks(items, "/emg")])
    assert times_ns == pytest.approx(100e9 + 1e6 * np.arange(30), abs=1e3)


@pytest.mark.parametrize("step_s", [1e9, 2e5, 30.0, -1e9, -2e5])
@pytest.mark.parametrize("is_within_chunk", [True, False])
def test_stamps_that_jump_by_more_than_the_station_s_clock_are_a_clock_event_and_no_loss(
    outlet: FakeOutlet, step_s: float, is_within_chunk: bool
) -> None:
    device = opened()
    for first_s in (100.0, 100.1):
        outlet.send(first_s, 100)
    if is_within_chunk:
        outlet.chunks[1][1][50:] += step_s  # type: ignore[index,operator]
    outlet.send(100.2 + step_s, 100)
    items = [item for _ in range(3) for item in device.read(0.0)]
    assert [item.kind for item in items if isinstance(item, Event)] == ["emg_clock_reset"]
    assert not any(isinstance(item, Loss) for item in items)
    numbers = np.concatenate([block.sample_numbers for block in blocks(items, "/emg")])
    assert numbers.tolist() == list(range(300))


def test_stamps_that_creep_ahead_count_no_more_samples_than_time_allows(outlet: FakeOutlet) -> None:
    """Chunks of 0.1 s arrive every second; their stamps are 1.3 s apart."""
    device, chunks = opened(), 40
    for chunk in range(chunks):
        outlet.send(10.0 + 1.3 * chunk, 100)
    items = [item for _ in range(chunks) for item in device.read(0.0)]
    lost = sum(item.count for item in items if isinstance(item, Loss))
    assert 1000 * (chunks - 1) < lost + 100 * chunks <= 1000 * (1.01 * chunks + 1)
    assert any(isinstance(item, Event) and item.kind == "emg_clock_reset" for item in items)


def test_stamps_that_alternate_between_two_clocks_are_one_event_a_chunk(outlet: FakeOutlet) -> None:
    device = opened()
    for chunk in range(3):
        outlet.send(100.0 + 0.1 * chunk, 100)
        outlet.chunks[-1][1][1::2] += 2e5  # type: ignore[index,operator]
    items = [item for _ in range(3) for item in device.read(0.0)]
    assert sum(isinstance(item, Event) for item in items) == 3
    assert not any(isinstance(item, Loss) for item in items)
    assert [len(block.sample_numbers) for block in blocks(items, "/emg")] == [100, 100, 100]


def test_a_chunk_without_a_time_is_recorded_and_a_clock_offset_is_the_sender_s_time(outlet: FakeOutlet) -> None:
    device = opened()
    outlet.chunks.append((np.zeros((10, 2), np.float32), np.full(10, np.nan)))
    items = device.read(0.0)
    (block,), (offset,) = blocks(items, "/emg"), blocks(items, "/emg_clock")
    assert len(block.sample_numbers) == 10
    assert offset.device_time_ns.tolist() == [90_000_000_000]  # here 50 s, there 40 s more
    assert offset.values.tolist() == [[-40.0, 2e-4]]


def test_after_an_outage_the_numbers_jump_by_the_stamps_or_else_by_the_station_s_clock(outlet: FakeOutlet) -> None:
    device = opened()
    outlet.send(100.0, 50)
    device.read(0.0)
    device.resume()
    outlet.send(103.049, 50)
    (by_stamps,) = blocks(device.read(0.0), "/emg")
    assert int(by_stamps.sample_numbers[0]) == 3049
    device.resume()
    outlet.send(5.0, 50)  # its computer was started anew
    (by_host,) = blocks(device.read(0.0), "/emg")
    seconds = (by_host.host_time_ns - by_stamps.host_time_ns) * 1e-9
    assert int(by_host.sample_numbers[0]) == 3098 + round(1000 * seconds)


def test_a_lost_outlet_is_lost_in_a_sentence(outlet: FakeOutlet) -> None:
    device = opened()
    outlet.chunks.append(RuntimeError("the stream read by this inlet has been lost."))
    with raises_refusal(DeviceCode.DISCONNECTED, naming="LSL amp"):
        device.read(0.0)


def test_an_outlet_without_labels_and_units_is_recorded_as_it_is(outlet: FakeOutlet) -> None:
    outlet.labels = outlet.units = None
    emg, _ = opened().streams
    assert (emg.labels, emg.unit) == (("channel_1", "channel_2"), "unknown")
    assert opened(unit="mV").streams[0].unit == "mV"


@pytest.mark.parametrize(
    ("outlets", "options", "code"),
    [
        ([FakeOutlet(is_text=True)], {}, DeviceCode.NO_SIGNAL),
        ([FakeOutlet(rate_hz=0.0)], {}, DeviceCode.NO_SIGNAL),
        ([FakeOutlet(units=["microvolts", "V"])], {}, DeviceCode.MIXED_UNITS),
        ([FakeOutlet()], {"channels": {"x": "c"}}, DeviceCode.NO_CHANNEL),
        ([FakeOutlet()], {"sync_channel": "t"}, DeviceCode.NO_CHANNEL),
        ([FakeOutlet(id="1"), FakeOutlet(id="2")], {}, DeviceCode.SEVERAL_OUTLETS),
    ],
)
def test_an_outlet_that_cannot_be_recorded_is_refused_in_a_sentence(
    monkeypatch: pytest.MonkeyPatch, outlets: list[FakeOutlet], options: dict[str, Any], code: DeviceCode
) -> None:
    offer(monkeypatch, *outlets)
    with raises_refusal(code):
        opened(**options)


def test_another_outlet_after_an_outage_is_refused(monkeypatch: pytest.MonkeyPatch, outlet: FakeOutlet) -> None:
    device = opened()
    offer(monkeypatch, FakeOutlet(rate_hz=500.0))
    with raises_refusal(DeviceCode.CHANGED):
        device.resume()


def test_the_drivers_load_no_vendor_package_before_they_are_opened() -> None:
    code = (
        "import sys, drivers.lsl, drivers.nidaq; drivers.lsl.LslEmg(stream='a', host_clock=int)\n"
        "sys.exit(bool({'pylsl', 'nidaqmx', 'grpc'} & sys.modules.keys()))"
    )
    assert subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=False).returncode == 0  # noqa: S603
