"""Flow control towards a browser: it is never far behind, however slowly it draws."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from contextlib import suppress

from nicegui import background_tasks

UNDRAWN_UPDATES = 2
"""Updates sent to a browser and not drawn yet; more are sent only when one is drawn."""


class UpdateSender:
    """Sends the newest data to one browser.

    draw sends an update and returns when the browser has drawn it; TimeoutError: it has not, frozen or closed.
    """

    def __init__(self, draw: Callable[[], Awaitable[object]]) -> None:
        self._draw = draw
        self._undrawn = 0
        self._sent_at: float | None = None

    def tick(self, at: float | None) -> None:
        """Send the data of time `at` unless they are sent already or the browser is behind; None without data."""
        if at is not None and at != self._sent_at and self._undrawn < UNDRAWN_UPDATES:
            self._sent_at = at
            self._undrawn += 1
            background_tasks.create(self._send())

    async def _send(self) -> None:
        try:
            with suppress(TimeoutError):  # the page itself shows the age of its data
                await self._draw()
        finally:
            self._undrawn -= 1
