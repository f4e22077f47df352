"""What laboratories do with nidaqmx beyond our driver, against the simulated server."""

import contextlib
import threading
from collections.abc import Iterator
from typing import Any

import grpc
import nidaqmx
import numpy as np
import pytest
from nidaqmx import SessionInitializationBehavior
from nidaqmx.constants import READ_ALL_AVAILABLE, AcquisitionType, BusType, TerminalConfiguration, TriggerUsage
from nidaqmx.stream_readers import AnalogMultiChannelReader
from nidaqmx.system import Device, System

from drivers.simulators.daq_rpcs import NiDaqSimulator
from tests.drivers.stand_in_world import StandInWorld
from tests.timeout import scaled_timeout

NAME = "our_task"


def raises_code(code: int) -> pytest.RaisesExc[nidaqmx.DaqError]:
    return pytest.raises(nidaqmx.DaqError, check=lambda error: error.error_code == code)


@pytest.fixture
def world() -> Iterator[StandInWorld]:
    world = StandInWorld(speed=5.0)
    yield world
    world.clock.stop()


@pytest.fixture
def server(world: StandInWorld) -> Iterator[NiDaqSimulator]:
    server = NiDaqSimulator(world)
    server.start()
    yield server
    server.stop()


@pytest.fixture
def options(server: NiDaqSimulator) -> Iterator[nidaqmx.GrpcSessionOptions]:
    with grpc.insecure_channel(server.target) as channel:
        yield nidaqmx.GrpcSessionOptions(channel, "")


@pytest.fixture
def task(options: nidaqmx.GrpcSessionOptions) -> Iterator[Any]:
    with nidaqmx.Task(grpc_options=options) as task:
        yield task


def configure(task: Any, channels: str = "Dev1/ai0:1") -> Any:
    task.ai_channels.add_ai_voltage_chan(
        channels, terminal_config=TerminalConfiguration.DIFF, min_val=-10.0, max_val=10.0
    )
    task.timing.cfg_samp_clk_timing(1000.0, sample_mode=AcquisitionType.CONTINUOUS)
    return task


def test_task_read_returns_a_list_per_channel(task: Any) -> None:
    configure(task).start()
    assert np.shape(task.read(number_of_samples_per_channel=100)) == (2, 100)
    assert np.shape(task.read(READ_ALL_AVAILABLE))[0] == 2


def test_a_late_read_is_a_time_out_with_the_number_of_samples(world: StandInWorld, task: Any) -> None:
    world.clock.speed = None  # it moves as the test says
    configure(task).start()
    world.advance(0.5)
    reader = AnalogMultiChannelReader(task.in_stream)
    with raises_code(-200284) as caught:
        reader.read_many_sample(np.zeros((2, 9000)), 9000, timeout=0.05)
    assert caught.value.samps_per_chan_read == pytest.approx(500, abs=2)


def test_the_system_lists_a_usb_6008(options: nidaqmx.GrpcSessionOptions) -> None:
    system = System.remote(options)
    device = system.devices["Dev1"]
    assert system.devices.device_names == ["Dev1"]
    assert device.product_type == "USB-6008"
    assert [channel.name for channel in device.ai_physical_chans] == ["Dev1/ai0", "Dev1/ai1", "Dev1/ai2", "Dev1/ai3"]
    assert device.bus_type == BusType.USB
    assert device.ai_trig_usage == [TriggerUsage.START]
    assert device.dig_trig_supported
    assert not device.anlg_trig_supported
    assert device.ai_max_multi_chan_rate == 10_000


def test_buffer_and_clock_can_be_asked_and_set(task: Any) -> None:
    configure(task)
    assert task.timing.samp_clk_rate == 1000
    assert task.in_stream.input_buf_size == 10_000
    task.in_stream.input_buf_size = 50_000
    assert task.in_stream.input_buf_size == 50_000


def test_every_n_samples_calls_back(task: Any) -> None:
    called = threading.Semaphore(0)
    configure(task, "Dev1/ai0")
    task.register_every_n_samples_acquired_into_buffer_event(100, lambda *_: (called.release(), 0)[1])
    task.start()
    assert all(called.acquire(timeout=scaled_timeout(30.0)) for _ in range(5))
    task.register_every_n_samples_acquired_into_buffer_event(100, None)


def test_what_it_does_not_imitate_is_unimplemented_and_single_ended_acquisition_refused(task: Any) -> None:
    with pytest.raises(nidaqmx.errors.RpcError) as caught:
        task.do_channels.add_do_chan("Dev1/port0/line0")
    assert caught.value.rpc_code == grpc.StatusCode.UNIMPLEMENTED
    with raises_code(-200077):
        task.ai_channels.add_ai_voltage_chan("Dev1/ai0", terminal_config=TerminalConfiguration.RSE)


