"""EMG from a Lab Streaming Layer outlet: what the driver makes of chunks, and the driver on the real wire."""

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

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
CF_STRING = 3
LABELS, UNITS = ["a", "b"], ["microvolts", "microvolts"]


def fake_outlet(
    labels: list[str] | None = LABELS, units: list[str] | None = UNITS, rate_hz: float = 1e3, *, is_text: bool = False
) -> Mock:
    """An outlet of two channels without a description, which is its own inlet.

    chunks are (values, stamps) that are handed out one by one; a RuntimeError among them is raised.
    """

    def pull_chunk(_timeout_s: float, _most: int, *, as_numpy: bool) -> tuple[np.ndarray, np.ndarray]:
        assert as_numpy
        chunk = outlet.chunks.pop(0) if outlet.chunks else (np.zeros((0, 2), np.float32), np.zeros(0))
        if isinstance(chunk, RuntimeError):
            raise chunk
        return chunk

    kind = {"channel_format": CF_STRING if is_text else 1, "nominal_srate": rate_hz, "type": "EMG", "source_id": ""}
    kind |= {"get_channel_labels": labels, "get_channel_units": units, "channel_count": 2}
    of_inlet = ["chunks", "pull_chunk", "info", "open_stream", "close_stream", "time_correction"]
    outlet = Mock(spec=[*of_inlet, *kind, "uid", "hostname", "desc"], chunks=[], pull_chunk=pull_chunk)
    outlet.configure_mock(**{f"{name}.return_value": value for name, value in kind.items()})
    outlet.uid.return_value, outlet.hostname.return_value = f"uid-{id(outlet)}", f"pc-{id(outlet)}"
    outlet.info.return_value = outlet
    outlet.desc.return_value.child.return_value.child_value.return_value = ""
    return outlet


def send(outlet: Mock, first_s: float, count: int) -> None:
    outlet.chunks.append((np.zeros((count, 2), np.float32), first_s + np.arange(count) / 1000))


def test_the_driver_agrees_with_another_process_s_outlet(tmp_path: Path) -> None:
    assert passed_on_loopback(ON_LOOPBACK, "TestScenario", tmp_path) == 4


@pytest.mark.slow
def test_the_driver_keeps_the_contract_of_all_devices_and_refuses_other_outlets(tmp_path: Path) -> None:
    assert passed_on_loopback(ON_LOOPBACK, "TestLslKeepsTheContract or TestRefusals", tmp_path) == 9


@pytest.fixture
def outlet(monkeypatch: pytest.MonkeyPatch) -> Mock:
    outlet = fake_outlet()
    offer(monkeypatch, outlet)
    return outlet


def offer(monkeypatch: pytest.MonkeyPatch, *outlets: Mock) -> None:
    """All outlets have the name that is asked for."""

    def inlet(outlet: Mock, *, recover: bool, processing_flags: int) -> Mock:
        assert not recover and processing_flags == 0, "the driver itself reconnects, and keeps the stamps"
        return outlet

    pylsl = SimpleNamespace(cf_string=CF_STRING, proc_none=0, local_clock=lambda: 50.0, StreamInlet=inlet)
    pylsl.resolve_byprop = lambda *_: outlets
    monkeypatch.setitem(sys.modules, "pylsl", pylsl)  # type: ignore[arg-type]
    monkeypatch.setattr(lsl, "_time_correction", lambda *_: (-40.0, 2e-4))


def opened(**options: Any) -> LslEmg:
    ticks = iter(range(10**18, 2 * 10**18, 10**9))
    device = LslEmg(stream="amp", host_clock=lambda: next(ticks), **options)
    device.open()
    return device


def test_jitter_of_the_stamps_is_no_loss_and_a_jump_is(outlet: Mock) -> None:
    device = opened()
    send(outlet, 10.0, 100)
    send(outlet, 10.1 + 0.08, 100)  # a chunk that is stamped 80 ms late
    send(outlet, 10.2, 100)
    send(outlet, 10.8, 100)
    items = [item for _ in range(4) for item in device.read(0.0)]
    assert [(loss.first_missing, loss.count) for loss in items if isinstance(loss, Loss)] == [(300, 500)]
    numbers = np.concatenate([block.sample_numbers for block in blocks(items, "/emg")])
    assert numbers.tolist() == [*range(300), *range(800, 900)]


