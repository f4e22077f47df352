"""`station serve`: the console's page on this machine, the live page alone, and access to them."""

from __future__ import annotations

import asyncio
import errno
import hmac
import logging
import secrets
import signal
import socket
import sys
import time
import webbrowser
from contextlib import ExitStack
from functools import partial
from http import HTTPStatus
from http.cookies import SimpleCookie
from pathlib import Path
from typing import Any, NoReturn
from urllib.parse import parse_qs

from nicegui import app, ui
from nicegui.server import Server
from starlette.middleware.gzip import GZipMiddleware
from starlette.responses import FileResponse, PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Receive, Scope, Send
from starlette.types import Message as AsgiMessage

from documents.message import Figures, Message, because
from station.bench.session_folder import SIMULATED_FOLDER
from station.bench.simulation import SimulatedBench, clock_port, practice_settings
from station.child import ProcessLink, exit_with_parent
from station.config import StationConfig
from station.console.live_feed import LiveFeed
from station.console.live_view import PATH as LIVE_PATH
from station.console.live_view import show_live_page
from station.console.page import show_page
from station.end_signals import end_signals
from station.errors import StationError
from station.messages.session_messages import ServeCode
from station.session.controller import SessionController

LOOPBACK = ("127.0.0.1", "localhost", "::1")
COOKIE = "station_token"
HEARTBEAT_S = 1.0
LISTENING_POLL_S = 0.01
LIVE_POLL_S = 0.04
SHUTDOWN_TIMEOUT_S = 3
"""Wall seconds at the end for browsers to receive answers: one that is suspended never does."""
CONSOLE_ID = secrets.token_hex(8)
"""A page reloads when its console was restarted."""

OWN_SITE = ("same-origin", "none")
"""Values of Sec-Fetch-Site for requests of our own page and for a typed address; older browsers send none."""
NO_FRAMES = ((b"content-security-policy", b"frame-ancestors 'none'"), (b"x-frame-options", b"DENY"))


class ServeError(StationError):
    """The console cannot listen at its address."""


class AccessMiddleware:
    """Accepts requests with the token, if there is one, and rejects requests from pages of other sites.

    A browser sends the site of the requesting page in Origin and, also for a GET, in Sec-Fetch-Site; another site could
    otherwise control the console through the browser of its visitor. No other page may show ours in a frame.
    """

    def __init__(self, inner: ASGIApp, token: str | None) -> None:
        self._inner, self._token = inner, token

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._inner(scope, receive, send)
            return
        headers = {name.decode().lower(): value.decode("latin-1") for name, value in scope["headers"]}
        origin, host = headers.get("origin"), headers.get("host", "")
        send = _without_frames(send)
        is_foreign = origin is not None and origin.split("://", 1)[-1] != host
        if is_foreign or headers.get("sec-fetch-site", "none") not in OWN_SITE:
            await self._reject(scope, receive, send, "this page accepts requests from its own address only")
        elif self._token is None:
            if host.rsplit(":", 1)[0].strip("[]") in LOOPBACK:
                await self._inner(scope, receive, send)
            else:
                await self._reject(scope, receive, send, "this console answers on this machine only")
        elif (cookie := SimpleCookie(headers.get("cookie", "")).get(COOKIE)) and self._is_right(cookie.value):
            await self._inner(scope, receive, send)
        elif scope["type"] == "http" and self._is_right(parse_qs(scope["query_string"].decode()).get("token", [""])[0]):
            answer = RedirectResponse("/" + scope["path"].lstrip("/\\"))  # //name would lead to another host
            answer.set_cookie(COOKIE, self._token or "", httponly=True, samesite="strict")
            await answer(scope, receive, send)
        else:
            await self._reject(
                scope, receive, send, "open the complete address that `station serve` printed, including the token"
            )

    def _is_right(self, shown: str) -> bool:
        return self._token is not None and hmac.compare_digest(shown.encode(), self._token.encode())

    async def _reject(self, scope: Scope, receive: Receive, send: Send, text: str) -> None:
        if scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})
        else:
            await PlainTextResponse(text, 403)(scope, receive, send)


def _without_frames(send: Send) -> Send:
    async def send_with_policy(message: AsgiMessage) -> None:
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
    """Serve until Ctrl-C, Ctrl-Break or SIGTERM, or until the terminal is closed.

    is_simulated: with simulated devices of its own, whose world runs at the pace `speed` (default 1). Without it, speed
    is the pace of a simulated bench in another process, at the configured addresses; None means real devices.

    Raises ServeError, before any device is opened, if it cannot listen.
    """
    ensure_free(host, port)
    token = None if host in LOOPBACK else secrets.token_urlsafe(16)
    address = f"http://{f'[{host}]' if ':' in host else host}:{port}/" + (f"?token={token}" if token else "")
    signal.signal(signal.SIGTERM, _end)  # the web server shuts down, and then raises the signal again
    for number in set(end_signals()) - {signal.SIGINT, signal.SIGTERM}:
        if signal.getsignal(number) is not signal.SIG_IGN:  # nohup
            signal.signal(number, lambda *_: signal.raise_signal(signal.SIGTERM))
    with ExitStack() as stack:
        bench = None
        if is_simulated:
            bench = stack.enter_context(SimulatedBench(practice_settings(config), speed or 1.0, seed, outlives=True))
            config = _practice_config(bench.configure(config))
        port_of_clock = None if is_simulated or speed is None else clock_port(config)
        controller = SessionController(config, speed or 1.0, bench, port_of_clock)
        stack.callback(controller.close)
        logging.getLogger("uvicorn.error").addFilter(_is_no_cancellation)
        app.add_middleware(AccessMiddleware, token=token)
        app.add_api_route("/beat", answer_beat)
        app.add_api_route("/report", lambda: _report(controller.session.folder))
        app.on_startup(partial(print_address, address, is_opened=is_opened))
        app.on_startup(controller.prepare)
        app.timer(HEARTBEAT_S, controller.process_recordings)
        feed = LiveFeed(lambda: controller.session.folder)
        stack.callback(feed.close)
        app.timer(LIVE_POLL_S, feed.poll)
        ui.page(LIVE_PATH, title="live muscles")(lambda: show_live_page(feed))
        app.config.quasar_config["loadingBar"]["skipHijack"] = True  # else it runs with every beat
        ui.run(
            lambda: show_page(controller),
            host=host,
            port=port,
            title="station",
            favicon="⚖️",
            dark=None,
            show=False,
            reload=False,
            show_welcome_message=False,
            tailwind=False,
            language="en-US",
            gzip_middleware_factory=CompressionMiddleware,
            timeout_graceful_shutdown=SHUTDOWN_TIMEOUT_S,
        )


