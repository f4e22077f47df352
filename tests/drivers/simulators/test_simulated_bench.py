"""The bench as a whole: both drivers on one trial, and the process that is spoken to in lines of JSON.

The clock's port, asked as any station would in any language: lines of JSON over TCP.
"""

import json
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import psutil
import pytest

from drivers.qualisys import Qualisys
from drivers.reconnecting import make_device
from drivers.simulators.errors import SimulatorCode
from drivers.simulators.settings import Settings, settings_from_dict
from drivers.simulators.simulated_bench import Bench, Operator
from drivers.simulators.world import World
from recordings.samples import Event, Item, Loss
from tests.drivers.contract import blocks, read_until
from tests.drivers.fault_bench import unaccounted
from tests.drivers.simulated_qtm import WIRING, daq, is_event, joined
from tests.timeout import scaled_timeout

SPEED = 30.0
PATIENCE_S = 20.0
SHORT = {
    "protocol": {"repeats": 1, "static": {"hold_s": 3.0, "lead_in_s": 1.0, "step_masses_kg": [2.0, 2.0, 2.0]}},
    "slip": {"first_slip_n": 20.0},
    "cuffs": {"elbow": {"stiffness_n_per_m": 3100.0}},
    "wearer": {"sway_deg": 0.0},  # so that a line through the raw markers is enough
    "mocap": {"occlusions_per_minute": 0},
    "daq_clock": {"offset_ppm": 0.0, "drift_ppm_per_hour": 0.0},
}


def recorded(ports: dict[str, int]) -> list[Item]:
    """What both drivers deliver from before the capture until it is over."""
    ni = daq(ports["ni"], time.time_ns)
    qtm = Qualisys(host="127.0.0.1", port=ports["qtm"], host_clock=time.time_ns)
    items: list[Item] = []
    give_up = time.perf_counter() + scaled_timeout(PATIENCE_S)
    try:
        ni.open()
        qtm.open()
        while not any(isinstance(item, Event) and item.kind == "capture_stopped" for item in items):
            assert time.perf_counter() < give_up, "the capture did not end"
            items += [*ni.read(0.1), *qtm.read(0.0)]
        items += ni.read(0.5)
    finally:
        ni.close()
        qtm.close()
    return items


@pytest.fixture(scope="module")
def trial() -> list[Item]:
    """A short static test of the elbow cuff, its captures started by the simulated operator."""
    with Bench(settings_from_dict(SHORT), SPEED, seed=4) as bench:
        bench.world.select_trial("elbow", "static")
        return recorded(bench.ports)


def test_the_sync_line_rises_some_seconds_after_both_devices_stream_and_falls_with_the_capture(
    trial: list[Item],
) -> None:
    t, sync = joined(trial, "/sync")
    is_high = sync[:, 0] > 2.5
    rise, fall = t[np.flatnonzero(np.diff(is_high.astype(int)))[:2] + 1]
    frames = joined(trial, "/markers")[0]
    assert rise > 2.0
    assert fall - rise == pytest.approx(len(frames) / 100, abs=0.012)


def test_force_at_the_edge_and_markers_from_frame_one_give_the_stiffness_of_the_cuff_while_unloading(
    trial: list[Item],
) -> None:
    t, sync = joined(trial, "/sync")
    rise = t[np.flatnonzero(sync[:, 0] > 2.5)[0]]
    force_t, volts = joined(trial, "/force")
    frame_t, markers = joined(trial, "/markers")
    newtons = volts[:, 0] * 50 * 9.80665 / 5
    along = (markers[:, 6, :3] - markers[:, 5, :3]).mean(axis=0)
    x = (markers[:, 4, :3] - markers[:, 0, :3]) @ (along / np.linalg.norm(along)) * 1e-3
    force = np.interp(frame_t, force_t - rise, newtons)
    unloading = frame_t > frame_t[-1] / 2 + 2
    assert np.polyfit(x[unloading], force[unloading], 1)[0] == pytest.approx(3100, rel=0.03)