def test_a_jump_inside_a_chunk_parts_it(outlet: Mock) -> None:
    device = opened()
    stamps = np.concatenate([10 + np.arange(50) / 1000, 11 + np.arange(50) / 1000])
    outlet.chunks.append((np.zeros((100, 2), np.float32), stamps))
    items = device.read(0.0)
    assert [len(block.sample_numbers) for block in blocks(items, "/emg")] == [50, 50]
    assert [loss.count for loss in items if isinstance(loss, Loss)] == [950]


def test_a_sender_s_clock_that_is_set_back_is_an_event_and_no_loss(outlet: Mock) -> None:
    device = opened()
    send(outlet, 100.0, 50)
    send(outlet, 7.0, 50)
    items = [*device.read(0.0), *device.read(0.0)]
    assert [item.kind for item in items if isinstance(item, Event)] == ["emg_clock_reset"]
    assert not any(isinstance(item, Loss) for item in items)
    assert int(blocks(items, "/emg")[-1].sample_numbers[-1]) == 99


@pytest.mark.parametrize("wrong", [np.inf, -np.inf, np.nan, 1e300, -1e300, 5e9])
@pytest.mark.parametrize("place", [0, 7, 9])
@pytest.mark.parametrize("chunk", [0, 1])
def test_a_stamp_that_is_no_time_is_interpolated_and_reported(
    outlet: Mock, wrong: float, place: int, chunk: int
) -> None:
    device = opened()
    for first_s in (100.0, 100.01, 100.02):
        send(outlet, first_s, 10)
    outlet.chunks[chunk][1][place] = wrong  # type: ignore[index]
    items = [item for _ in range(3) for item in device.read(0.0)]
    assert [item.kind for item in items if isinstance(item, Event)] == ["emg_clock_unreadable"]
    assert not any(isinstance(item, Loss) for item in items)
    times_ns = np.concatenate([block.device_time_ns for block in blocks(items, "/emg")])
    assert times_ns == pytest.approx(100e9 + 1e6 * np.arange(30), abs=1e3)


@pytest.mark.parametrize("step_s", [1e9, 2e5, 30.0, -1e9, -2e5])
@pytest.mark.parametrize("is_within_chunk", [True, False])
def test_stamps_that_jump_by_more_than_the_station_s_clock_are_a_clock_event_and_no_loss(
    outlet: Mock, step_s: float, is_within_chunk: bool
) -> None:
    device = opened()
    for first_s in (100.0, 100.1):
        send(outlet, first_s, 100)
    if is_within_chunk:
        outlet.chunks[1][1][50:] += step_s  # type: ignore[index,operator]
    send(outlet, 100.2 + step_s, 100)
    items = [item for _ in range(3) for item in device.read(0.0)]
    assert [item.kind for item in items if isinstance(item, Event)] == ["emg_clock_reset"]
    assert not any(isinstance(item, Loss) for item in items)
    numbers = np.concatenate([block.sample_numbers for block in blocks(items, "/emg")])
    assert numbers.tolist() == list(range(300))


def test_stamps_that_creep_ahead_count_no_more_samples_than_time_allows(outlet: Mock) -> None:
    """Chunks of 0.1 s arrive every second; their stamps are 1.3 s apart."""
    device, chunks = opened(), 40
    for chunk in range(chunks):
        send(outlet, 10.0 + 1.3 * chunk, 100)
    items = [item for _ in range(chunks) for item in device.read(0.0)]
    lost = sum(item.count for item in items if isinstance(item, Loss))
    assert 1000 * (chunks - 1) < lost + 100 * chunks <= 1000 * (1.01 * chunks + 1)
    assert any(isinstance(item, Event) and item.kind == "emg_clock_reset" for item in items)


