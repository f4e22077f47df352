"""A decision that its operator thinks better of, while no other recording waits."""

from __future__ import annotations

from station.session.agenda import redo_loses_migration
from station.session.desk import Desk
from station.session.open_session import CommandRefused
from station.terminal.commands import Action, Command
from station.terminal.events import Decided

WHY = "say in a few words what was wrong with it, like: {} the wearer coughed"
NO_CUFF = "a bounce has no cuff to don anew; redo it"


class SecondThoughts:
    """undone are the files of decisions that were taken back: the station does not decide on them by itself again."""

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        self.undone: set[str] = set()
        self._warned: set[str] = set()  # files of which was said what their redo costs

    def undo(self) -> None:
        """The recording that was decided on last waits for a decision again. Raises CommandRefused."""
        file = self._last_file()
        self._desk.reviewer.undo(file)
        self.undone.add(file)

    def redo_last(self, command: Command) -> Decided:
        """Sets aside the recording that was decided on last; its trial is the next one again. Raises CommandRefused.

        A redo that would lose the migration is refused once.
        """
        journal, file = self._desk.session.journal, self._last_file()
        recorded = next((trial for trial in journal.recorded if trial.file == file), None)
        is_donned_anew = command.action is Action.REDON
        if recorded is None or file in journal.redone:
            raise CommandRefused("no recording was kept last that could be redone")
        if not command.reason:
            raise CommandRefused(WHY.format(command.action))
        if is_donned_anew and recorded.cuff is None:
            raise CommandRefused(NO_CUFF)
        if not is_donned_anew and file not in self._warned and redo_loses_migration(recorded, journal):
            self._warned.add(file)
            raise CommandRefused(
                f"{file} is the first static trial of its donning, in which the cuff may have slipped: unless it is "
                "donned anew, its migration stays unknown; say redon, or redo once more"
            )
        self._desk.reviewer.undo(file)
        self._desk.reviewer.decide("redo", command.reason, is_donned_anew=is_donned_anew)
        return Decided(file, "redo", command.reason, "operator", is_donned_anew)

    def _last_file(self) -> str:
        """Verdicts are in the order in which they were given."""
        return next(reversed(list(self._desk.session.journal.verdicts)), "")
