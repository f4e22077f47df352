"""The session that a console or a terminal has open: its folder, plan and state."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

from recordings.manifest import DataOrigin
from station.bench.session_folder import is_for_simulated, rehearsal_folder
from station.config import StationConfig
from station.errors import StationError
from station.journal import JOURNAL_FILE, Journal, Setup, read_journal, write_setup, write_skipped
from station.protocol import TrialSpec
from station.session.agenda import Agenda, agenda
from station.session.judgement import Judgement
from station.session.plan_check import fault_of, masses_of, plan_in_words
from station.session.summary import Summary


class CommandRefused(StationError):
    """The operator's command cannot be carried out now; one sentence."""


class OpenSession:
    """At most one session at a time. Raises CommandRefused, JournalError: one sentence, for the page that asked.

    judgement, summary and message are what is known of its last recording, of all, and of the last command;
    has_running_trial is kept by the trial runner.
    """

    def __init__(self, config: StationConfig, speed: float | None, clock_port: int | None) -> None:
        self.config, self.speed, self.clock_port = config, speed, clock_port
        self.folder: Path | None = None
        self.is_rehearsal = self.is_ending = self.has_running_trial = False
        self.judgement: Judgement | None = None
        self.summary: Summary | None = None
        self.message = ""
        self._read: tuple[tuple[int, int], Journal] | None = None

    @property
    def journal(self) -> Journal:
        """As it is on the disk now: the recorder writes into it too."""
        if self.folder is None:
            return Journal()
        try:
            seen = (self.folder / JOURNAL_FILE).stat()
        except FileNotFoundError:
            return Journal()
        stamp = seen.st_mtime_ns, seen.st_size
        if self._read is None or self._read[0] != stamp:
            self._read = stamp, read_journal(self.folder)
        return self._read[1]

    @property
    def is_simulated(self) -> bool:
        """Whether the bench is simulated, or this session's folder is for simulated data, or holds some."""
        is_marked = any(trial.origin == DataOrigin.SIMULATED for trial in self.journal.recorded)
        is_in_place = self.folder is not None and not self.is_rehearsal and is_for_simulated(self.folder)
        return self.clock_port is not None or is_marked or is_in_place

    @property
    def agenda(self) -> Agenda | None:
        journal = self.journal
        if self.folder is None or journal.setup is None:
            return None
        return agenda(journal.setup, journal, self.folder)

    def folder_of(self, setup: Setup) -> Path:
        return self.config.session.folder / f"sub-{setup.subject}_ses-{setup.number}"

    def begin(self, setup: Setup, *, is_rehearsal: bool = False, folder: Path | None = None) -> None:
        """Opens a session, by default in the folder of its name; one that is there already goes on where it was."""
        self.refuse_while_running()
        fault = fault_of(setup, self.config)
        if fault is not None:
            raise CommandRefused(fault)
        folder = rehearsal_folder() if is_rehearsal else folder or self.folder_of(setup)
        before = read_journal(folder).setup
        if before is not None and (planned := plan_in_words(before, self.config)) != plan_in_words(setup, self.config):
            raise CommandRefused(
                f"session {setup.number} of {setup.subject} was planned with {planned}; resume it "
                "as it is or give this one another session number"
            )
        if before is None:
            write_setup(folder, setup)
        self._open(folder, is_rehearsal=is_rehearsal)

    def resume(self, folder: Path) -> None:
        """Opens the session of this folder where it was left, by whomever: another console, or a terminal."""
        self.refuse_while_running()
        if read_journal(folder).setup is None:
            raise CommandRefused(f"{folder} holds no session that could go on: its {JOURNAL_FILE} has no plan")
        self._open(folder, is_rehearsal=False)

    def leave(self) -> None:
        """Closes the session; nothing is kept of a rehearsal."""
        self.refuse_while_running()
        if self.is_rehearsal and self.folder is not None:
            shutil.rmtree(self.folder.parent, ignore_errors=True)
        self.folder, self.is_rehearsal, self.judgement, self.message = None, False, None, ""

    def resume_plan(self) -> None:
        """Back from an early end: the plan goes on where it was."""
        self.is_ending, self.summary, self.message = False, None, ""

    def skip(self) -> TrialSpec:
        """Passes over the next trial of the plan, while none runs."""
        self.refuse_while_running()
        plan = self.agenda
        if plan is None or self.folder is None or plan.spec is None:
            raise CommandRefused("no trial of the plan is left to skip")
        write_skipped(self.folder, plan.spec)
        return plan.spec

    def refuse_while_running(self) -> None:
        if self.has_running_trial:
            raise CommandRefused("a trial is running; stop it or wait for its end")

    def next_spec(self, plan: Agenda) -> TrialSpec:
        """The next trial of the plan, with its file named as configured."""
        setup = self.journal.setup
        if plan.undecided is not None:
            raise CommandRefused(f"{plan.undecided.file} waits for accept or redo; decide that first")
        if plan.spec is None or setup is None:
            raise CommandRefused("every trial of the plan is accepted; the session is complete")
        keep = {"test": "{test}", "cuff": "{cuff}", "run": "{run}"}
        name = self.config.session.file_name.format(subject=setup.subject, session=setup.number, **keep)
        return replace(plan.spec, name=name)

    @property
    def trial_config(self) -> StationConfig:
        """The configuration with the load steps of this session, which the fit checks and every recording stores."""
        setup = self.journal.setup
        if setup is None:
            return self.config
        protocol = self.config.protocol.model_copy(update={"step_masses_kg": masses_of(setup, self.config)})
        return self.config.model_copy(update={"protocol": protocol})

    def _open(self, folder: Path, *, is_rehearsal: bool) -> None:
        self.folder, self.is_rehearsal, self.judgement, self.summary = folder, is_rehearsal, None, None
        self.message, self._read, self.is_ending = "", None, False
