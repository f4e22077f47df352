"""`station serve`: the console's page on this machine, and who may see it."""

from __future__ import annotations

import hmac
import os
import secrets
import signal
import socket
import sys
import time
import webbrowser
from collections.abc import Awaitable, Callable
from contextlib import ExitStack
from http.cookies import SimpleCookie
from pathlib import Path
from typing import Any, NoReturn
from urllib.parse import parse_qs

from nicegui import app, ui
from starlette.responses import FileResponse, PlainTextResponse, RedirectResponse, Response

from station.bench.session_folder import SIMULATED_FOLDER
from station.bench.simulation import SimulatedBench, clock_port, practice_settings
from station.config import StationConfig, parse_config
from station.console.page import show_page
from station.errors import StationError
from station.session.desk import Desk

LOOPBACK = ("127.0.0.1", "localhost", "::1")
COOKIE = "station_token"
HEARTBEAT_S = 1.0
CONSOLE_ID = secrets.token_hex(8)
"""A page whose console was started again loads anew."""

OWN_SITE = ("same-origin", "none")
"""What a browser calls a request by our own page, and one that its user typed; older browsers say nothing."""
NO_FRAMES = ((b"content-security-policy", b"frame-ancestors 'none'"), (b"x-frame-options", b"DENY"))

Scope = dict[str, Any]
AsgiApp = Callable[[Scope, Any, Any], Awaitable[None]]


class ServeError(StationError):
    """The console cannot listen where it should; one sentence."""


class AccessMiddleware:
    """Lets in whoever shows the token, where there is one, and no page of another site in any case.

    A browser names the site a request comes from in Origin and, also for a GET, in Sec-Fetch-Site; one that is not ours
    is a page elsewhere that tries to steer the console through its reader's browser. No page may show ours in a frame.
    """

    def __init__(self, inner: AsgiApp, token: str | None) -> None:
        self._inner, self._token = inner, token

    async def __call__(self, scope: Scope, receive: Any, send: Any) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._inner(scope, receive, send)
            return
        headers = {name.decode().lower(): value.decode("latin-1") for name, value in scope["headers"]}
        origin, host = headers.get("origin"), headers.get("host", "")
        send = _without_frames(send)
        is_foreign = origin is not None and origin.split("://", 1)[-1] != host
        if is_foreign or headers.get("sec-fetch-site", "none") not in OWN_SITE:
            await self._turn_away(scope, receive, send, "this page is steered from its own address only")
        elif self._token is None:
            if host.rsplit(":", 1)[0].strip("[]") in LOOPBACK:
                await self._inner(scope, receive, send)
            else:
                await self._turn_away(scope, receive, send, "this console answers on this machine only")
        elif self._is_shown_in(SimpleCookie(headers.get("cookie", "")).get(COOKIE)):
            await self._inner(scope, receive, send)
        elif scope["type"] == "http" and self._is_right(parse_qs(scope["query_string"].decode()).get("token", [""])[0]):
            answer = RedirectResponse("/" + scope["path"].lstrip("/\\"))  # //name would lead to another host
            answer.set_cookie(COOKIE, self._token or "", httponly=True, samesite="strict")
            await answer(scope, receive, send)
        else:
            await self._turn_away(scope, receive, send, "open the address that `station serve` printed, token and all")

    def _is_shown_in(self, cookie: Any) -> bool:
        return cookie is not None and self._is_right(cookie.value)

    def _is_right(self, shown: str) -> bool:
        return self._token is not None and hmac.compare_digest(shown.encode(), self._token.encode())

    async def _turn_away(self, scope: Scope, receive: Any, send: Any, words: str) -> None:
        if scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})
        else:
            await PlainTextResponse(words, 403)(scope, receive, send)


def _without_frames(send: Any) -> Any:
    async def send_with_policy(message: dict[str, Any]) -> None:
        if message["type"] == "http.response.start":
            message = {**message, "headers": [*message.get("headers", ()), *NO_FRAMES]}
        await send(message)

    return send_with_policy


def serve(
    config: StationConfig,
    *,
    host: str = "127.0.0.1",
    port: int = 8421,
    is_opened: bool = False,
    is_simulated: bool = False,
    speed: float | None = None,
    seed: int = 1,
) -> None:
    """Serves until Ctrl-C or a kill.

    is_simulated: on simulated devices of its own, whose world keeps the pace `speed` (default 1). Without it a speed is
    the pace for a simulated bench that runs elsewhere, at the configuration's addresses; None means real devices.

    Raises ServeError, before any device is opened, where it cannot listen.
    """
    _ensure_free(host, port)
    token = None if host in LOOPBACK else secrets.token_urlsafe(16)
    address = f"http://{f'[{host}]' if ':' in host else host}:{port}/" + (f"?token={token}" if token else "")
    signal.signal(signal.SIGTERM, _end)  # the web server ends politely, and then has the signal take its own course
    with ExitStack() as stack:
        bench = None
        if is_simulated:
            bench = stack.enter_context(SimulatedBench(practice_settings(config), speed or 1.0, seed))
            config = _for_practice(bench.pointed_at(config))
        followed = None if is_simulated or speed is None else clock_port(config)
        desk = Desk(config, speed or 1.0, bench, followed)
        stack.callback(desk.close)
        app.add_middleware(AccessMiddleware, token=token)
        app.add_api_route("/beat", _beat)
        app.add_api_route("/report", lambda: _report(desk.session.folder))
        app.on_startup(lambda: _announce(address, is_opened=is_opened))
        app.on_startup(desk.reviewer.warm_up)
        app.timer(HEARTBEAT_S, desk.reviewer.look_after)
        ui.run(
            lambda: show_page(desk),
            host=host,
            port=port,
            title="station",
            favicon="⚖️",
            dark=None,
            show=False,
            reload=False,
            show_welcome_message=False,
        )


def _ensure_free(host: str, port: int) -> None:
    try:
        family, *_, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        socket.create_server(address, family=family).close()
    except OSError as error:
        why = error.strerror if isinstance(error, socket.gaierror) else os.strerror(error.errno or 0)
        raise ServeError(
            f"the console cannot listen at {host}, port {port}: {why}; end what listens there, or give "
            "another --host or --port"
        ) from error


def _end(*_: object) -> NoReturn:
    sys.exit(0)


def _for_practice(config: StationConfig) -> StationConfig:
    """The station starts and stops the captures, as nobody is at a simulated mocap PC; sessions go to their folder."""
    data = config.model_dump(mode="json")
    data["mocap"]["control"] = "start"
    data["session"]["folder"] = str(config.session.folder / SIMULATED_FOLDER)
    return parse_config(data, "the simulated bench")


async def _beat() -> dict[str, Any]:
    """That the console is alive: its clock, by which a page tells how old its data is, and which console it is."""
    return {"now": time.time(), "console": CONSOLE_ID}


def _report(folder: Path | None) -> Response:
    """The one file of the session that the page links to."""
    if folder is None or not (folder / "report.html").is_file():
        return PlainTextResponse("there is no report of this session yet", 404)
    return FileResponse(folder / "report.html", media_type="text/html")


def _announce(address: str, *, is_opened: bool) -> None:
    print(address, flush=True)
    if is_opened:
        webbrowser.open(address)
