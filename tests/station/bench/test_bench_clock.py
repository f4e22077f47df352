"""Clocks of the station, and trials on the clock of a simulated bench: what holds the world, and what ends with it."""

import logging
import re
import socket
import struct
import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from drivers.errors import DeviceCode, DeviceLost, DeviceUnavailable
from drivers.qualisys import Qualisys
from drivers.simulators import world_clock
from drivers.simulators.simulated_bench import Bench
from recordings.contents import read_contents
from recordings.reader import open_recording
from recordings.samples import Samples
from station.bench import bench_clock
from station.bench.bench_clock import BenchClock
from station.bench.simulation import SimulatedBench
from station.bench.trial_recorder import TrialRecorder
from station.bench.view import Snapshot, TrialState
from station.clock import ManualClock, RealClock, SteppedClock
from station.console.running_view import streams_text
from station.messages.bench_messages import TrialCode
from station.protocol import TrialSpec
from station.session.trial_daemon import Telemetry
from tests.refusals import raises_refusal
from tests.station.fake_devices import view
from tests.station.session.benched import config_at
from tests.timeout import scaled_timeout

MakeBench = Callable[..., Bench]
SHORT = {"static": {"lead_in_s": 1.0, "hold_s": 2.0, "step_masses_kg": [3.0]}}
SPEC = TrialSpec("waist", "static", 1)


def after_a_second(act: Callable[[], None]) -> SimpleNamespace:
    """A view that acts once a second of the trial has been recorded."""
    acts = [act]

    def show(snapshot: Snapshot) -> None:
        if acts and snapshot.state is TrialState.RECORDING and snapshot.recorded_s > 1.0:
            acts.pop()()

    return view(show)


def test_a_trial_holds_blocks_of_the_world_s_time(simulated_bench: MakeBench, tmp_path: Path) -> None:
    bench = simulated_bench(protocol=SHORT)
    with BenchClock(bench.ports["clock"]) as clock:
        result = TrialRecorder(config_at(bench.ports), clock).record(tmp_path, SPEC)
        assert clock.station_s() == bench.world.now()
    assert result.accepted and not result.lost_samples and result.path is not None
    blocks = [item for item in open_recording(result.path).items() if isinstance(item, Samples)]
    arrivals_s = (np.array([block.host_time_ns for block in blocks]) - bench.start_utc_ns) * 1e-9
    steps = arrivals_s / bench_clock.LONGEST_STEP_S
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-6)
    assert len({(block.stream, block.host_time_ns) for block in blocks}) == len(blocks), "one of each stream in a step"


def test_a_trial_at_a_pace_has_the_blocks_of_a_real_bench(simulated_bench: MakeBench, tmp_path: Path) -> None:
    bench = simulated_bench(speed=20, protocol=SHORT)
    with BenchClock(bench.ports["clock"], speed=4.0) as clock:
        assert bench.clock.speed == 4.0
        before = clock.station_s()
        clock.step()
        assert clock.station_s() - before == pytest.approx(4.0 * bench_clock.BLOCK_S)
    assert bench.clock.speed == 20.0, "a station's pace ends with it"


def test_a_server_that_is_not_a_clock_is_refused() -> None:
    def answer(server: socket.socket) -> None:
        with server.accept()[0] as connection:
            connection.sendall(b"QTM RT Interface connected\n")

    with socket.create_server(("127.0.0.1", 0)) as server:
        other = threading.Thread(target=answer, args=(server,))
        other.start()
        with raises_refusal(DeviceCode.NO_ANSWER, kind=DeviceUnavailable):
            BenchClock(server.getsockname()[1]).__enter__()
        other.join()


