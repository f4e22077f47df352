"""Compressed responses of the console, without a traceback for every browser that leaves before its answer."""

from __future__ import annotations

from http import HTTPStatus

from starlette.middleware.gzip import GZipMiddleware
from starlette.responses import Response
from starlette.types import Message, Receive, Scope, Send


class CompressionMiddleware(GZipMiddleware):
    """GZipMiddleware that ends every request of a disconnected browser with an empty response.

    Starlette's FileResponse ends without one when the browser disconnects, as on every reload of a page. NiceGUI's
    middlewares, which are outside this one, take that for an error, and a traceback appears in the operator's terminal.
    A response that is missing although the browser waits for it remains an error.
    """

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        is_disconnected = is_answered = False

        async def receive_and_note() -> Message:
            nonlocal is_disconnected
            message = await receive()
            is_disconnected |= message["type"] == "http.disconnect"
            return message

        async def send_and_note(message: Message) -> None:
            nonlocal is_answered
            await send(message)  # FileResponse may cancel it
            is_answered = True

        await super().__call__(scope, receive_and_note, send_and_note)
        if is_disconnected and not is_answered:
            await Response(status_code=HTTPStatus.NO_CONTENT)(scope, receive, send)
