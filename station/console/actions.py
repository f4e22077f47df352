"""The actions of a view: buttons in the bar at the bottom of the page, and their keys.

A key presses its button in the browser (keys.js), so that it acts only where the button is shown, and never in a field.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Awaitable, Callable
from html import escape
from typing import Literal

from nicegui import ui
from nicegui.events import GenericEventArguments

from station.messages.session_messages import CommandCode
from station.session.open_session import CommandRefused

Action = Callable[[], Awaitable[None] | None]
Run = Callable[[Action], Awaitable[None]]
Kind = Literal["main", "other", "danger"]

PROPS = {"main": "unelevated color=primary", "other": "outline", "danger": "unelevated color=red-10"}
LATE_S = 3.0
"""A press that arrives later was made while the console did not answer, and may no longer be wanted. Questions are
asked and answered at any time: a recording must be stopped however busy the computer is."""


class Actions:
    """run() performs an action and shows its refusal; row is the bar of the buttons, in two groups; form is for input
    above the buttons.
    """

    def __init__(self, run: Run, row: ui.row, form: ui.column) -> None:
        self.run = run
        self.form = form
        self._of_session: ui.row | None = None
        form.clear()
        row.clear()
        with row:
            self._main = ui.row().classes("main")
            self._apart = ui.row().classes("apart")

    def add(
        self,
        name: str,
        keys: str,
        action: Action,
        *,
        kind: Kind = "other",
        mark: str = "",
        is_apart: bool = False,
        is_of_session: bool = False,
        asks: bool = False,
    ) -> ui.button:
        """Add a button and its keys, the first of them shown; is_apart: at the other end of the bar; is_of_session:
        after those of the trial, in a group that stays together; asks: the action only asks for confirmation.
        """
        if is_of_session and self._of_session is None:
            with self._main:
                self._of_session = ui.row().classes("of-session")
        with (self._of_session if is_of_session else None) or (self._apart if is_apart else self._main):
            return self._button(name, keys, action, kind, mark, expires=not asks)

    def ask(self, question: str, yes: tuple[str, Action], no: str) -> None:
        """Ask for confirmation above the buttons: one key must not end what cannot be continued."""

        def decline() -> None:
            self.form.clear()

        def agree() -> Awaitable[None] | None:
            self.form.clear()
            return yes[1]()

        self.form.clear()
        with self.form, ui.row().classes("items-center gap-3").props("role=alertdialog").mark("question") as asked:
            asked.props(f'aria-label="{escape(question)}"')
            ui.label(question).classes("text-xl doubtful")
            self._button(yes[0], "y", agree, "danger", "yes", expires=False)
            self._button(no, "n", decline, "other", "no", expires=False)

    def _button(self, name: str, keys: str, action: Action, kind: Kind, mark: str, *, expires: bool) -> ui.button:
        async def press(event: GenericEventArguments) -> None:
            ui.run_javascript("station.confirmPress()")
            await self.run((lambda: _unless_late(name, event.args, action)) if expires else action)

        with ui.button().props(PROPS[kind]) as button:
            ui.html(f'{escape(name)} <span class="key">({keys[0]})</span>', sanitize=False)
        button.props(f'data-keys="{keys}" aria-keyshortcuts="{keys[0]}"')
        button.on("click", press, js_handler=f"() => emit(station.press({json.dumps(name)}))")
        return button.mark(mark or name.lower().replace(" ", "-"))


def _unless_late(name: str, pressed_ms: object, action: Action) -> Awaitable[None] | None:
    """Raises CommandRefused for a press that waited in a lost connection, or that has no time."""
    late_s = time.time() - pressed_ms / 1000 if isinstance(pressed_ms, float | int) else math.nan
    if not math.isfinite(late_s):
        raise CommandRefused.of(CommandCode.PRESS_UNDATED, name=name)
    if late_s > LATE_S:
        raise CommandRefused.of(CommandCode.PRESSED_LATE, name=name, late_s=late_s)
    return action()
