"""The live page alone, on this computer: for a replay, or beside a recording that the terminal runs."""

from __future__ import annotations

from contextlib import ExitStack
from functools import partial
from pathlib import Path

from nicegui import app, ui

from station.child import ProcessLink, exit_with_parent
from station.console.compression import CompressionMiddleware
from station.console.live_feed import LiveFeed
from station.console.live_page import show_live_page
from station.console.server import LIVE_POLL_S, AccessMiddleware, answer_beat, ensure_free, print_address

HOST = "127.0.0.1"


def main(parent: ProcessLink, folder: str, port: str) -> None:
    """Serve in a process of its own until Ctrl-C or the end of the parent."""
    exit_with_parent(parent)
    serve_live(Path(folder), port=int(port))


def serve_live(folder: Path, *, port: int = 8422, is_opened: bool = False) -> None:
    """Serve until Ctrl-C: the values of the live process that announces itself in the folder, now or later.

    Raises ServeError if it cannot listen.
    """
    ensure_free(HOST, port)
    feed = LiveFeed(lambda: folder)
    with ExitStack() as stack:
        stack.callback(feed.close)
        app.add_middleware(AccessMiddleware, token=None)
        app.add_api_route("/beat", answer_beat)
        app.on_startup(partial(print_address, f"http://{HOST}:{port}/", is_opened=is_opened))
        app.timer(LIVE_POLL_S, feed.poll)
        ui.run(
            lambda: show_live_page(feed),
            host=HOST,
            port=port,
            title="live muscles",
            dark=None,
            show=False,
            reload=False,
            show_welcome_message=False,
            gzip_middleware_factory=CompressionMiddleware,
        )