def ensure_free(host: str, port: int) -> None:
    """Raise ServeError for a host that is no address of this computer, and for a port that is in use."""
    try:
        family, *_, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family) as listener:
            if sys.platform != "win32":  # there, it would share the port with its user
                listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listener.bind(address)
    except OSError as error:
        figures: Figures = {"host": host, "port": port, **because(error)}
        is_of_host = isinstance(error, socket.gaierror) or error.errno == errno.EADDRNOTAVAIL
        raise ServeError(Message(ServeCode.WRONG_HOST if is_of_host else ServeCode.CANNOT_LISTEN, figures)) from error


def _end(*_: object) -> NoReturn:
    sys.exit(0)


def _is_no_cancellation(record: logging.LogRecord) -> bool:
    """Whether to log the record: at the end, the server logs a traceback for every cancelled answer."""
    return not (record.exc_info and isinstance(record.exc_info[1], asyncio.CancelledError))


def _practice_config(config: StationConfig) -> StationConfig:
    """The station starts and stops the simulated captures; sessions go to the folder for simulated data."""
    mocap = config.mocap.model_copy(update={"control": "start"})
    session = config.session.model_copy(update={"folder": config.session.folder / SIMULATED_FOLDER})
    return config.model_copy(update={"mocap": mocap, "session": session})


async def answer_beat() -> dict[str, Any]:
    """Heartbeat: the clock of the console, from which a page computes the age of its data, and its identity."""
    return {"now": time.time(), "console": CONSOLE_ID}


def _report(folder: Path | None) -> Response:
    """The report, the only file of the session that the page links to."""
    if folder is None or not (folder / "report.html").is_file():
        return PlainTextResponse("the session has no report yet", 404)
    return FileResponse(folder / "report.html", media_type="text/html")


async def print_address(address: str, *, is_opened: bool) -> None:
    """Print the address once the server listens: the startup handlers run before it does."""
    while not Server.instance.started:
        await asyncio.sleep(LISTENING_POLL_S)
    print(address, flush=True)
    if is_opened:
        webbrowser.open(address)


class CompressionMiddleware(GZipMiddleware):
    """GZipMiddleware that ends every request of a disconnected browser with an empty response.

    Starlette's FileResponse ends without one when the browser disconnects, as on every reload of a page. NiceGUI's
    middlewares, which are outside this one, take that for an error, and a traceback appears in the operator's terminal.
    A response that is missing although the browser waits for it remains an error.
    """

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        is_disconnected = is_answered = False

        async def receive_and_note() -> AsgiMessage:
            nonlocal is_disconnected
            message = await receive()
            is_disconnected |= message["type"] == "http.disconnect"
            return message

        async def send_and_note(message: AsgiMessage) -> None:
            nonlocal is_answered
            await send(message)  # FileResponse may cancel it
            is_answered = True

        await super().__call__(scope, receive_and_note, send_and_note)
        if is_disconnected and not is_answered:
            await Response(status_code=HTTPStatus.NO_CONTENT)(scope, receive, send)


def main(parent: ProcessLink, folder: str, port: str) -> None:
    """Serve the live page alone in a process of its own, until Ctrl-C or the end of the parent."""
    exit_with_parent(parent)
    serve_live(Path(folder), int(port))


def serve_live(folder: Path, port: int) -> None:
    """Serve the live page alone until Ctrl-C, for a replay or beside a recording that the terminal runs.

    The values are those of the live process that announces itself in the folder, now or later.

    Raises ServeError if it cannot listen.
    """
    ensure_free(LOOPBACK[0], port)
    feed = LiveFeed(lambda: folder)
    with ExitStack() as stack:
        stack.callback(feed.close)
        app.add_middleware(AccessMiddleware, token=None)
        app.add_api_route("/beat", answer_beat)
        app.on_startup(partial(print_address, f"http://{LOOPBACK[0]}:{port}/", is_opened=False))
        app.timer(LIVE_POLL_S, feed.poll)
        ui.run(
            lambda: show_live_page(feed),
            host=LOOPBACK[0],
            port=port,
            title="live muscles",
            dark=None,
            show=False,
            reload=False,
            show_welcome_message=False,
            tailwind=False,
            gzip_middleware_factory=CompressionMiddleware,
        )
