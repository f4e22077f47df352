"""Content of a form in the browser's tab, so that it survives a new view, a lost connection and a new console."""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

from nicegui import ui
from nicegui.elements.mixins.value_element import ValueElement

READ_TIMEOUT_S = 10.0


def keep_form(name: str, fields: Mapping[str, ValueElement[Any]]) -> None:
    """Fill the fields with what the tab has of this form, and keep every change of them from then on."""

    async def restore() -> None:
        with suppress(TimeoutError):
            kept = await ui.run_javascript(f"return station.keptForm({json.dumps(name)})", timeout=READ_TIMEOUT_S)
            for key, field in fields.items():
                if key in kept:
                    field.value = kept[key]
        for field in fields.values():
            field.on_value_change(keep)

    def keep() -> None:
        content = {key: field.value for key, field in fields.items()}
        ui.run_javascript(f"station.keepForm({json.dumps(name)}, {json.dumps(content)})")

    ui.timer(0.0, restore, once=True)


def forget_form(name: str) -> None:
    """The form was used: a later one of this name starts anew."""
    ui.run_javascript(f"station.keepForm({json.dumps(name)}, {{}})")
