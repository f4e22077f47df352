"""Access to the console: this machine without a token, others with it, no page of another site."""

from __future__ import annotations

import asyncio
import socket
from pathlib import Path
from typing import Any
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


def _request(
    token: str | None, kind: str = "http", query: str = "", path: str = "/", **headers: str
) -> tuple[bool, list[dict[str, Any]]]:
    """Whether the request has_passed through, and what was answered instead."""
    let_in: list[str] = []
    answers: list[dict[str, Any]] = []

    async def inner(scope: dict[str, Any], receive: Any, send: Any) -> None:
        let_in.append(scope["type"])

    async def receive() -> dict[str, Any]:
        return {"type": "http.request"}

    async def send(message: dict[str, Any]) -> None:
        answers.append(message)

    scope = {
        "type": kind,
        "method": "GET",
        "path": path,
        "query_string": query.encode(),
        "headers": [(name.encode(), value.encode("latin-1")) for name, value in headers.items()],
    }
    asyncio.run(AccessMiddleware(inner, token)(scope, receive, send))
    return bool(let_in), answers


@pytest.mark.parametrize("host", ["127.0.0.1:8421", "localhost:8421", "[::1]:8421"])
@pytest.mark.parametrize("kind", ["http", "websocket"])
def test_requests_of_this_machine_need_no_token(host: str, kind: str) -> None:
    assert _request(None, kind, host=host, origin=f"http://{host}") == (True, [])


@pytest.mark.parametrize("headers", [{"host": "rebound.example:8421"}, {"host": "192.168.1.7:8421"}, {}])
def test_another_host_name_for_this_machine_is_rejected(headers: dict[str, str]) -> None:
    """A page elsewhere may let its own name lead to 127.0.0.1; the browser then sends that name as the host."""
    has_passed, answers = _request(None, **headers)
    assert not has_passed
    assert answers[0]["status"] == 403


@pytest.mark.parametrize("token", [None, TOKEN])
@pytest.mark.parametrize("origin", ["http://elsewhere.example", "null", "http://127.0.0.1:80"])
def test_a_page_of_another_site_is_rejected_even_with_the_cookie(token: str | None, origin: str) -> None:
    headers = {"host": "127.0.0.1:8421", "origin": origin, "cookie": f"{COOKIE}={TOKEN}"}
    has_passed, answers = _request(token, **headers)
    assert not has_passed
    assert answers[0]["status"] == 403
    assert _request(token, "websocket", **headers) == (False, [{"type": "websocket.close", "code": 1008}])


@pytest.mark.parametrize("cookie", ["", f"{COOKIE}=wrong", f"{COOKIE}=", f"other={TOKEN}"])
@pytest.mark.parametrize("kind", ["http", "websocket"])
def test_requests_of_other_machines_need_the_token(cookie: str, kind: str) -> None:
    has_passed, answers = _request(TOKEN, kind, host="lab.example:8421", cookie=cookie)
    assert not has_passed
    assert answers[0].get("status", answers[0].get("code")) in (403, 1008)


def test_the_token_in_the_address_becomes_a_cookie_without_script_access() -> None:
    has_passed, answers = _request(TOKEN, query=f"token={TOKEN}", host="lab.example:8421")
    headers = {name.decode(): value.decode() for name, value in answers[0]["headers"]}
    assert not has_passed
    assert (answers[0]["status"], headers["location"]) == (307, "/")
    assert headers["set-cookie"].startswith(f"{COOKIE}={TOKEN};")
    assert "HttpOnly" in headers["set-cookie"]
    assert "SameSite=strict" in headers["set-cookie"]


@pytest.mark.parametrize("query", ["token=wrong", "token=", "tok=en", "token=%C3%BC"])
def test_a_wrong_token_in_the_address_is_rejected(query: str) -> None:
    has_passed, answers = _request(TOKEN, query=query, host="lab.example:8421")
    assert not has_passed
    assert answers[0]["status"] == 403


@pytest.mark.parametrize("kind", ["http", "websocket"])
def test_a_request_with_the_cookie_is_accepted(kind: str) -> None:
    assert _request(TOKEN, kind, host="lab.example:8421", cookie=f"{COOKIE}={TOKEN}") == (True, [])


@pytest.mark.parametrize("token", [None, TOKEN])
@pytest.mark.parametrize("site", ["cross-site", "same-site"])
@pytest.mark.parametrize("kind", ["http", "websocket"])
def test_a_page_of_another_site_without_an_origin_is_rejected(token: str | None, site: str, kind: str) -> None:
    """An image, a script or a link there is a GET without Origin; localhost with another port is the same site."""
    headers = {"host": "localhost:8421", "sec-fetch-site": site, "cookie": f"{COOKIE}={TOKEN}"}
    has_passed, answers = _request(token, kind, f"token={TOKEN}", **headers)
    assert not has_passed
    assert answers[0].get("status", answers[0].get("code")) in (403, 1008)


@pytest.mark.parametrize("site", ["same-origin", "none"])
def test_the_console_s_page_and_a_typed_address_are_accepted(site: str) -> None:
    assert _request(None, host="localhost:8421", **{"sec-fetch-site": site})[0]


@pytest.mark.parametrize(
    "path", ["//elsewhere.example", "//elsewhere.example/report", "/\\elsewhere.example", "///e.example"]
)
def test_the_redirect_after_the_token_stays_on_this_host(path: str) -> None:
    _, answers = _request(TOKEN, query=f"token={TOKEN}", path=path, host="lab.example:8421")
    location = dict(answers[0]["headers"])[b"location"].decode()
    assert urljoin("http://lab.example:8421/", location).startswith("http://lab.example:8421/")
    assert location[:2] not in ("//", "/\\")


@pytest.mark.parametrize("headers", [{"host": "localhost:8421"}, {"host": "elsewhere.example"}])
def test_no_page_shows_the_console_in_a_frame(headers: dict[str, str]) -> None:
    async def page(_: dict[str, Any], __: Any, send: Any) -> None:
        await send({"type": "http.response.start", "status": 200, "headers": [(b"content-type", b"text/html")]})

    answers: list[dict[str, Any]] = []

    async def send(message: dict[str, Any]) -> None:
        answers.append(message)

    scope = {
        "type": "http",
        "path": "/",
        "query_string": b"",
        "headers": [(k.encode(), v.encode()) for k, v in headers.items()],
    }
    asyncio.run(AccessMiddleware(page, None)(scope, None, send))
    sent = dict(answers[0]["headers"])
    assert sent[b"content-security-policy"] == b"frame-ancestors 'none'"
    assert sent[b"x-frame-options"] == b"DENY"
    assert b"content-type" in sent


def test_a_websocket_needs_the_cookie() -> None:
    assert not _request(TOKEN, "websocket", query=f"token={TOKEN}", host="lab.example:8421")[0]


def test_the_lifespan_of_the_server_is_passed_on() -> None:
    assert _request(TOKEN, "lifespan")[0]


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
    waiting, sent = list(received), list[Message]()

    async def receive() -> Message:
        if not waiting:
            await asyncio.Event().wait()
        return {"type": waiting.pop(0)}

    async def send(message: Message) -> None:
        sent.append(message)

    asyncio.run(RedirectWithPrefixMiddleware(CompressionMiddleware(app))(SCOPE, receive, send))
    return sent


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
