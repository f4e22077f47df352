"""Updates reach any number of views; a view that does not read loses updates, and holds up nothing."""

import json
import math
import os
import socket
import sys
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import replace
from pathlib import Path
from queue import Queue
from typing import Any

import pytest

from station.live.published import (
    NAN,
    UPDATE,
    LiveDelivery,
    LiveScenario,
    LiveScenarioValues,
    LiveSetup,
    LiveSubject,
    LiveUpdate,
    LiveValues,
    update_line,
)
from station.live.subscription import (
    ADDRESS_FILE,
    MOST_STRANGERS,
    VIEW_BACKLOG,
    LiveAddress,
    LiveServer,
    LiveSubscription,
    LiveUnreachable,
    announce,
    find_address,
    serve_views,
    withdraw,
)
from station.messages.live_messages import LiveCode
from tests.refusals import raises_refusal
from tests.timeout import scaled_timeout

SETUP = LiveSetup(
    trial="cuff-hand",
    subject=LiveSubject("generic", is_scaled=False),
    coordinates=("elevation",),
    muscles=("deltoid",),
    markers=("ac",),
    scenarios=(LiveScenario("slack", "slack", NAN), LiveScenario("worn", "worn", 0.7, "hand")),
    lag_s=0.15,
    frame_rate_hz=100.0,
)
ALL = 1e9  # updates per second that a view gets


def update(frame: int) -> LiveUpdate:
    solved = LiveScenarioValues("solved", NAN, 0.0, (0.25,), 12.5, (1.0, 2.0, NAN))
    values = LiveValues(frame / 100, frame, "solved", (0.1,), (0.0,), (0.0,), (solved,))
    return LiveUpdate(values, LiveDelivery(1000.0, 0.152, 0.002, frame, 0, 1, 100.0))


def ignore(_: dict[str, Any]) -> None: ...


def connected(server: LiveServer) -> socket.socket:
    return socket.create_connection(("127.0.0.1", server.address.port), scaled_timeout(5.0))


def test_connections_without_the_token_get_nothing_and_keep_no_view_out() -> None:
    with LiveServer(SETUP, ignore) as server, ExitStack() as stack:
        strangers = [stack.enter_context(connected(server)) for _ in range(3 * MOST_STRANGERS)]
        assert strangers[0].recv(1) == b"", "the oldest is closed"
        with LiveSubscription(server.address) as view:
            assert view.setup == SETUP
        with raises_refusal(LiveCode.UNREACHABLE, kind=LiveUnreachable):
            LiveSubscription(LiveAddress(server.address.port, "guessed"))


def test_a_connection_that_sends_nothing_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("station.live.subscription.TOKEN_TIMEOUT_S", 0.05)
    with LiveServer(SETUP, ignore) as server, connected(server) as stranger:
        assert stranger.recv(1) == b""


@pytest.mark.parametrize(
    "request_line", [b"[1]", b"null", b"{}", b'{"token": [1]}', b'"', b"\xff", b"9" * 5000, b"1e999"]
)
def test_a_wrong_request_is_closed_and_a_wrong_command_ignored(request_line: bytes) -> None:
    """pytest fails for a thread that ends by an exception."""
    commands: Queue[dict[str, Any]] = Queue()
    with LiveServer(SETUP, commands.put) as server:
        with connected(server) as stranger:
            stranger.sendall(request_line + b"\n")
            with suppress(ConnectionResetError):
                assert stranger.recv(1) == b""
        with connected(server) as view:
            token = json.dumps({"token": server.address.token}).encode()
            view.sendall(token + b"\n[1]\nnull\n" + json.dumps({"rest": 1}).encode() + b"\n" + request_line + b"\n")
            assert commands.get(timeout=scaled_timeout(5.0)) == {"rest": 1}


@pytest.mark.parametrize(
    "content", [*(f'{{"port": {port}, "token": "a"}}' for port in ("Infinity", "0", "1e5")), "[]", "null", "{", ""]
)
def test_a_wrong_address_is_reported(tmp_path: Path, content: str, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / ADDRESS_FILE).write_text(content)
    assert find_address(tmp_path) is None
    assert str(tmp_path / ADDRESS_FILE) in capsys.readouterr().err


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
def test_a_pipe_in_place_of_the_address_is_ignored(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / ADDRESS_FILE)
    assert find_address(tmp_path) is None


