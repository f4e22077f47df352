"""Access to the console: this machine without a token, others with it, no page of another site."""

import asyncio
import socket
from pathlib import Path
from typing import Any
from unittest.mock import AsyncMock
from urllib.parse import urljoin

import psutil
import pytest
from nicegui.middlewares import RedirectWithPrefixMiddleware
from starlette.responses import FileResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from station.config import parse_config
from station.console.server import COOKIE, LOOPBACK, AccessMiddleware, CompressionMiddleware, ServeError, serve
from station.messages.session_messages import ServeCode
from tests.refusals import raises_refusal
from tests.station.child_process import STOP, press
from tests.station.console.served import ServedConsole, write_config
from tests.timeout import scaled_timeout

TOKEN = "right-token"  # noqa: S105  (of the tests)
SCOPE: Scope = {"type": "http", "method": "GET", "path": "/", "headers": [(b"accept-encoding", b"gzip")]}


HERE, ELSEWHERE = {"host": "localhost:8421"}, {"host": "lab.example:8421"}
WITH_COOKIE = {"cookie": f"{COOKIE}={TOKEN}"}
Headers = dict[str, str]
ACCEPTED: list[tuple[str | None, Headers]] = [
    *(
        (None, {"host": host, "origin": f"http://{host}"})
        for host in ("127.0.0.1:8421", "localhost:8421", "[::1]:8421")
    ),
    *((None, {**HERE, "sec-fetch-site": site}) for site in ("same-origin", "none")),
    (TOKEN, ELSEWHERE | WITH_COOKIE),
]
"""Token of the console, and headers."""
REJECTED: list[tuple[str | None, str, Headers]] = [
    # A page elsewhere may let its own name lead to 127.0.0.1; the browser then sends that name as the host.
    *((None, "", headers) for headers in ({"host": "rebound.example:8421"}, {"host": "192.168.1.7:8421"}, {})),
    *(
        (token, "", {**HERE, "origin": origin} | WITH_COOKIE)
        for token in (None, TOKEN)
        for origin in ("http://elsewhere.example", "null", "http://localhost:80")
    ),
    # An image, a script or a link there is a GET without Origin; localhost with another port is the same site.
    *(
        (token, f"token={TOKEN}", {**HERE, "sec-fetch-site": site} | WITH_COOKIE)
        for token in (None, TOKEN)
        for site in ("cross-site", "same-site")
    ),
    *((TOKEN, "", {**ELSEWHERE, "cookie": cookie}) for cookie in ("", f"{COOKIE}=wrong", f"{COOKIE}=", f"a={TOKEN}")),
    *((TOKEN, query, ELSEWHERE) for query in ("token=wrong", "token=", "tok=en", "token=%C3%BC")),
]
"""Token of the console, query and headers."""


def _case_id(value: str | Headers | None) -> str:
    if isinstance(value, dict):
        return " ".join(f"{name}={text}" for name, text in value.items()) or "no headers"
    return value or "none"


def _request(
    token: str | None, kind: str, headers: Headers, query: str = "", path: str = "/"
) -> tuple[bool, dict[str, Any]]:
    """Whether the request has reached the page, and the start of the answer."""
    reached: list[str] = []

    async def page(scope: Scope, _receive: Receive, send: Send) -> None:
        reached.append(scope["type"])
        await send({"type": "http.response.start", "status": 200, "headers": [(b"content-type", b"text/html")]})

    scope = {
        "type": kind,
        "method": "GET",
        "path": path,
        "query_string": query.encode(),
        "headers": [(name.encode(), value.encode("latin-1")) for name, value in headers.items()],
    }
    receive, send = AsyncMock(return_value={"type": "http.request"}), AsyncMock()
    asyncio.run(AccessMiddleware(page, token)(scope, receive, send))
    return bool(reached), send.await_args_list[0].args[0]


def _headers(answer: dict[str, Any]) -> Headers:
    return {name.decode(): value.decode() for name, value in answer["headers"]}


def _assert_in_no_frame(answer: dict[str, Any]) -> None:
    headers = _headers(answer)
    assert headers["content-security-policy"] == "frame-ancestors 'none'"
    assert headers["x-frame-options"] == "DENY" and "content-type" in headers


@pytest.mark.parametrize("kind", ["http", "websocket"])
@pytest.mark.parametrize(("token", "headers"), ACCEPTED, ids=_case_id)
def test_requests_of_this_machine_and_those_with_the_cookie_are_accepted(
    token: str | None, headers: Headers, kind: str
) -> None:
    is_accepted, answer = _request(token, kind, headers)
    assert is_accepted and answer["status"] == 200
    _assert_in_no_frame(answer)