def test_one_device_can_be_left_out_and_the_operator_waits_for_the_others_only() -> None:
    settings = settings_from_dict({**SHORT, "ports": {"ni": None, "serial": None}})
    with Bench(settings, SPEED) as bench:
        assert set(bench.ports) == {"qtm", "clock"}
        qtm = Qualisys(host="127.0.0.1", port=bench.ports["qtm"], host_clock=time.time_ns)
        qtm.open()
        items: list[Item] = []
        give_up = time.perf_counter() + scaled_timeout(PATIENCE_S)
        while not blocks(items, "/markers") and time.perf_counter() < give_up:
            items += qtm.read(0.1)
        qtm.close()
    assert blocks(items, "/markers")


def test_a_taken_port_stops_what_had_started() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        settings = settings_from_dict({"ports": {"ni": None, "qtm": 0, "serial": taken.getsockname()[1]}})
        bench = Bench(settings)
        with pytest.raises(OSError, match=r"in use|10048"), bench:
            pass
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", bench.ports["qtm"])).close()


class Child:
    """The bench in its process."""

    def __init__(self) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "drivers.simulators"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def ask(self, request: Any) -> dict[str, Any]:
        self.process.stdin.write((request if isinstance(request, str) else json.dumps(request)) + "\n")
        self.process.stdin.flush()
        answer: dict[str, Any] = json.loads(self.process.stdout.readline())
        return answer

    def end(self) -> int:
        """Closes its standard input; the exit code."""
        self.process.stdin.close()
        code = self.process.wait(scaled_timeout(PATIENCE_S))
        self.process.stdout.close()
        return code


@pytest.fixture
def child() -> Iterator[Child]:
    child = Child()
    yield child
    if child.process.poll() is None:
        child.process.kill()
        child.process.wait()


def test_the_process_answers_each_line_with_one_and_ends_with_its_input(child: Child) -> None:
    ready = child.ask({"seed": 1, "cuffs": {"hand": {"migration_m": 0.02}}, "ports": {"ni": None}})
    assert ready["truth"]["cuffs"]["hand"]["migration_m"] == 0.02
    assert ready["labels"][0] == "anchor_1"
    socket.create_connection(("127.0.0.1", ready["ports"]["qtm"])).close()
    trial = {"cuff": "hand", "test": "dynamic", "condition": None}
    assert child.ask({"trial": {"cuff": "hand", "test": "dynamic"}}) == {"trial": trial, "now": 0.0}
    assert child.ask({"don": "tube"})["trial"] == {"cuff": "tube", "test": "static", "condition": None}
    assert child.ask({"trial": {"cuff": "hand", "test": "dance"}})["code"] == SimulatorCode.UNKNOWN_TRIAL
    motion = {"cuff": None, "test": "motion", "condition": "tight"}
    assert child.ask({"trial": motion})["code"] == SimulatorCode.UNKNOWN_TRIAL, "the settings have no person"
    assert child.ask({"pause_s": 60}) == {"pause_s": 60, "now": 60.0}
    assert child.ask({"speed": 3}) == {"speed": 3.0, "now": 60.0}
    assert child.ask({"speed": None})["speed"] is None
    assert child.ask({"speed": 0})["code"] == SimulatorCode.WRONG_VALUE
    assert child.ask({"truth": True})["truth"]["slip_m"]["hand"] == 0.0
    assert child.ask({"capture": False}) == {"was_running": False, "now": 60.0}
    fault = child.ask({"fault": {"device": "qtm", "fault": "skip_frames", "for_s": 2}})["fault"]
    assert (fault["fault"], fault["for_s"]) == ("skip_frames", 2.0)
    assert child.ask({"fault": {"device": "qtm", "fault": "fire"}})["code"] == SimulatorCode.WRONG_FAULT
    assert child.ask({"don": "foot"})["code"] == SimulatorCode.UNKNOWN_TRIAL
    assert child.ask({"dance": 1})["code"] == SimulatorCode.WRONG_REQUEST
    assert child.ask("no json")["code"] == SimulatorCode.WRONG_REQUEST
    assert child.end() == 0


@contextmanager
def impatient(device: Any) -> Iterator[None]:
    """The open device waits for an answer for half a second within this context."""
    with pytest.MonkeyPatch.context() as patch:
        if isinstance(device, Qualisys):
            patch.setattr(device._connection._connection, "_timeout", 0.5)
        else:
            patch.setattr(device._opened, "deadline_s", 0.5)
        yield


