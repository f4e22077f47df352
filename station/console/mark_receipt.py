"""Confirmation of a mark: its time, whether the recorder has stored it, and its name."""

from __future__ import annotations

from nicegui import ui

from station.console.actions import Actions
from station.session.controller import SessionController
from station.session.live_trial import LiveTrial


class MarkReceipt:
    """One line under the curves, with a field to name this page's last mark. Enter stores the name, Escape leaves the
    field. The browser clears the field and moves the focus to it (freshness.js): after a round trip to the console,
    keys typed in between would act as commands, and the beginning of the name would be lost.
    """

    def __init__(self, controller: SessionController, live: LiveTrial, actions: Actions) -> None:
        self._controller, self._live, self._run = controller, live, actions.run
        self._number = 0
        with ui.element("div").classes("receipt"):
            self._text = ui.label("no mark yet").classes("quiet").mark("receipt")
            self._note = ui.input(placeholder="name, then Enter").props("dense outlined")
            self._note.classes("grow note").mark("note")
            self._note.on("keydown.enter", self._store_name)

    async def mark(self) -> None:
        """Mark this moment. An alarm or another page may add marks before this one is named."""
        self._number = 0
        self._number = await self._controller.runner.mark()

    async def _store_name(self) -> None:
        name = str(self._note.value or "")
        await self._run(lambda: self._controller.runner.name_mark(self._number, name))
        self._note.value = ""
        self._note.run_method("blur")

    def tick(self) -> None:
        marks = self._live.marks
        if not marks:
            return
        number = max(marks)
        is_recorded = self._live.latest.get("marks", 0) >= number
        name = self._live.mark_names.get(number, "")
        stored = "in the recording" if is_recorded else "sent to the recorder"
        self._text.text = f"mark {number} at {marks[number]:.1f} s is {stored}" + (f": {name}" if name else "")