@pytest.mark.parametrize("make", [Path.mkdir, pytest.param(lambda path: path.parent.rmdir(), id="no folder")])
def test_an_address_that_cannot_be_written_does_not_end_the_live_process(
    tmp_path: Path, make: Callable[[Path], None], capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "session"
    folder.mkdir()
    make(folder / ADDRESS_FILE)
    with ExitStack() as stack:
        serve_views(stack, SETUP, folder, ignore)(update(1))
    assert str(folder / ADDRESS_FILE) in capsys.readouterr().err


def frames_until(view: LiveSubscription, last: int) -> list[LiveUpdate]:
    """All updates up to that of the frame `last`, or to the end."""
    found: list[LiveUpdate] = []
    while not (found and found[-1].values is not None and found[-1].values.frame == last):
        is_over = view.wait_until_over(0.005)
        new = view.take()
        found += new
        if is_over and not new:
            break
    return found


def wait_for(claim: Callable[[], bool], view: LiveSubscription) -> None:
    for _ in range(round(scaled_timeout(10) / 0.005)):
        if claim():
            return
        view.wait_until_over(0.005)
    raise AssertionError("not within the time-out")


def test_an_update_is_the_same_after_the_wire() -> None:
    sent = replace(update(7), scenarios=SETUP.scenarios)
    empty = LiveUpdate(None, LiveDelivery(1.0, NAN, NAN, 0, 0, 1, NAN))
    for one in (empty, sent):
        back = UPDATE.validate_json(update_line(one))
        assert update_line(back) == update_line(one)
    assert back.values is not None and math.isnan(back.values.scenarios[0].effort)
    assert back.values.scenarios[0].activations == (0.25,)


def test_two_views_see_the_same_updates_until_one_is_closed() -> None:
    with (
        LiveServer(SETUP, ignore, ALL) as server,
        LiveSubscription(server.address) as one,
        LiveSubscription(server.address) as other,
    ):
        wait_for(lambda: server.views == 2, one)
        for frame in range(20):
            server.publish(update(frame))
        seen = [[found.values.frame for found in frames_until(view, 19) if found.values] for view in (one, other)]
        assert one.setup.scenarios[1] == other.setup.scenarios[1] == SETUP.scenarios[1]
        other.close()
        wait_for(lambda: server.views == 1, one)
        server.publish(update(20))
        assert [found.values.frame for found in frames_until(one, 20) if found.values] == [20]
    assert seen == [list(range(20)), list(range(20))]


def test_a_view_that_does_not_read_loses_the_oldest_updates_and_they_are_counted() -> None:
    """The reference is the sequence of frames itself: shown + not shown = published."""
    count = 20 * VIEW_BACKLOG
    big = replace(SETUP, muscles=tuple(f"muscle {k}" for k in range(2000)))
    with LiveServer(big, ignore, ALL) as server, socket.create_connection(("127.0.0.1", server.address.port)) as frozen:
        frozen.sendall(json.dumps({"token": server.address.token}).encode() + b"\n")
        lines = frozen.makefile("rb")
        lines.readline()
        wide = LiveScenarioValues("solved", 1.0, 0.0, (0.25,) * 2000, 12.5, ())
        for frame in range(count):
            one = update(frame)
            assert one.values is not None
            server.publish(replace(one, values=replace(one.values, scenarios=(wide,))))
        received: list[LiveUpdate] = []
        while not received or received[-1].values is None or received[-1].values.frame < count - 1:
            received.append(UPDATE.validate_json(lines.readline()))
    frames = [found.values.frame for found in received if found.values]
    assert frames == sorted(frames) and len(frames) < count
    assert received[-1].delivery.not_shown + len(frames) == count


def test_a_command_reaches_the_process_and_a_slow_reader_counts_what_it_drops() -> None:
    commands: Queue[dict[str, Any]] = Queue()
    with LiveServer(SETUP, commands.put) as server, LiveSubscription(server.address) as view:
        view.set_rest_length("worn", 0.71)
        assert commands.get(timeout=scaled_timeout(10)) == {"scenario": "worn", "rest_length_m": 0.71}
    with LiveServer(SETUP, ignore, ALL) as server:
        view = LiveSubscription(server.address, backlog=5)
        wait_for(lambda: server.views == 1, view)
        for frame in range(30):
            server.publish(update(frame))
    assert view.wait_until_over(scaled_timeout(10))
    shown = view.take()
    assert [found.values.frame for found in shown if found.values] == [25, 26, 27, 28, 29]
    assert shown[-1].delivery.not_shown == 25
    view.close()


@pytest.mark.parametrize("last", [(), (replace(update(11), values=None),)], ids=["values", "no values"])
def test_views_get_the_updates_that_they_draw_and_the_newest_values_at_the_end(last: tuple[LiveUpdate, ...]) -> None:
    """An update that only says how values are delivered does not take the place of values."""
    with LiveServer(SETUP, ignore, rate_hz=1e-3) as server, LiveSubscription(server.address) as view:
        wait_for(lambda: server.views == 1, view)
        for one in (replace(update(0), values=None), *map(update, range(1, 11)), *last):
            server.publish(one)
        server.__exit__()
        assert view.wait_until_over(scaled_timeout(10))
        assert [found.values and found.values.frame for found in view.take()] == [None, 10]


def test_the_address_is_for_its_owner_alone_and_goes_with_its_process(tmp_path: Path) -> None:
    mine, later = LiveAddress(4711, "mine"), LiveAddress(4712, "later")
    announce(tmp_path, mine)
    assert find_address(tmp_path) == mine
    assert sys.platform == "win32" or (tmp_path / ADDRESS_FILE).stat().st_mode & 0o077 == 0, "docs/security.md"
    announce(tmp_path, later)
    withdraw(tmp_path, mine)
    assert find_address(tmp_path) == later
    withdraw(tmp_path, later)
    assert find_address(tmp_path) is None
