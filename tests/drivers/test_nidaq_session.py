"""What a dead client leaves in NI's server, and what is not ours there.

Errors of the transport as sentences.
"""

import os
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import grpc
import nidaqmx
import numpy as np
import pytest
from nidaqmx.constants import AcquisitionType, TerminalConfiguration

from drivers import nidaq, nidaq_session
from drivers.errors import DeviceCode
from drivers.nidaq import NiDaq
from drivers.nidaq_session import opening_error
from drivers.reconnecting import Reconnecting
from drivers.simulators.daq_rpcs import NiDaqSimulator, _Service
from drivers.simulators.faults import Fault
from drivers.simulators.usb6008 import DaqmxError
from recordings.samples import Event, Item, Loss, Samples
from tests.drivers.contract import blocks, is_one_sentence, raises_refusal
from tests.drivers.fault_bench import unaccounted
from tests.drivers.simulated_qtm import daq
from tests.drivers.stand_in_world import StandInWorld
from tests.drivers.tcp_proxy import TcpProxy
from tests.links import symlink
from tests.timeout import scaled_timeout

DEATHS, BREAKS = 5, 5  # in a row


@dataclass(frozen=True)
class Link:
    """An open device behind a proxy that can break its connection."""

    proxy: TcpProxy
    device: Reconnecting


@pytest.fixture
def link(server: NiDaqSimulator, world: StandInWorld) -> Iterator[Link]:
    with TcpProxy(server.port) as proxy:
        device = Reconnecting(daq(proxy.port, world.utc_ns), world.utc_ns, timeout_s=scaled_timeout(30.0))
        device.open()
        yield Link(proxy, device)
        device.close()


def die(device: NiDaq) -> None:
    """What the death of its program does: the connection goes, the operating system frees the lock."""
    session, device._session, device._task = device._session, None, None
    session.disconnect()
    session.release()


def reads_ten_samples(device: NiDaq, world: StandInWorld) -> bool:
    world.advance(0.01)
    return any(len(block.sample_numbers) >= 10 for block in blocks(list(device.read(0.1)), "/force"))


@pytest.fixture
def other_program(server: NiDaqSimulator) -> Iterator[Any]:
    """A program of another make that acquires from the same device."""
    with grpc.insecure_channel(server.target) as channel:
        task = nidaqmx.Task(grpc_options=nidaqmx.GrpcSessionOptions(channel, ""))
        task.ai_channels.add_ai_voltage_chan("Dev1/ai0", terminal_config=TerminalConfiguration.DIFF)
        task.timing.cfg_samp_clk_timing(1000.0, sample_mode=AcquisitionType.CONTINUOUS)
        yield task
        task.close()


def test_the_task_of_a_dead_program_is_cleared_by_the_next_one(server: NiDaqSimulator, world: StandInWorld) -> None:
    for _ in range(DEATHS):
        device = daq(server.port, world.utc_ns)
        device.open()
        assert reads_ten_samples(device, world)
        die(device)
        assert server.is_streaming, "the server keeps what a dead client held"
    device.open()
    assert reads_ten_samples(device, world)
    device.close()
    assert not server.is_streaming


def test_a_device_that_another_program_reads_is_refused_and_never_reset(
    server: NiDaqSimulator, world: StandInWorld, other_program: Any
) -> None:
    left = daq(server.port, world.utc_ns)
    left.open()
    die(left)
    device = daq(server.port, world.utc_ns)
    device.open()  # clears what was left
    device.close()
    other_program.start()
    for _ in range(3):
        with raises_refusal(DeviceCode.IN_USE):
            device.open()
    world.advance(0.1)
    assert len(other_program.read(100)) == 100


def test_another_recording_on_this_computer_is_refused_and_the_first_continues(
    server: NiDaqSimulator, world: StandInWorld
) -> None:
    first, second = daq(server.port, world.utc_ns), daq(server.port, world.utc_ns)
    first.open()
    with raises_refusal(DeviceCode.IN_USE):
        second.open()
    assert reads_ten_samples(first, world)
    first.close()
    second.open()
    assert reads_ten_samples(second, world)
    second.close()


