"""A browser that leaves before its answer, behind NiceGUI's middlewares; the messages are those of uvicorn."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from nicegui.middlewares import RedirectWithPrefixMiddleware
from starlette.responses import FileResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from station.console.compression import CompressionMiddleware

SCOPE: Scope = {"type": "http", "method": "GET", "path": "/", "headers": [(b"accept-encoding", b"gzip")]}


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