@pytest.mark.parametrize("kind", ["http", "websocket"])
@pytest.mark.parametrize(("token", "query", "headers"), REJECTED, ids=_case_id)
def test_requests_of_other_sites_and_those_without_the_token_are_rejected(
    token: str | None, query: str, headers: Headers, kind: str
) -> None:
    is_accepted, answer = _request(token, kind, headers, query)
    assert not is_accepted
    if kind == "websocket":
        assert answer == {"type": "websocket.close", "code": 1008}
        return
    assert answer["status"] == 403
    _assert_in_no_frame(answer)


def test_a_websocket_needs_the_cookie_and_the_lifespan_of_the_server_is_passed_on() -> None:
    closed = {"type": "websocket.close", "code": 1008}
    assert _request(TOKEN, "websocket", ELSEWHERE, f"token={TOKEN}") == (False, closed)
    assert _request(TOKEN, "lifespan", {})[0]


@pytest.mark.parametrize("path", ["/", "//e.example", "//e.example/report", "/\\e.example", "///e.example"])
def test_the_token_in_the_address_becomes_a_cookie_without_script_access_on_this_host(path: str) -> None:
    is_accepted, answer = _request(TOKEN, "http", ELSEWHERE, f"token={TOKEN}", path)
    headers = _headers(answer)
    location = headers["location"]
    assert not is_accepted and answer["status"] == 307
    assert urljoin("http://lab.example:8421/", location).startswith("http://lab.example:8421/")
    assert location[:2] not in ("//", "/\\") and (path != "/" or location == "/")
    assert headers["set-cookie"].startswith(f"{COOKIE}={TOKEN};")
    assert "HttpOnly" in headers["set-cookie"] and "SameSite=strict" in headers["set-cookie"]


def test_a_port_in_use_is_refused_before_a_device_is_opened() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken, raises_refusal(ServeCode.CANNOT_LISTEN, kind=ServeError):
        serve(parse_config({}, "this test"), port=taken.getsockname()[1])


@pytest.mark.parametrize("host", ["no.such.host.invalid", "192.0.2.1"])
def test_a_host_that_is_unknown_or_not_this_computer_is_refused(host: str) -> None:
    with raises_refusal(ServeCode.WRONG_HOST, kind=ServeError):
        serve(parse_config({}, "this test"), host=host)


# A browser that leaves before its answer, behind NiceGUI's middlewares; the messages are those of uvicorn.


def request(app: ASGIApp, *received: str) -> list[Message]:
    """What the app sends when it receives messages of these types, and nothing more."""
    waiting, send = list(received), AsyncMock()

    async def receive() -> Message:
        if not waiting:
            await asyncio.Event().wait()
        return {"type": waiting.pop(0)}

    asyncio.run(RedirectWithPrefixMiddleware(CompressionMiddleware(app))(SCOPE, receive, send))
    return [sent.args[0] for sent in send.await_args_list]


@pytest.fixture
def file(tmp_path: Path) -> FileResponse:
    path = tmp_path / "script.js"
    path.write_bytes(b"let x = 1; " * 500)
    return FileResponse(path)


def test_a_file_reaches_a_waiting_browser_compressed(file: FileResponse) -> None:
    start, body, *_ = request(file, "http.request")
    assert start["status"] == 200 and (b"content-encoding", b"gzip") in start["headers"]
    assert body["body"].startswith(b"\x1f\x8b")


def test_a_browser_that_left_before_the_file_was_sent_is_no_error(file: FileResponse) -> None:
    start, *_ = request(file, "http.request", "http.disconnect")
    assert start["status"] == 204


def test_a_response_that_is_missing_while_the_browser_waits_is_an_error() -> None:
    async def without_response(_scope: Scope, receive: Receive, _send: Send) -> None:
        await receive()

    with pytest.raises(RuntimeError, match="No response"):
        request(without_response, "http.request")


@pytest.mark.slow  # it starts a console, and waits for its time-out
def test_a_browser_that_is_suspended_within_a_request_does_not_keep_the_console(tmp_path: Path) -> None:
    head = (
        f"POST /_nicegui_ws/socket.io/?EIO=4&transport=polling HTTP/1.1\r\nHost: {LOOPBACK[0]}\r\nContent-Length: 9\r\n"
    )
    with (
        ServedConsole(write_config(tmp_path)) as console,
        socket.create_connection((LOOPBACK[0], console.port)) as browser,
    ):
        browser.sendall(f"{head}Expect: 100-continue\r\n\r\n".encode())
        assert b" 100 " in browser.recv(100), "the console waits for the body"
        process = psutil.Process(console.pid)
        press(STOP, console.pid)
        assert process.wait(scaled_timeout(30.0)) == 0