def test_stamps_that_alternate_between_two_clocks_are_one_event_a_chunk(outlet: Mock) -> None:
    device = opened()
    for chunk in range(3):
        send(outlet, 100.0 + 0.1 * chunk, 100)
        outlet.chunks[-1][1][1::2] += 2e5  # type: ignore[index,operator]
    items = [item for _ in range(3) for item in device.read(0.0)]
    assert sum(isinstance(item, Event) for item in items) == 3
    assert not any(isinstance(item, Loss) for item in items)
    assert [len(block.sample_numbers) for block in blocks(items, "/emg")] == [100, 100, 100]


def test_a_chunk_without_a_time_is_recorded_and_a_clock_offset_is_the_sender_s_time(outlet: Mock) -> None:
    device = opened()
    outlet.chunks.append((np.zeros((10, 2), np.float32), np.full(10, np.nan)))
    items = device.read(0.0)
    (block,), (offset,) = blocks(items, "/emg"), blocks(items, "/emg_clock")
    assert len(block.sample_numbers) == 10
    assert offset.device_time_ns.tolist() == [90_000_000_000]  # here 50 s, there 40 s more
    assert offset.values.tolist() == [[-40.0, 2e-4]]


def test_after_an_outage_the_numbers_jump_by_the_stamps_or_else_by_the_station_s_clock(outlet: Mock) -> None:
    device = opened()
    send(outlet, 100.0, 50)
    device.read(0.0)
    device.resume()
    send(outlet, 103.049, 50)
    (by_stamps,) = blocks(device.read(0.0), "/emg")
    assert int(by_stamps.sample_numbers[0]) == 3049
    device.resume()
    send(outlet, 5.0, 50)  # its computer was started anew
    (by_host,) = blocks(device.read(0.0), "/emg")
    seconds = (by_host.host_time_ns - by_stamps.host_time_ns) * 1e-9
    assert int(by_host.sample_numbers[0]) == 3098 + round(1000 * seconds)


def test_a_lost_outlet_is_lost_in_a_sentence(outlet: Mock) -> None:
    device = opened()
    outlet.chunks.append(RuntimeError("the stream read by this inlet has been lost."))
    with raises_refusal(DeviceCode.DISCONNECTED, naming="LSL amp"):
        device.read(0.0)


def test_an_outlet_without_labels_and_units_is_recorded_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    offer(monkeypatch, fake_outlet(None, None))
    emg, _ = opened().streams
    assert (emg.labels, emg.unit) == (("channel_1", "channel_2"), "unknown")
    assert opened(unit="mV").streams[0].unit == "mV"


@pytest.mark.parametrize(
    ("outlets", "options", "code"),
    [
        ([fake_outlet(is_text=True)], {}, DeviceCode.NO_SIGNAL),
        ([fake_outlet(rate_hz=0.0)], {}, DeviceCode.NO_SIGNAL),
        ([fake_outlet(units=["microvolts", "V"])], {}, DeviceCode.MIXED_UNITS),
        ([fake_outlet()], {"channels": {"x": "c"}}, DeviceCode.NO_CHANNEL),
        ([fake_outlet()], {"sync_channel": "t"}, DeviceCode.NO_CHANNEL),
        ([fake_outlet(), fake_outlet()], {}, DeviceCode.SEVERAL_OUTLETS),
    ],
)
def test_an_outlet_that_cannot_be_recorded_is_refused_in_a_sentence(
    monkeypatch: pytest.MonkeyPatch, outlets: list[Mock], options: dict[str, Any], code: DeviceCode
) -> None:
    offer(monkeypatch, *outlets)
    with raises_refusal(code):
        opened(**options)


def test_another_outlet_after_an_outage_is_refused(monkeypatch: pytest.MonkeyPatch, outlet: Mock) -> None:
    device = opened()
    offer(monkeypatch, fake_outlet(rate_hz=500.0))
    with raises_refusal(DeviceCode.CHANGED):
        device.resume()


def test_the_drivers_load_no_vendor_package_before_they_are_opened() -> None:
    code = (
        "import sys, drivers.lsl, drivers.nidaq; drivers.lsl.LslEmg(stream='a', host_clock=int)\n"
        "sys.exit(bool({'pylsl', 'nidaqmx', 'grpc'} & sys.modules.keys()))"
    )
    assert subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=False).returncode == 0  # noqa: S603
