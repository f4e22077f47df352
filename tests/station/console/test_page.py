"""The page after an action: it shows the new state also if the button that was pressed is gone."""

from __future__ import annotations

import asyncio
import gc
from typing import Any

from nicegui import Client, ui
from nicegui.page import page

from station.console.page import _Page


def test_a_view_that_is_replaced_during_an_action_does_not_stop_the_page(monkeypatch) -> None:
    scripts: list[Client] = []
    client = Client(page("/"), request=None)
    shown: Any = _Page.__new__(_Page)  # without its elements: they need a session
    shown._client = client
    monkeypatch.setattr(shown, "_refuse", lambda _: None)
    monkeypatch.setattr(shown, "_tick", lambda: scripts.append(ui.context.client))

    async def press() -> None:
        with client, ui.row() as view:
            pass
        inside = view.default_slot

        async def act() -> None:
            nonlocal view
            view.delete()
            del view
            gc.collect()

        with inside:
            await shown.run(act)

    asyncio.run(press())
    assert scripts == [client]
