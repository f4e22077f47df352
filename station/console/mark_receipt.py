"""The receipt of a mark: when it was set, that it is in the recording, and what it was."""

from __future__ import annotations

from nicegui import ui

from station.console.actions import Actions
from station.session.desk import Desk
from station.session.live import Live


class MarkReceipt:
    """One line under the curves, with a field for a note on the last mark. Enter keeps the note, Escape leaves it."""

    def __init__(self, desk: Desk, live: Live, actions: Actions) -> None:
        self._desk, self._live, self._run = desk, live, actions.run
        with ui.element("div").classes("receipt"):
            self._words = ui.label("no mark yet").classes("quiet").mark("receipt")
            self._note = ui.input(placeholder="what was it? Enter keeps it").props("dense outlined")
            self._note.classes("grow note").mark("note").disable()
            self._note.on("keydown.enter", self._keep)

    async def mark(self) -> None:
        """Marks this moment and takes a note on it at once."""
        await self._desk.runner.mark()
        self._note.value = ""
        self._note.run_method("focus")

    async def _keep(self) -> None:
        number, name = len(self._live.marks), str(self._note.value or "")
        await self._run(lambda: self._desk.runner.note(number, name))
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
        self._words.text = f"mark {number} at {marks[number]:.1f} s is {stored}" + (f": {name}" if name else "")