@pytest.mark.slow
def test_a_stopped_process_is_detected_on_both_wires_and_reconnected(child: Child) -> None:
    ports = child.ask({"speed": 10, "mocap": {"has_preview": True}, "operator": {"capture": "remote"}})["ports"]
    ni = make_device("nidaq", **WIRING, grpc_target=f"127.0.0.1:{ports['ni']}", host_clock=time.time_ns)
    qtm = make_device("qualisys", host="127.0.0.1", port=ports["qtm"], host_clock=time.time_ns)
    stopped = psutil.Process(child.process.pid)
    for device, stream in ((ni, "/sync"), (qtm, "/markers")):
        device.open()
        read_until(device, lambda items, stream=stream: bool(blocks(items, stream)))  # type: ignore[misc]
        with impatient(device.device):  # type: ignore[attr-defined]
            stopped.suspend()
            items = read_until(device, lambda items: any(is_event(item, "connection_lost") for item in items))
        stopped.resume()
        items += read_until(device, lambda items, stream=stream: bool(blocks(items, stream)))  # type: ignore[misc]
        device.close()
        assert any(is_event(item, "connection_restored") for item in items)
        assert unaccounted(items, stream) == []
        # NI's task keeps its samples and is read on. QTM drops frames that no client takes; what follows agrees with no
        # capture of ours, as this world stood still and the host's clock went on.
        is_lost = any(isinstance(item, Loss) and item.cause == "disconnected" for item in items)
        assert is_lost or device is ni or any(is_event(item, "capture_replaced") for item in items)
    assert child.end() == 0


def test_settings_that_cannot_be_used_end_it_with_a_sentence(child: Child) -> None:
    refused = child.ask({"sped": 3})
    assert (refused["error"], refused["code"]) == ("simulated bench: unknown key sped", SimulatorCode.WRONG_SETTING)
    assert child.end() == 2


class Talker:
    def __init__(self, connection: socket.socket) -> None:
        self._lines = connection.makefile("rwb", buffering=0)

    def ask(self, request: Any) -> dict[str, Any]:
        line = request if isinstance(request, bytes) else json.dumps(request).encode()
        self._lines.write(line + b"\n")
        answer: dict[str, Any] = json.loads(self._lines.readline())
        return answer


@contextmanager
def talking(bench: Bench) -> Iterator[Talker]:
    with socket.create_connection(("127.0.0.1", bench.ports["clock"])) as connection:
        connection.settimeout(scaled_timeout(30.0))
        yield Talker(connection)


@pytest.fixture
def bench(simulated_bench: Callable[..., Bench]) -> Bench:
    return simulated_bench(operator={"capture": "remote"})


@pytest.fixture
def talker(bench: Bench) -> Iterator[Talker]:
    with talking(bench) as talker:
        yield talker


def test_an_attached_station_advances_the_world_and_receives_the_count_of_sent_bytes(
    bench: Bench, talker: Talker
) -> None:
    with socket.create_connection(("127.0.0.1", bench.ports["serial"])) as serial:
        serial.settimeout(scaled_timeout(30.0))
        port = serial.getsockname()[1]
        attached = talker.ask({"attach": "a test"})
        assert (attached["now"], attached["speed"]) == (0.0, None)
        answer = talker.ask({"advance_to": 1.0, "ports": [port]})
        assert answer["now"] == 1.0 and answer["pending"] == []
        sent = answer["sent"]["serial"][str(port)]
        received = b""
        while len(received) < sent:
            received += serial.recv(4096)
        assert received.count(b"\r\n") in (10, 11), "ten lines a second"
        assert len(received) == sent


def test_a_lost_connection_detaches_the_station_and_the_next_one_continues(bench: Bench) -> None:
    for name, now, goal in (("the first", 0.0, 0.5), ("the second", 0.5, 2.0)):
        with talking(bench) as talker:
            assert talker.ask({"attach": name})["now"] == now
            assert talker.ask({"advance_to": goal})["now"] == goal


def test_commands_take_effect_at_a_time_of_the_world_that_the_answer_tells(bench: Bench, talker: Talker) -> None:
    assert talker.ask({"pause_s": 2})["now"] == 2.0
    assert talker.ask({"fault": {"device": "qtm", "fault": "skip_frames", "at_s": 1.0}})["now"] == 2.0
    (planned,) = bench.world.faults.of("qtm", "skip_frames")
    assert planned.begin == 3.0
    pace = talker.ask({"pace": True})
    assert (pace["speed"], pace["now"]) == (None, 2.0) and pace["rate"] > 0


