"""Who may see the console: from this machine anyone, from elsewhere whoever shows the token, no other site's page."""

from __future__ import annotations

import asyncio
import socket
from typing import Any
from urllib.parse import urljoin

import pytest

from station.config import parse_config
from station.console.server import COOKIE, AccessMiddleware, ServeError, serve

TOKEN = "right-token"  # noqa: S105  (nobody's)


def _asked(
    token: str | None, kind: str = "http", query: str = "", path: str = "/", **headers: str
) -> tuple[bool, list[dict[str, Any]]]:
    """Whether the request came through, and what was answered instead."""
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
def test_on_this_machine_nobody_is_asked(host: str, kind: str) -> None:
    assert _asked(None, kind, host=host, origin=f"http://{host}") == (True, [])


@pytest.mark.parametrize("headers", [{"host": "rebound.example:8421"}, {"host": "192.168.1.7:8421"}, {}])
def test_a_name_that_only_leads_here_is_turned_away(headers: dict[str, str]) -> None:
    """A page elsewhere may let its own name lead to 127.0.0.1; the browser then sends that name as the host."""
    came, answers = _asked(None, **headers)
    assert not came
    assert answers[0]["status"] == 403


@pytest.mark.parametrize("token", [None, TOKEN])
@pytest.mark.parametrize("origin", ["http://elsewhere.example", "null", "http://127.0.0.1:80"])
def test_a_page_of_another_site_steers_nothing_even_with_the_cookie(token: str | None, origin: str) -> None:
    headers = {"host": "127.0.0.1:8421", "origin": origin, "cookie": f"{COOKIE}={TOKEN}"}
    came, answers = _asked(token, **headers)
    assert not came
    assert answers[0]["status"] == 403
    assert _asked(token, "websocket", **headers) == (False, [{"type": "websocket.close", "code": 1008}])


@pytest.mark.parametrize("cookie", ["", f"{COOKIE}=wrong", f"{COOKIE}=", f"other={TOKEN}"])
@pytest.mark.parametrize("kind", ["http", "websocket"])
def test_beyond_this_machine_nobody_comes_in_without_the_token(cookie: str, kind: str) -> None:
    came, answers = _asked(TOKEN, kind, host="lab.example:8421", cookie=cookie)
    assert not came
    assert answers[0].get("status", answers[0].get("code")) in (403, 1008)


def test_the_token_in_the_address_becomes_a_cookie_that_no_script_reads_and_leaves_the_address() -> None:
    came, answers = _asked(TOKEN, query=f"token={TOKEN}", host="lab.example:8421")
    headers = {name.decode(): value.decode() for name, value in answers[0]["headers"]}
    assert not came
    assert (answers[0]["status"], headers["location"]) == (307, "/")
    assert headers["set-cookie"].startswith(f"{COOKIE}={TOKEN};")
    assert "HttpOnly" in headers["set-cookie"]
    assert "SameSite=strict" in headers["set-cookie"]


@pytest.mark.parametrize("query", ["token=wrong", "token=", "tok=en", "token=%C3%BC"])
def test_a_wrong_token_in_the_address_is_turned_away(query: str) -> None:
    came, answers = _asked(TOKEN, query=query, host="lab.example:8421")
    assert not came
    assert answers[0]["status"] == 403


@pytest.mark.parametrize("kind", ["http", "websocket"])
def test_the_cookie_lets_in(kind: str) -> None:
    assert _asked(TOKEN, kind, host="lab.example:8421", cookie=f"{COOKIE}={TOKEN}") == (True, [])


@pytest.mark.parametrize("token", [None, TOKEN])
@pytest.mark.parametrize("site", ["cross-site", "same-site"])
@pytest.mark.parametrize("kind", ["http", "websocket"])
def test_a_page_of_another_site_gets_nothing_without_naming_its_origin(token: str | None, site: str, kind: str) -> None:
    """An image, a script or a link there is a GET without Origin; localhost with another port is the same site."""
    headers = {"host": "localhost:8421", "sec-fetch-site": site, "cookie": f"{COOKIE}={TOKEN}"}
    came, answers = _asked(token, kind, f"token={TOKEN}", **headers)
    assert not came
    assert answers[0].get("status", answers[0].get("code")) in (403, 1008)


@pytest.mark.parametrize("site", ["same-origin", "none"])
def test_our_own_page_and_a_typed_address_get_in(site: str) -> None:
    assert _asked(None, host="localhost:8421", **{"sec-fetch-site": site})[0]


@pytest.mark.parametrize(
    "path", ["//elsewhere.example", "//elsewhere.example/report", "/\\elsewhere.example", "///e.example"]
)
def test_the_right_token_leads_to_no_other_host(path: str) -> None:
    _, answers = _asked(TOKEN, query=f"token={TOKEN}", path=path, host="lab.example:8421")
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


def test_a_websocket_gets_in_by_the_cookie_alone() -> None:
    assert not _asked(TOKEN, "websocket", query=f"token={TOKEN}", host="lab.example:8421")[0]


def test_the_server_s_own_start_passes() -> None:
    assert _asked(TOKEN, "lifespan")[0]


def test_a_port_in_use_is_one_sentence_before_anything_is_opened() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken, pytest.raises(ServeError, match=r"in use; end what listens"):
        serve(parse_config({}, "this test"), port=taken.getsockname()[1])


def test_a_host_that_nobody_knows_is_one_sentence() -> None:
    with pytest.raises(ServeError, match=r"cannot listen at no\.such\.host\.invalid, port 8421"):
        serve(parse_config({}, "this test"), host="no.such.host.invalid")
