"""The link between a parent and its child, whatever becomes of one of them; the same on Linux and Windows."""

import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Thread
from typing import Any

import psutil
import pytest

from station.child import Child
from station.end_signals import end_signals
from tests.station.child_process import press
from tests.station.children import start
from tests.timeout import scaled_timeout

ECHO = ("tests.station.children", "echo")
PATIENCE_S = 60.0


@contextmanager
def running(behaviour: str, *arguments: str, **options: Any) -> Iterator[Child]:
    child = start(behaviour, *arguments, **options)
    try:
        yield child
    finally:
        child.ensure_ended()
        if child.process.stderr is not None:
            child.process.stderr.close()


def answer(child: Child, message: dict[str, Any]) -> dict[str, Any] | None:
    child.send(message)
    return child.receive()


def test_messages_of_any_length_and_thread_arrive_whole_both_ways_and_the_child_ends_with_the_link() -> None:
    with running("echo") as child:
        assert answer(child, {"cuff": "Hüftgurt", "n": 1.5}) == {"cuff": "Hüftgurt", "n": 1.5}
        for length in (0, 1, 2**20):
            child.send_bytes(bytes(length))
            assert child.receive_bytes() == bytes(length)
        blocks = [bytes([number]) * 100_000 for number in range(6)]
        senders = [Thread(target=child.send_bytes, args=(block,)) for block in blocks]
        for sender in senders:
            sender.start()
        assert {child.receive_bytes() for _ in blocks} == set(blocks)
        for sender in senders:
            sender.join()
        child.close()
        assert child.process.wait(scaled_timeout(PATIENCE_S)) == 4


def test_files_of_the_user_replace_no_package_in_a_child(tmp_path: Path) -> None:
    for name in ("station", "tests", "json"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit(9)", encoding="utf-8")
    with running("echo", cwd=tmp_path) as child:
        assert answer(child, {"n": 1.5}) == {"n": 1.5}


def test_a_child_that_ends_before_it_receives_is_noticed() -> None:
    with running("crash") as child:
        assert child.receive() is None
        assert child.ensure_ended(scaled_timeout(PATIENCE_S)) == 3


def test_a_program_that_cannot_be_started_leaves_nothing_open(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", "no-such-program")
    before = open_handles()
    with pytest.raises(FileNotFoundError):
        start("echo")
    assert open_handles() == before


def open_handles() -> int:
    return psutil.Process().num_handles() if sys.platform == "win32" else psutil.Process().num_fds()


def test_a_killed_child_is_noticed_at_once_although_a_later_one_lives() -> None:
    with running("freeze") as first, running("freeze") as second:
        assert first.receive() == second.receive() == {"is_frozen": True}
        first.process.kill()
        assert first.receive() is None
        with pytest.raises((BrokenPipeError, ConnectionResetError)):
            first.send({})
        assert second.process.poll() is None


def test_a_frozen_child_is_killed_at_the_end_and_releases_a_sender() -> None:
    with running("freeze") as child:
        outcomes: list[bool] = []

        def send() -> None:
            try:
                child.send_bytes(bytes(2**24))  # more than any pipe takes
            except OSError:
                outcomes.append(True)

        sender = Thread(target=send)
        sender.start()
        child.receive()
        child.process.kill()
        sender.join()
    assert outcomes == [True]


def test_the_child_of_a_killed_parent_ends_at_once() -> None:
    """stderr is that of both, so it ends with the second of them."""
    with running("relay", *ECHO, stderr=subprocess.PIPE) as parent:
        assert answer(parent, {"n": 1}) == {"n": 1}
        parent.process.kill()
        assert parent.process.stderr is not None
        assert parent.process.stderr.read() == b""


def test_a_simulated_bench_ends_with_a_killed_parent_also_within_an_endless_pause() -> None:
    with running("relay", "station.bench.simulator_process", stderr=subprocess.PIPE) as parent:
        ready = answer(parent, {"ports": {"ni": None, "serial": None}})
        assert ready is not None and ready["ports"]["qtm"]
        parent.send({"pause_s": 1e9})
        parent.process.kill()
        assert parent.process.stderr is not None
        assert parent.process.stderr.read() == b""


def test_a_suspended_parent_is_not_taken_for_a_dead_one() -> None:
    with running("relay", *ECHO) as parent:
        assert answer(parent, {"n": 1}) == {"n": 1}
        suspended = psutil.Process(parent.process.pid)
        (child,) = suspended.children()
        suspended.suspend()
        with pytest.raises(psutil.TimeoutExpired):
            child.wait(0.2)
        suspended.resume()
        assert answer(parent, {"n": 2}) == {"n": 2}
        assert suspended.children() == [child]


def test_a_suspended_child_is_waited_for_and_keys_that_end_the_parent_do_not_end_it() -> None:
    with running("echo") as child:
        process = psutil.Process(child.process.pid)
        assert answer(child, {"n": 1}) == {"n": 1}
        process.suspend()
        child.send({"n": 2})
        process.resume()
        assert child.receive() == {"n": 2}
        for key in set(end_signals()) - {signal.SIGTERM}:
            press(key, child.process.pid)
        assert answer(child, {"n": 3}) == {"n": 3}


def test_a_library_loads_while_a_message_is_waited_for_and_standard_input_is_empty() -> None:
    with running("load_library") as child:
        assert child.receive() == {"norm": 5.0, "stdin": ""}
        assert child.ensure_ended(scaled_timeout(PATIENCE_S)) == 5


@pytest.mark.parametrize("arguments", [[], ["99"], ["-1", "tests.station.children"], ["nonsense"]])
def test_a_child_started_by_hand_is_refused(arguments: list[str]) -> None:
    command = [sys.executable, "-m", "station.child", *arguments]
    ran = subprocess.run(command, check=False, capture_output=True, text=True)  # noqa: S603
    assert ran.returncode == 1 and ran.stderr.count("\n") == 1