def test_a_device_whose_task_cannot_be_cleared_is_reset_where_our_own_task_held_it(
    server: NiDaqSimulator, world: StandInWorld, monkeypatch: pytest.MonkeyPatch
) -> None:
    left = daq(server.port, world.utc_ns)
    left.open()
    assert reads_ten_samples(left, world)
    die(left)
    monkeypatch.setattr(_Service, "ClearTask", forget_the_session_and_fail)
    device = daq(server.port, world.utc_ns)
    device.open()
    assert reads_ten_samples(device, world)
    monkeypatch.undo()
    device.close()


def test_a_task_that_cannot_be_cleared_and_did_not_acquire_resets_nothing(
    server: NiDaqSimulator, world: StandInWorld, other_program: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    other_program.start()
    device = daq(server.port, world.utc_ns)
    monkeypatch.setattr(_Service, "ClearTask", forget_the_session_and_fail)
    for _ in range(2):  # the first attempt leaves a task that never started
        with raises_refusal(DeviceCode.IN_USE):
            device.open()
    monkeypatch.undo()
    world.advance(0.1)
    assert len(other_program.read(100)) == 100


def test_a_task_that_continues_behind_a_broken_link_is_read_on_without_a_loss(link: Link, world: StandInWorld) -> None:
    items = read_beyond(link.device, world, 0.5)
    for _ in range(BREAKS):
        link.proxy.refuse()
        world.advance(0.5)  # seconds in which no client reads the device
        items += read_until_lost(link.device)
        link.proxy.listen()
        items += read_beyond(link.device, world, 0.1)
    numbers = np.concatenate([block.sample_numbers for block in blocks(items, "/force")])
    np.testing.assert_array_equal(numbers, np.arange(len(numbers)))
    assert len(numbers) > BREAKS * 600
    assert not [item for item in items if isinstance(item, Loss)]
    events = [item.kind for item in items if isinstance(item, Event)]
    assert events == ["connection_lost", "connection_restored"] * BREAKS


def test_samples_whose_reply_was_lost_with_the_link_are_counted_to_the_sample(link: Link, world: StandInWorld) -> None:
    proxy = link.proxy
    items = read_beyond(link.device, world, 0.5)
    world.advance(1.0)
    proxy.on_data = lambda data: proxy.reset() if len(data) > 4000 else None  # a thousand samples of two channels
    items += read_until_lost(link.device)
    proxy.on_data = lambda data: None
    items += read_beyond(link.device, world, 0.1)
    losses = [item for item in items if isinstance(item, Loss)]
    assert [(loss.stream, loss.cause) for loss in losses] == [("/force", "disconnected"), ("/sync", "disconnected")]
    assert losses[0].count == 1000
    assert unaccounted(items, "/force") == unaccounted(items, "/sync") == []
    first = next(block for block in blocks(items, "/force") if block.sample_numbers[0] > losses[0].first_missing)
    assert first.values[0, 0] == pytest.approx(1.0 + 0.01 * first.device_time_ns[0] * 1e-9, abs=0.02)


def test_a_task_that_died_behind_a_broken_link_is_begun_anew(link: Link, world: StandInWorld) -> None:
    items = read_beyond(link.device, world, 0.5)
    link.proxy.refuse()
    world.faults.inject(Fault("ni", "unplug", at_s=0.0, for_s=0.2))
    world.advance(0.5)
    items += read_until_lost(link.device)
    link.proxy.listen()
    items += read_beyond(link.device, world, 0.1)
    loss = next(item for item in items if isinstance(item, Loss))
    assert loss.count == pytest.approx(599, abs=2)
    assert unaccounted(items, "/force") == []


def test_a_network_with_a_longer_round_trip_than_allowed_is_named_as_the_reason(
    server: NiDaqSimulator, world: StandInWorld, monkeypatch: pytest.MonkeyPatch
) -> None:
    connect_s = scaled_timeout(20.0)
    monkeypatch.setattr(nidaq, "CONNECT_TIMEOUT_S", connect_s)
    monkeypatch.setattr(nidaq_session, "LONGEST_ROUND_TRIP", 0.19 / connect_s)
    with TcpProxy(server.port, delay_s=0.1) as slow, raises_refusal(DeviceCode.NETWORK_TOO_SLOW):
        daq(slow.port, world.utc_ns).open()


def test_a_link_in_the_place_of_the_note_leads_to_no_other_file(
    server: NiDaqSimulator, world: StandInWorld, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(nidaq_session, "FOLDER", str(tmp_path))
    other = tmp_path / "precious.txt"
    other.write_text("precious")
    device = daq(server.port, world.utc_ns)
    device.open()
    note = next(tmp_path.glob("*.session"))
    device.close()
    assert not note.exists(), "a session that was closed leaves no note"
    symlink(note, other)
    device.open()
    device.close()
    assert other.read_text() == "precious"


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="Windows keeps its named pipes in no folder")
def test_a_pipe_in_place_of_the_note_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(nidaq_session, "FOLDER", str(tmp_path))
    claim = nidaq_session.SessionClaim("127.0.0.1:31763", "Dev1")
    claim.acquire()
    claim.note()
    (note,) = tmp_path.glob("*.session")
    noted = claim.name
    claim.acquire()
    assert claim.name == noted, "the name of a session that was left open is read"
    note.unlink()
    os.mkfifo(note)
    claim.acquire()
    claim.release()
    assert claim.name != noted


def read_until_lost(device: Reconnecting) -> list[Item]:
    items: list[Item] = []
    give_up_s = time.perf_counter() + scaled_timeout(20.0)
    while not any(isinstance(item, Event) and item.kind == "connection_lost" for item in items):
        assert time.perf_counter() < give_up_s, "the loss of the link was not noticed"
        items += device.read(0.1)
    return items


def read_beyond(device: Reconnecting, world: StandInWorld, seconds: float) -> list[Item]:
    """Advance by `seconds`, and read until their samples have arrived."""
    world.advance(seconds)
    items: list[Item] = []
    give_up_s = time.perf_counter() + scaled_timeout(20.0)
    while not any(isinstance(item, Samples) for item in items):
        assert time.perf_counter() < give_up_s, f"no samples came, only {items}"
        items += device.read(0.1)
    return items


def forget_the_session_and_fail(service: _Service, request: Any, context: grpc.ServicerContext) -> None:
    """As NI's server does where NI-DAQmx cannot clear a task: the session is removed first."""
    service.sessions._tasks.pop(request.task.name, None)
    error = DaqmxError(-200088, "Task specified is invalid or does not exist.")
    context.set_trailing_metadata((("ni-error", str(error.error_code)),))
    context.abort(grpc.StatusCode.UNKNOWN, str(error))


class FrozenCall(grpc.RpcError):
    """As grpc raises it when a server that was reached does not answer a call."""

    def code(self) -> grpc.StatusCode:
        return grpc.StatusCode.DEADLINE_EXCEEDED

    def details(self) -> str:
        return "Deadline Exceeded"

    def __str__(self) -> str:
        return "<_InactiveRpcError of RPC that terminated with:\n\tstatus = StatusCode.DEADLINE_EXCEEDED\n>"


def test_a_call_without_an_answer_is_a_sentence_and_no_dump_of_the_transport() -> None:
    error = opening_error(FrozenCall(), "NI Dev1", "127.0.0.1:1", "ai0")
    assert error.code is DeviceCode.NO_ANSWER
    assert "StatusCode" not in str(error)
    assert is_one_sentence(error)
