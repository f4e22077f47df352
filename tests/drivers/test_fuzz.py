"""Random bytes on the wires, and what must hold for all of them: a short run; benchmarks/fuzz.py runs longer."""

import contextlib
import socket
import struct
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from drivers.device import Device
from drivers.errors import DeviceError
from drivers.qualisys import Qualisys
from drivers.qualisys_wire import decode_frame, decode_parameters, markers_alone
from drivers.serial_load_cell import LONGEST_LINE, SerialLoadCell
from drivers.simulators.faults import FAULTS, fault_from_dict, read_fault_plan
from recordings.samples import Item, Loss, Samples
from tests.drivers.fault_bench import unaccounted
from tests.drivers.other_qtm import OtherQtm, packet, proper
from tests.timeout import scaled_timeout

PATIENCE_S = 20.0


@dataclass(frozen=True)
class Target:
    """holds(example) raises where it does not; share: of the examples of a run, as some take longer."""

    name: str
    examples: st.SearchStrategy[Any]
    holds: Callable[[Any], None]
    share: float = 1.0


def run(target: Target, examples: int) -> int:
    """Throws its share of so many examples at a target, and says how many that were; raises the smallest failure."""
    wanted, seen = max(10, round(target.share * examples)), 0

    @settings(max_examples=wanted, deadline=None, suppress_health_check=list(HealthCheck), database=None)
    @given(target.examples)
    def holds(example: Any) -> None:
        nonlocal seen
        seen += 1
        target.holds(example)

    holds()
    if seen < wanted // 2:
        raise AssertionError(f"{target.name} saw {seen} of {wanted} examples")
    return seen


def _frame(number: int, component: int, claimed: int, points: bytes) -> bytes:
    markers = struct.pack("<IIIHH", 16 + len(points), component, claimed, 0, 0) + points
    return struct.pack("<qII", number, number, 1) + markers


_small = st.integers(0, 40)
_word = st.integers(0, 2**32 - 1)
_frames = st.one_of(
    st.builds(_frame, _small, st.just(9), st.just(2), st.just(bytes(32))),  # what a QTM with two labels sends
    st.builds(_frame, _word, st.sampled_from([1, 9, 99]), st.one_of(_small, _word), st.binary(max_size=64)),
    st.binary(max_size=60),
)
_qtm_packets = st.one_of(
    _frames.map(lambda body: packet(3, body)),
    st.builds(packet, _small, st.binary(max_size=40)),
    st.integers(0, 255).map(lambda event: packet(6, bytes([event]))),
    st.builds(lambda size, kind: struct.pack("<II", size, kind), _word, _word),
    st.binary(max_size=40),
)
_serial_parts = st.one_of(st.just(b"+000001.5000  lbs\r\n"), st.just(b"\n"), st.binary(max_size=2 * LONGEST_LINE))
_settings = st.one_of(
    st.binary(),
    st.builds(
        lambda rate, label: (
            f"<Q><General><Frequency>{rate}</Frequency></General>"
            f"<The_3D><Label><Name>{label}</Name></Label></The_3D></Q>"
        ).encode("utf-8", "replace"),
        st.one_of(st.text(max_size=8), st.floats()),
        st.text(max_size=8),
    ),
)
_values = st.one_of(
    st.sampled_from([*FAULTS, *(fault for faults in FAULTS.values() for fault in faults)]),
    st.integers(),
    st.floats(),
    st.booleans(),
    st.none(),
    st.lists(st.text()),
)
_keys = st.sampled_from(["device", "fault", "at_s", "for_s", "capture", "labels", "x"])
_plans = st.one_of(st.binary(), st.text().map(lambda text: ("[[faults]]\ndevice = " + text).encode("utf-8", "replace")))


def _a_frame_is_whole_or_refused(body: bytes) -> None:
    with contextlib.suppress(ValueError):
        frame = decode_frame(body)
        assert len(frame.points) % 16 == 0
        assert decode_frame(markers_alone(body)) == frame


def _settings_are_usable_or_refused(xml: bytes) -> None:
    with contextlib.suppress(ValueError):
        parameters = decode_parameters(xml)
        assert parameters.labels
        assert 0 < parameters.rate_hz < float("inf")


def _qtm_is_read_to_its_end(stream: bytes) -> None:
    """Over a real connection, which ends after it: shapes and numbers are right, and the end is reported."""
    with OtherQtm(proper) as qtm:
        device = Qualisys(host="127.0.0.1", port=qtm.port, host_clock=time.time_ns)
        device.open()
        with contextlib.suppress(OSError):  # the driver hangs up on what it cannot read
            qtm.send(stream)
            qtm.hang_up()
        items = _read_to_the_end(device)
    assert unaccounted(items, "/markers") == []
    for item in items:
        if isinstance(item, Samples):
            assert item.values.shape == (item.sample_numbers.size, 2, 4)
            assert np.array_equal(np.isnan(item.values).any(axis=2), np.isnan(item.values).all(axis=2))


def _a_serial_line_is_read_to_its_end(stream: bytes) -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = f"socket://127.0.0.1:{listener.getsockname()[1]}"
        device = SerialLoadCell(port=port, baud_rate=9600, line_format="usb220", host_clock=time.time_ns)
        device.open()
        wire, _ = listener.accept()
        with wire:
            wire.sendall(stream)
        items = _read_to_the_end(device)
    assert unaccounted(items, "/force") == []
    good = sum(item.sample_numbers.size for item in items if isinstance(item, Samples))
    garbled = sum(item.count for item in items if isinstance(item, Loss))
    assert good <= stream.count(b"lbs")
    assert garbled <= stream.count(b"\n") + len(stream) // LONGEST_LINE


def _an_entry_is_a_fault_or_a_sentence(entry: dict[str, Any]) -> None:
    try:
        fault = fault_from_dict(entry)
    except ValueError as error:
        assert "\n" not in str(error)
    else:
        assert fault.at_s >= 0 <= fault.for_s


def _a_file_is_a_plan_or_a_sentence(content: bytes) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "plan.toml"
        path.write_bytes(content)
        try:
            read_fault_plan(path)
        except ValueError as error:
            assert "\n" not in str(error)


def _read_to_the_end(device: Device) -> list[Item]:
    items: list[Item] = []
    give_up_s = time.perf_counter() + scaled_timeout(PATIENCE_S)
    with contextlib.suppress(DeviceError):
        while time.perf_counter() < give_up_s:
            items += device.read(1.0)
        raise AssertionError(f"{device.name} does not know that its wire has ended")
    device.close()
    return items


TARGETS = (
    Target("QTM frame", _frames, _a_frame_is_whole_or_refused),
    Target("QTM settings", _settings, _settings_are_usable_or_refused),
    Target("QTM byte stream", st.lists(_qtm_packets, max_size=30).map(b"".join), _qtm_is_read_to_its_end, 0.25),
    Target("serial line", st.lists(_serial_parts, max_size=20).map(b"".join), _a_serial_line_is_read_to_its_end, 0.02),
    Target("fault", st.dictionaries(_keys, _values), _an_entry_is_a_fault_or_a_sentence),
    Target("fault plan", _plans, _a_file_is_a_plan_or_a_sentence),
)


@pytest.mark.parametrize("target", TARGETS, ids=lambda target: target.name)
def test_no_input_causes_a_hang_a_crash_or_a_wrong_number(target: Target) -> None:
    assert run(target, 50) > 0