def test_nonsense_is_refused_in_a_sentence_and_the_connection_stays(talker: Talker) -> None:
    for request_line, code in (
        (b"[1, 2]", SimulatorCode.WRONG_REQUEST),
        (b"no json", SimulatorCode.WRONG_REQUEST),
        (b"[" * 100_000, SimulatorCode.WRONG_REQUEST),
        (b'{"advance_to": 1}', SimulatorCode.NOT_ATTACHED),
        (b'{"advance_to": Infinity}', SimulatorCode.WRONG_VALUE),
        (b'{"advance_to": true}', SimulatorCode.WRONG_VALUE),
        (b'{"pause_s": NaN}', SimulatorCode.WRONG_VALUE),
        (b'{"dance": 1}', SimulatorCode.WRONG_REQUEST),
        (b'{"speed": -1}', SimulatorCode.WRONG_VALUE),
        (b'{"attach": "x", "speed": "fast"}', SimulatorCode.WRONG_VALUE),
    ):
        assert talker.ask(request_line)["code"] == code, request_line[:40]
        assert talker.ask({"truth": True})["truth"]["slip_m"]


def test_a_station_attaches_once_names_its_ports_in_a_list_and_pauses_by_advancing(talker: Talker) -> None:
    talker.ask({"attach": "a test", "speed": 100.0})
    assert talker.ask({"attach": "again"})["code"] == SimulatorCode.ATTACHED
    assert talker.ask({"advance_to": 1, "ports": 5})["code"] == SimulatorCode.WRONG_VALUE
    assert talker.ask({"pause_s": 1})["code"] == SimulatorCode.ATTACHED
    assert talker.ask({"advance_to": 0.1})["now"] == 0.1


def test_a_device_with_a_pending_reply_is_named_until_the_world_advances(talker: Talker) -> None:
    talker.ask({"attach": "a test"})
    talker.ask({"fault": {"device": "ni", "fault": "freeze", "for_s": 0.4}})
    assert talker.ask({"advance_to": 0.0})["pending"] == ["ni"]
    assert talker.ask({"advance_to": 0.5})["pending"] == []


@pytest.fixture
def world() -> World:
    return World(Settings(), speed=None)


def put_at_the_pc(
    world: World, *streams: threading.Event, control: threading.Event | None = None, delay_s: float = 3.0
) -> None:
    taken = control or threading.Event()
    world.clock.follow(Operator(world, delay_s, [stream.is_set for stream in streams], taken.is_set))


def stream(is_on: bool = True) -> threading.Event:
    event = threading.Event()
    if is_on:
        event.set()
    return event


def test_a_capture_starts_some_seconds_after_all_devices_stream(world: World) -> None:
    mocap = stream(is_on=False)
    put_at_the_pc(world, stream(), mocap)
    world.clock.advance(10.0)
    mocap.set()
    world.clock.advance(10.0)
    assert 13.0 <= world.capture.start <= 14.0


@pytest.mark.parametrize("is_controlled", [False, True], ids=["one is silent", "a client is in control"])
def test_nothing_starts_beside_a_silent_device_or_a_client_in_control(world: World, is_controlled: bool) -> None:
    silent = () if is_controlled else (stream(is_on=False),)
    put_at_the_pc(world, stream(), *silent, control=stream() if is_controlled else None, delay_s=0.0)
    world.clock.advance(10.0)
    assert world.capture is None


def test_one_capture_for_each_time_that_streaming_begins(world: World) -> None:
    mocap = stream()
    put_at_the_pc(world, mocap, delay_s=0.0)
    world.clock.advance(2.0)
    world.stop_capture()
    world.clock.advance(10.0)
    assert world.capture.number == 1
    mocap.clear()
    world.clock.advance(10.0)
    mocap.set()
    world.clock.advance(2.0)
    assert world.capture is not None and world.capture.number == 2


def test_a_capture_that_still_runs_is_waited_for(world: World) -> None:
    world.start_capture()
    put_at_the_pc(world, stream(), delay_s=0.0)
    world.clock.advance(5.0)
    world.stop_capture()
    world.clock.advance(1.0)
    assert world.capture is not None and world.capture.number == 2
