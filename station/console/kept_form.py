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
    """Fill the fields with what the tab has of this form, and keep every change of them.

    What is entered before the tab has answered stands.
    """

    def content() -> dict[str, Any]:
        return {key: field.value for key, field in fields.items()}

    def keep() -> None:
        ui.run_javascript(f"station.keepForm({json.dumps(name)}, {json.dumps(content())})")

    async def restore() -> None:
        with suppress(TimeoutError):
            kept = await ui.run_javascript(f"return station.keptForm({json.dumps(name)})", timeout=READ_TIMEOUT_S)
            entered = {key for key, field in fields.items() if field.value != built[key]}
            for key, field in fields.items():
                if key in kept and key not in entered:
                    field.value = kept[key]
        for field in fields.values():
            field.on_value_change(keep)
        if content() != built:
            keep()

    built = content()

    ui.timer(0.0, restore, once=True)


def forget_form(name: str) -> None:
    """The form was used: a later one of this name starts anew."""
    ui.run_javascript(f"station.keepForm({json.dumps(name)}, {{}})")