def test_on_demand_a_task_samples_when_it_is_read(options: nidaqmx.GrpcSessionOptions) -> None:
    with nidaqmx.Task(grpc_options=options) as task, nidaqmx.Task(grpc_options=options) as other:
        task.ai_channels.add_ai_voltage_chan("Dev1/ai0")
        assert task.read() == pytest.approx(1.005, abs=0.05)
        assert np.shape(task.read(5)) == (5,)
        assert np.shape(task.read(READ_ALL_AVAILABLE)) == (1,)
        other.ai_channels.add_ai_voltage_chan("Dev1/ai0:1")
        assert np.shape(other.read()) == (2,), "between two reads the device is free for another task"
        task.start()
        with raises_code(-200022):
            other.read()


def test_a_finite_task_acquires_so_many_samples_and_no_more(task: Any) -> None:
    task.ai_channels.add_ai_voltage_chan("Dev1/ai0:1")
    task.timing.cfg_samp_clk_timing(1000.0, sample_mode=AcquisitionType.FINITE, samps_per_chan=50)
    assert task.timing.samp_quant_samp_mode is AcquisitionType.FINITE
    assert task.timing.samp_quant_samp_per_chan == 50
    task.start()
    assert np.shape(task.read(20)) == (2, 20)
    task.wait_until_done(timeout=scaled_timeout(30.0))
    assert task.is_task_done()
    assert np.shape(task.read(READ_ALL_AVAILABLE)) == (2, 30), "the rest of them"
    with raises_code(-200278):
        task.read(1)
    task.stop()
    assert np.shape(task.read(READ_ALL_AVAILABLE)) == (2, 50), "it is started for the read, and waited for"
    assert np.shape(task.read(READ_ALL_AVAILABLE)) == (2, 50), "and once more"


def test_a_finite_task_waits_for_its_trigger(world: StandInWorld, task: Any) -> None:
    task.ai_channels.add_ai_voltage_chan("Dev1/ai1", min_val=-10.0, max_val=10.0)
    task.timing.cfg_samp_clk_timing(1000.0, sample_mode=AcquisitionType.FINITE, samps_per_chan=50)
    task.triggers.start_trigger.cfg_dig_edge_start_trig("/Dev1/PFI0")
    task.start()
    with pytest.raises(nidaqmx.errors.DaqReadError) as caught:
        task.read(50, timeout=0.05)
    assert (caught.value.error_code, caught.value.samps_per_chan_read) == (-200284, 0)
    with raises_code(-200560):
        task.wait_until_done(timeout=0.05)
    world.edge_s = world.now() + 0.1
    assert min(task.read(50)) > 4.5, "from the edge of the sync line on"


def test_the_limits_of_a_channel_can_be_asked_and_set_as_the_vendor_s_example_does(task: Any) -> None:
    channel = task.ai_channels.add_ai_voltage_chan("Dev1/ai0", max_val=0.1, min_val=-0.1)
    assert (channel.ai_max, channel.ai_min, channel.ai_rng_high) == (0.1, -0.1, 1.0)
    channel.ai_max = 5
    assert (channel.ai_max, channel.ai_min, channel.ai_rng_high, channel.ai_rng_low) == (5.0, -0.1, 5.0, -5.0)
    more = task.ai_channels.add_ai_voltage_chan("Dev1/ai1:3", max_val=10, min_val=-10)
    assert (more.ai_max, more.ai_min, channel.ai_max) == (10.0, -10.0, 5.0)
    assert task.ai_channels["Dev1/ai2"].physical_channel.name == "Dev1/ai2"
    assert channel.ai_term_cfg is TerminalConfiguration.DIFF
    with raises_code(-200077):
        channel.ai_max = 25
    with raises_code(-200486):
        _ = task.ai_channels["Dev1/ai0"].__class__(task._handle, "Dev1/ai9", task._interpreter).ai_max


def test_a_task_that_does_not_exist_is_refused(options: nidaqmx.GrpcSessionOptions) -> None:
    task = nidaqmx.Task(grpc_options=options)
    task._interpreter.clear_task(task._handle)
    with raises_code(-200088):
        task.start()


def test_a_port_that_is_taken_is_one_sentence(server: NiDaqSimulator, world: StandInWorld) -> None:
    second = NiDaqSimulator(world, port=server.port)
    with pytest.raises(RuntimeError, match=rf"cannot listen at {server.target}; end what listens there"):
        second.start()


# Sessions of the simulated device server, by unmodified nidaqmx, as in ni/grpc-device's session_repository.cpp.


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
    with client(server) as channel, raises_code(-200022):
        start_acquisition(open_task(channel, ""))
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
        assert left.in_stream.curr_read_pos == 60
        assert left.in_stream.total_samp_per_chan_acquired >= 101  # the world goes on
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
        with raises_code(-88709):
            open_task(channel, NAME).read(1)
        start_acquisition(open_task(channel, "another"))
