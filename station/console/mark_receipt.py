"""Confirmation of a mark: its time, whether the recorder has stored it, and its name."""

from __future__ import annotations

from nicegui import ui

from station.console.actions import Actions
from station.session.controller import SessionController
from station.session.live_trial import LiveTrial


class MarkReceipt:
    """One line under the curves, with a field to name the last mark. Enter stores the name, Escape leaves the field."""

    def __init__(self, controller: SessionController, live: LiveTrial, actions: Actions) -> None:
        self._controller, self._live, self._run = controller, live, actions.run
        with ui.element("div").classes("receipt"):
            self._text = ui.label("no mark yet").classes("quiet").mark("receipt")
            self._note = ui.input(placeholder="name, then Enter").props("dense outlined")
            self._note.classes("grow note").mark("note").disable()
            self._note.on("keydown.enter", self._store_name)

    async def mark(self) -> None:
        """Mark this moment and move the focus to the name."""
        await self._controller.runner.mark()
        self._note.value = ""
        self._note.run_method("focus")

    async def _store_name(self) -> None:
        number, name = len(self._live.marks), str(self._note.value or "")
        await self._run(lambda: self._controller.runner.name_mark(number, name))
        self._note.value = ""
        self._note.run_method("blur")

    def tick(self) -> None:
        marks = self._live.marks
        self._note.set_enabled(self._live.takes_marks)
        if not marks:
            return
        number = max(marks)
        is_recorded = self._live.latest.get("marks", 0) >= number
        name = self._live.mark_names.get(number, "")
        stored = "in the recording" if is_recorded else "sent to the recorder"
        self._text.text = f"mark {number} at {marks[number]:.1f} s is {stored}" + (f": {name}" if name else "")
