"""The clock's port, asked as any station would in any language: lines of JSON over TCP."""

from __future__ import annotations

import json
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from drivers.simulators.bench import Bench
from drivers.simulators.errors import SimulatorCode
from tests.timeout import scaled_timeout

QUIET = {"operator": {"capture": "remote"}}


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


def test_an_attached_station_advances_the_world_and_receives_the_count_of_sent_bytes(
    simulated_bench: Callable[..., Bench],
) -> None:
    bench = simulated_bench(**QUIET)
    with talking(bench) as talker, socket.create_connection(("127.0.0.1", bench.ports["serial"])) as serial:
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


def test_a_lost_connection_detaches_the_station_and_the_next_one_continues(
    simulated_bench: Callable[..., Bench],
) -> None:
    bench = simulated_bench(**QUIET)
    with talking(bench) as talker:
        talker.ask({"attach": "the first"})
        talker.ask({"advance_to": 0.5})
    with talking(bench) as talker:
        assert talker.ask({"attach": "the second"})["now"] == 0.5
        assert talker.ask({"advance_to": 2.0})["now"] == 2.0


def test_commands_take_effect_at_a_time_of_the_world_that_the_answer_tells(
    simulated_bench: Callable[..., Bench],
) -> None:
    bench = simulated_bench(**QUIET)
    with talking(bench) as talker:
        assert talker.ask({"pause_s": 2})["now"] == 2.0
        fault = talker.ask({"fault": {"device": "qtm", "fault": "skip_frames", "at_s": 1.0}})
        assert fault["now"] == 2.0
        (planned,) = bench.world.faults.of("qtm", "skip_frames")
        assert planned.begin == 3.0
        pace = talker.ask({"pace": True})
        assert (pace["speed"], pace["now"]) == (None, 2.0) and pace["rate"] > 0


@pytest.mark.parametrize(
    ("request_line", "code"),
    [
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
    ],
)
def test_nonsense_is_refused_in_a_sentence_and_the_connection_stays(
    simulated_bench: Callable[..., Bench], request_line: bytes, code: SimulatorCode
) -> None:
    with talking(simulated_bench(**QUIET)) as talker:
        assert talker.ask(request_line)["code"] == code
        assert talker.ask({"truth": True})["truth"]["slip_m"]


def test_an_attached_station_names_its_ports_in_a_list_and_pauses_by_advancing(
    simulated_bench: Callable[..., Bench],
) -> None:
    with talking(simulated_bench(**QUIET)) as talker:
        talker.ask({"attach": "a test", "speed": 100.0})
        assert talker.ask({"advance_to": 1, "ports": 5})["code"] == SimulatorCode.WRONG_VALUE
        assert talker.ask({"pause_s": 1})["code"] == SimulatorCode.ATTACHED
        assert talker.ask({"advance_to": 0.1})["now"] == 0.1


def test_a_station_attaches_once_on_a_connection(simulated_bench: Callable[..., Bench]) -> None:
    with talking(simulated_bench(**QUIET)) as talker:
        talker.ask({"attach": "a test"})
        assert talker.ask({"attach": "again"})["code"] == SimulatorCode.ATTACHED


def test_a_device_with_a_pending_reply_is_named_until_the_world_advances(simulated_bench: Callable[..., Bench]) -> None:
    bench = simulated_bench(**QUIET)
    with talking(bench) as talker:
        talker.ask({"attach": "a test"})
        talker.ask({"fault": {"device": "ni", "fault": "freeze", "for_s": 0.4}})
        assert talker.ask({"advance_to": 0.0})["pending"] == ["ni"]
        assert talker.ask({"advance_to": 0.5})["pending"] == []
