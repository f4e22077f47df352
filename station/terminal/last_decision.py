"""Change an earlier decision while no other recording waits."""

from __future__ import annotations

from station.journal import Recorded
from station.messages.codes import CommandCode
from station.session.controller import SessionController
from station.session.open_session import CommandRefused
from station.session.plan_status import kept_recordings, redo_loses_migration
from station.terminal.commands import Action, Command
from station.terminal.events import Decided


class LastDecision:
    """undone are the files of undone decisions; the operator decides on them, not the station."""

    def __init__(self, controller: SessionController) -> None:
        self._controller = controller
        self.undone: set[str] = set()
        self._warned: set[str] = set()  # files for which the loss of migration was reported

    def undo(self) -> None:
        """The recording of the last decision waits for a decision again. Raises CommandRefused."""
        file = self._last_file()
        self._controller.reviewer.undo(file)
        self.undone.add(file)

    def redo(self, command: Command) -> Decided:
        """Set the recording of the last decision, or of the trial that the command names, aside; its trial is left
        again. Raises CommandRefused.

        The first redo that would lose the migration is refused.
        """
        journal, recorded = self._controller.session.journal, self._recording_of(command)
        is_donned_anew = command.action is Action.REDON
        if recorded.file in journal.redone:
            raise CommandRefused.of(CommandCode.NOTHING_TO_REDO)
        if not command.reason:
            raise CommandRefused.of(CommandCode.REASON_MISSING, action=command.action.value)
        if is_donned_anew and recorded.cuff is None:
            raise CommandRefused.of(CommandCode.BOUNCE_NOT_DONNED)
        if not is_donned_anew and recorded.file not in self._warned and redo_loses_migration(recorded, journal):
            self._warned.add(recorded.file)
            raise CommandRefused.of(CommandCode.LOSES_MIGRATION, file=recorded.file)
        self._controller.reviewer.undo(recorded.file)
        self._controller.reviewer.decide("redo", command.reason, is_donned_anew=is_donned_anew)
        return Decided(recorded.file, "redo", command.reason, "operator", is_donned_anew)

    def _recording_of(self, command: Command) -> Recorded:
        """Raises CommandRefused if there is none."""
        journal = self._controller.session.journal
        if command.trial is not None:
            spec = self._controller.session.trial(command.trial)
            if not (kept := kept_recordings(spec, journal)):
                raise CommandRefused.of(CommandCode.NOT_DONE, trial=spec.title)
            return kept[-1]
        recorded = next((trial for trial in journal.recorded if trial.file == self._last_file()), None)
        if recorded is None:
            raise CommandRefused.of(CommandCode.NOTHING_TO_REDO)
        return recorded

    def _last_file(self) -> str:
        """Verdicts are in the order of the decisions."""
        return next(reversed(list(self._controller.session.journal.verdicts)), "")