def test_the_telemetry_has_the_rate_of_a_bench_that_is_too_slow(
    simulated_bench: MakeBench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wall_s = [0.0]
    monkeypatch.setattr(bench_clock.time, "perf_counter", lambda: wall_s[0])
    bench = simulated_bench()
    with BenchClock(bench.ports["clock"], speed=1000.0) as clock:
        clock._pace = 1.0  # as if it had been set: the wall of this test does not move the world
        for _ in range(8):
            clock.step()
            wall_s[0] += clock._step_s / 0.6
        telemetry = Telemetry(lambda _: None, None, config_at(bench.ports).calibration(), tmp_path, clock)
        line = telemetry._message()
    assert streams_text(line).startswith("simulated bench runs at 0.60 of real time")
    assert "real time" not in streams_text(line.model_copy(update={"slow_rate": None}))


@pytest.mark.slow
def test_a_simulator_that_is_killed_ends_the_trial_as_a_lost_device_does(tmp_path: Path) -> None:
    with SimulatedBench({"protocol": SHORT}, None, 1) as bench:
        child = bench._child
        assert child is not None
        with BenchClock(bench.clock_port) as clock:
            daemon = TrialRecorder(config_at(bench.ready["ports"]), clock, [after_a_second(child.process.kill)])
            result = daemon.record(tmp_path, SPEC)
    assert not result.accepted and result.path is not None
    assert [message.code for message in result.messages] == [TrialCode.DEVICE_LOST]
    assert "the simulated devices" in result.sentence and "127.0.0.1" not in result.sentence
    assert result.sentence.count("\n") == 0
    contents = read_contents(result.path)
    assert contents.complete and contents.streams["/force"].samples > 1000


def test_a_second_station_is_refused_and_the_first_continues(simulated_bench: MakeBench, tmp_path: Path) -> None:
    bench = simulated_bench(protocol=SHORT)
    refused: list[str] = []

    def try_another() -> None:
        with pytest.raises(DeviceUnavailable) as caught:
            TrialRecorder(config_at(bench.ports), RealClock()).record(tmp_path / "other", SPEC)
        refused.append(str(caught.value))

    with BenchClock(bench.ports["clock"]) as clock:
        result = TrialRecorder(config_at(bench.ports), clock, [after_a_second(try_another)]).record(
            tmp_path / "first", SPEC
        )
    assert result.accepted and not result.lost_samples
    assert len(refused) == 1 and "is in use by another recording on this computer" in refused[0]
    assert not list((tmp_path / "other").glob("*.mcap"))


def test_another_reader_of_qtm_sees_every_frame_too(simulated_bench: MakeBench, tmp_path: Path) -> None:
    bench = simulated_bench(protocol=SHORT)
    other = Qualisys(host="127.0.0.1", port=bench.ports["qtm"], host_clock=time.time_ns)
    other.open()
    with BenchClock(bench.ports["clock"]) as clock:
        result = TrialRecorder(config_at(bench.ports), clock).record(tmp_path, SPEC)
    assert result.path is not None
    recorded = open_recording(result.path).load("/markers").sample_numbers
    seen: list[int] = []
    give_up_s = time.perf_counter() + scaled_timeout(30.0)
    while len(seen) < len(recorded) and time.perf_counter() < give_up_s:
        seen += [int(n) for item in other.read(0.1) if isinstance(item, Samples) for n in item.sample_numbers]
    other.close()
    assert seen[: len(recorded)] == recorded.tolist() == list(range(1, len(recorded) + 1))


def test_a_client_that_never_reads_is_dropped_and_the_world_continues(
    simulated_bench: MakeBench, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(world_clock, "DROP_AFTER_S", 0.1)
    bench = simulated_bench(operator={"capture": "remote"}, mocap={"has_preview": True, "rate_hz": 2000})
    bench.world.start_capture()
    with socket.create_connection(("127.0.0.1", bench.ports["qtm"])) as client:
        client.recv(100)
        command = b"streamframes allframes 3dres\0"
        client.sendall(struct.pack("<II", 8 + len(command), 1) + command)
        with caplog.at_level(logging.WARNING):
            for _ in range(200):
                bench.clock.advance(1.0)
                if "is dropped" in caplog.text:
                    break
    assert re.search(r"the client of QTM at port \d+ has read nothing for 0\.1 s and is dropped", caplog.text)
    before = bench.world.now()
    bench.clock.advance(1.0)
    assert bench.world.now() == pytest.approx(before + 1.0)


def test_without_a_simulated_bench_the_clock_is_refused() -> None:
    with socket.create_server(("127.0.0.1", 0)) as closed:
        port = closed.getsockname()[1]
    with raises_refusal(DeviceCode.NO_SERVER, kind=DeviceUnavailable):
        BenchClock(port).__enter__()


def test_a_detached_clock_does_not_advance_the_world(simulated_bench: MakeBench) -> None:
    clock = BenchClock(simulated_bench().ports["clock"])
    with clock:
        clock.step()
    with raises_refusal(DeviceCode.CLOSED, kind=DeviceLost):
        clock.step()


def test_the_manual_clock_advances_on_request_and_by_steps() -> None:
    clock = ManualClock(step_s=0.5)
    before = clock.utc_ns()
    clock.advance(2.0)
    clock.step()
    assert clock.station_s() == 2.5
    assert clock.utc_ns() - before == 2_500_000_000


def test_the_real_clock_never_goes_back_and_is_no_stepped_clock() -> None:
    clock = RealClock()
    readings = [clock.utc_ns() for _ in range(1000)]
    assert readings == sorted(readings)
    assert [isinstance(one, SteppedClock) for one in (clock, ManualClock())] == [False, True]
