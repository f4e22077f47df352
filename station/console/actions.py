"""What an operator can do now: the buttons in the bar at the bottom of the page, each with its key."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Literal

from nicegui import ui

Act = Callable[[], Awaitable[None] | None]
Run = Callable[[Act], Awaitable[None]]
Kind = Literal["main", "other", "danger"]

PROPS = {"main": "unelevated color=primary", "other": "outline", "danger": "unelevated color=red-10"}


class Actions:
    """Of one view. run() performs an act and shows its refusal; row is the bar that the buttons stand in.

    form is what has to be filled in for them, above them; is_covered: a dialog takes the keys.
    """

    def __init__(self, run: Run, row: ui.row, form: ui.column) -> None:
        self.run = run
        self.by_key: dict[str, Act] = {}
        self.form = form
        self.is_covered = False
        self._row = row
        form.clear()
        row.clear()
        with row:
            ui.element("div").classes("spacer")

    def add(
        self, name: str, key: str, act: Act, *, kind: Kind = "other", mark: str = "", is_apart: bool = False
    ) -> ui.button:
        """A button and its key; is_apart: at the other end of the bar."""
        self.by_key[key] = act
        with self._row:
            button = ui.button(f"{name} ({key})", on_click=lambda: self.run(act)).props(PROPS[kind])
        return button.classes("apart" if is_apart else "").mark(mark or name.lower().replace(" ", "-"))
