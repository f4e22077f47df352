"""Sessions of the simulated device server, by unmodified nidaqmx, as in ni/grpc-device's session_repository.cpp."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Any

import grpc
import nidaqmx
import pytest
from nidaqmx import SessionInitializationBehavior
from nidaqmx.constants import AcquisitionType, TerminalConfiguration
from nidaqmx.system import Device

from drivers.simulators.nidaq_server import NiDaqSimulator
from tests.drivers.stand_in_world import StandInWorld

NAME = "our_task"


@contextlib.contextmanager
def client(server: NiDaqSimulator) -> Iterator[grpc.Channel]:
    """A client that goes without a word, as a killed one does."""
    with grpc.insecure_channel(server.target) as channel:
        yield channel


def open_task(
    channel: grpc.Channel, name: str, behavior: SessionInitializationBehavior = SessionInitializationBehavior.AUTO
) -> Any:
    options = nidaqmx.GrpcSessionOptions(channel, name, initialization_behavior=behavior)
    return nidaqmx.Task(name, grpc_options=options)


def start_acquisition(task: Any) -> None:
    task.ai_channels.add_ai_voltage_chan("Dev1/ai0", terminal_config=TerminalConfiguration.DIFF)
    task.timing.cfg_samp_clk_timing(1000.0, sample_mode=AcquisitionType.CONTINUOUS)
    task.start()


def leave_task(server: NiDaqSimulator) -> None:
    with client(server) as channel:
        start_acquisition(open_task(channel, NAME))


def test_a_task_continues_without_its_client_and_keeps_the_device_from_others(
    server: NiDaqSimulator, world: StandInWorld
) -> None:
    leave_task(server)
    world.advance(3600.0)
    with client(server) as channel, pytest.raises(nidaqmx.DaqError) as caught:
        start_acquisition(open_task(channel, ""))
    assert caught.value.error_code == -200022
    assert server.is_streaming


def test_a_client_with_the_name_of_a_session_can_attach_to_its_task_and_clear_it(
    server: NiDaqSimulator, world: StandInWorld
) -> None:
    leave_task(server)
    world.advance(0.1)
    with client(server) as channel:
        left = open_task(channel, NAME, SessionInitializationBehavior.ATTACH_TO_SERVER_SESSION)
        assert not left.is_task_done()
        assert len(left.read(60)) == 60
        assert (left.in_stream.curr_read_pos, left.in_stream.total_samp_per_chan_acquired) == (60, 101)
        left.close()
        assert not server.is_streaming
        start_acquisition(open_task(channel, NAME, SessionInitializationBehavior.INITIALIZE_SERVER_SESSION))


@pytest.mark.parametrize(
    ("name", "behavior", "status", "words"),
    [
        (NAME, "INITIALIZE_SERVER_SESSION", grpc.StatusCode.ALREADY_EXISTS, "when a session already exists"),
        ("none", "ATTACH_TO_SERVER_SESSION", grpc.StatusCode.FAILED_PRECONDITION, "has not been initialized"),
    ],
)
def test_a_session_that_is_not_as_its_client_expects_is_refused(
    server: NiDaqSimulator, name: str, behavior: str, status: grpc.StatusCode, words: str
) -> None:
    leave_task(server)
    with client(server) as channel, pytest.raises(nidaqmx.errors.RpcError, match=words) as caught:
        open_task(channel, name, SessionInitializationBehavior[behavior])
    assert caught.value.rpc_code == status


def test_a_reset_of_the_device_aborts_the_task_of_every_client(server: NiDaqSimulator) -> None:
    leave_task(server)
    with client(server) as channel:
        Device("Dev1", grpc_options=nidaqmx.GrpcSessionOptions(channel, "")).reset_device()
        with pytest.raises(nidaqmx.DaqError) as caught:
            open_task(channel, NAME).read(1)
        start_acquisition(open_task(channel, "another"))
    assert caught.value.error_code == -88709
