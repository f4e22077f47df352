"""The actions of a view: buttons in the bar at the bottom of the page, and their keys."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Literal

from nicegui import ui

Action = Callable[[], Awaitable[None] | None]
Run = Callable[[Action], Awaitable[None]]
Kind = Literal["main", "other", "danger"]

PROPS = {"main": "unelevated color=primary", "other": "outline", "danger": "unelevated color=red-10"}


class Actions:
    """run() performs an action and shows its refusal; row is the bar of the buttons, in two groups.

    form is for input above the buttons; is_covered: a dialog is open and takes the keys.
    """

    def __init__(self, run: Run, row: ui.row, form: ui.column) -> None:
        self.run = run
        self.by_key: dict[str, Action] = {}
        self.form = form
        self.is_covered = False
        form.clear()
        row.clear()
        with row:
            self._main = ui.row().classes("main")
            self._apart = ui.row().classes("apart")

    def add(
        self, name: str, key: str, action: Action, *, kind: Kind = "other", mark: str = "", is_apart: bool = False
    ) -> ui.button:
        """Add a button and its key; is_apart: in the group at the other end of the bar, at every width."""
        self.by_key[key] = action
        with self._apart if is_apart else self._main:
            button = ui.button(f"{name} ({key})", on_click=lambda: self.run(action)).props(PROPS[kind])
        return button.mark(mark or name.lower().replace(" ", "-"))
