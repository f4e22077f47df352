"""The session that is open in a console or terminal: folder, plan and state; and the sessions of a folder.

A new session takes its subject, plan and wearer over from earlier ones.
"""

from __future__ import annotations

import shutil
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path

from documents.message import Message, because
from recordings.manifest import DataOrigin
from station.bench.session_folder import is_for_simulated, rehearsal_folder
from station.checksums import JOURNAL_FILE
from station.config import StationConfig
from station.errors import StationError
from station.exit_code import WRONG_USAGE
from station.journal import (
    Journal,
    JournalError,
    Setup,
    journal_error,
    read_journal,
    write_next,
    write_note,
    write_setup,
    write_skipped,
)
from station.messages.session_messages import CommandCode, JournalCode, TerminalCode
from station.protocol import TrialSpec
from station.session.judgement import Judgement
from station.session.plan_status import PlanStatus, check_setup, describe_plan, load_steps, minutes_left, plan_status
from station.session.summary import Summary
from station.subject.subject_file import SUBJECT_FILE, Cord, Subject, SubjectError, read_subject, write_subject


class CommandRefused(StationError):
    """The command of the operator cannot be executed now."""

    @classmethod
    def of(cls, code: CommandCode, **figures: float | str) -> CommandRefused:
        return cls(Message(code, figures))


class WrongSetup(CommandRefused):
    """The set-up of a new session has a fault."""

    exit_code = WRONG_USAGE


class OpenSession:
    """At most one session at a time. Methods raise CommandRefused and JournalError.

    judgement is of the last recording, summary of the whole session, message of the last command. mvc_uv is the largest
    EMG of the session's last usable MVC trial, mvc_file [µV], by channel, which the reviewer reads. The trial runner
    sets has_running_trial, the reviewer is_recorded_elsewhere: the recorder of another console, or of one that was
    killed, records a trial of this session.
    """

    def __init__(self, config: StationConfig, speed: float | None, clock_port: int | None) -> None:
        self.config, self.speed, self.clock_port = config, speed, clock_port
        self.folder: Path | None = None
        self.is_rehearsal = self.is_ending = self.has_running_trial = self.is_recorded_elsewhere = False
        self.judgement: Judgement | None = None
        self.summary: Summary | None = None
        self.mvc_file, self.mvc_uv = "", dict[str, float]()
        self.message = ""
        self._read: tuple[tuple[int, int], Journal] | None = None

    @property
    def journal(self) -> Journal:
        """The journal as it is on the disk now; the recorder and other consoles also write into it.

        While it cannot be read, as it was: a running trial is shown to its end, and then ensure_readable raises.
        """
        with suppress(JournalError):
            self.ensure_readable()
        return self._read[1] if self._read is not None else Journal()

    def ensure_readable(self) -> None:
        """Read the journal of the open session if it has changed. Raises JournalError if that is not possible."""
        if self.folder is None:
            return
        path = self.folder / JOURNAL_FILE
        try:
            status = path.stat()
        except FileNotFoundError as error:
            raise journal_error(JournalCode.GONE, self.folder) from error
        except OSError as error:
            raise journal_error(JournalCode.UNREADABLE, path, **because(error)) from error
        stamp = status.st_mtime_ns, status.st_size
        if self._read is None or self._read[0] != stamp:
            self._read = stamp, read_journal(self.folder)

    @property
    def is_simulated(self) -> bool:
        """Whether the bench is simulated, or the session's folder is for simulated data or holds some."""
        is_marked = any(trial.origin == DataOrigin.SIMULATED for trial in self.journal.recorded)
        is_in_place = self.folder is not None and not self.is_rehearsal and is_for_simulated(self.folder)
        return self.clock_port is not None or is_marked or is_in_place

    @property
    def plan(self) -> PlanStatus | None:
        journal = self.journal
        if self.folder is None or journal.setup is None:
            return None
        return plan_status(journal.setup, journal, self.folder)

    @property
    def minutes_left(self) -> int:
        """Estimate of the time for the trials of the plan that are left."""
        plan = self.plan
        return 0 if plan is None else minutes_left(plan, self.journal, self.trial_config)

    def session_folder(self, setup: Setup) -> Path:
        return self.config.session.folder / f"sub-{setup.subject}_ses-{setup.number}"

    def begin(
        self, setup: Setup, *, wearer: Subject | None = None, is_rehearsal: bool = False, folder: Path | None = None
    ) -> None:
        """Open a session, by default in the folder of its name; an existing one is resumed, with its wearer."""
        self.refuse_while_running()
        self.ensure_possible(setup)
        folder = rehearsal_folder() if is_rehearsal else folder or self.session_folder(setup)
        before = read_journal(folder).setup
        if before is not None and (plan := describe_plan(before, self.config)) != describe_plan(setup, self.config):
            figures = {"number": setup.number, "subject": setup.subject, "plan": plan}
            raise CommandRefused.of(CommandCode.OTHER_PLAN, **figures)
        if before is None:
            write_setup(folder, setup)
        self._open(folder, is_rehearsal=is_rehearsal)
        if wearer is not None and not (folder / SUBJECT_FILE).exists():
            write_subject(folder, wearer)

    def ensure_possible(self, setup: Setup) -> None:
        """Raises WrongSetup for one with a fault."""
        fault = check_setup(setup, self.config)
        if fault is not None:
            raise WrongSetup(fault)

    def resume(self, folder: Path) -> None:
        """Resume the session of this folder, also one of another console or of a terminal."""
        self.refuse_while_running()
        if read_journal(folder).setup is None:
            raise CommandRefused.of(CommandCode.NO_PLAN, folder=str(folder), file=JOURNAL_FILE)
        self._open(folder, is_rehearsal=False)

    def leave(self) -> None:
        """Close the session; delete a rehearsal."""
        self.refuse_while_running()
        if self.is_rehearsal and self.folder is not None:
            shutil.rmtree(self.folder.parent, ignore_errors=True)
        self.abandon("")

    def abandon(self, message: str) -> None:
        """Close the session and leave its files as they are; message says why."""
        self.folder, self.is_rehearsal, self.judgement, self.message, self._read = None, False, None, message, None

    @property
    def wearer(self) -> Subject:
        """Content of subject.toml; an unknown wearer without the file. Raises SubjectError for a damaged file."""
        is_declared = self.folder is not None and (self.folder / SUBJECT_FILE).exists()
        return read_subject(self.folder) if is_declared and self.folder is not None else Subject()

    def declare_wearer(self, wearer: Subject) -> None:
        """Write subject.toml; the summary so far is of another body."""
        if self.folder is None:
            raise CommandRefused.of(CommandCode.NO_SESSION)
        write_subject(self.folder, wearer)
        self.summary = None

    def resume_plan(self) -> None:
        """Return from an early end to the plan."""
        self.is_ending, self.summary, self.message = False, None, ""

    def trial(self, number: int) -> TrialSpec:
        """The trial of this number in the plan, from 1. Raises CommandRefused."""
        trials = self.plan.trials if self.plan is not None else ()
        if not 1 <= number <= len(trials):
            raise CommandRefused.of(CommandCode.NO_SUCH_TRIAL, number=number, most=len(trials))
        return trials[number - 1]

    def skip(self, spec: TrialSpec | None = None) -> TrialSpec:
        """Skip a trial that is left, by default the next one, while none runs."""
        self.refuse_while_running()
        plan = self.plan
        spec = plan.spec if plan is not None and spec is None else spec
        if plan is None or self.folder is None or spec not in plan.left or spec is None:
            raise CommandRefused.of(CommandCode.NOTHING_TO_SKIP)
        write_skipped(self.folder, spec)
        return spec

    def choose(self, spec: TrialSpec) -> None:
        """Make a trial that is left or skipped the next one, while none runs."""
        self.refuse_while_running()
        plan = self.plan
        if plan is None or self.folder is None or spec not in (*plan.left, *plan.skipped):
            raise CommandRefused.of(CommandCode.NOT_LEFT, trial=spec.title)
        write_next(self.folder, spec)

    def note(self, file: str, text: str) -> None:
        """Write a note on a recording, or on the session if file is empty; it replaces the previous one."""
        if self.folder is None:
            raise CommandRefused.of(CommandCode.NO_SESSION)
        if text.strip() == self.journal.notes.get(file, ""):
            return
        write_note(self.folder, file, text)
        if self.summary is not None:
            self.summary, self.message = None, str(Message(TerminalCode.NOTE_AFTER_REPORT))

    def refuse_while_running(self) -> None:
        if self.has_running_trial:
            raise CommandRefused.of(CommandCode.TRIAL_RUNNING)

    def next_spec(self, plan: PlanStatus) -> TrialSpec:
        """The next trial of the plan, with its file named as configured."""
        setup = self.journal.setup
        if plan.undecided is not None:
            raise CommandRefused.of(CommandCode.UNDECIDED, file=plan.undecided.file)
        if plan.spec is None or setup is None:
            raise CommandRefused.of(CommandCode.COMPLETE)
        fields = {"test": "{test}", "cuff": "{cuff}", "run": "{run}"}
        name = self.config.session.file_name.format(subject=setup.subject, session=setup.number, **fields)
        return replace(plan.spec, name=name)

    @property
    def trial_config(self) -> StationConfig:
        """The configuration with the load steps of this session; every recording stores it, and the fit checks them."""
        setup = self.journal.setup
        if setup is None:
            return self.config
        protocol = self.config.protocol.model_copy(update={"step_masses_kg": load_steps(setup, self.config)})
        return self.config.model_copy(update={"protocol": protocol})

    def _open(self, folder: Path, *, is_rehearsal: bool) -> None:
        self.folder, self.is_rehearsal, self.judgement, self.summary = folder, is_rehearsal, None, None
        self.message, self._read, self.is_ending, self.is_recorded_elsewhere = "", None, False, False
        self.mvc_file, self.mvc_uv = "", {}


@dataclass(frozen=True)
class ListedSession:
    """done of its trials are accepted; begun is local time, None if the journal has no start."""

    setup: Setup
    folder: Path
    begun: datetime | None
    done: int
    trials: int


def list_sessions(folder: Path) -> list[ListedSession]:
    """Sessions in the subfolders, the one with the latest journal entry first."""
    listed = []
    for path in folder.glob(f"*/{JOURNAL_FILE}"):
        try:
            journal = read_journal(path.parent)
        except JournalError:
            continue
        if journal.setup is not None:
            plan = plan_status(journal.setup, journal, path.parent)
            begun = local_time(journal.begun)
            session = ListedSession(journal.setup, path.parent, begun, len(plan.done), len(plan.trials))
            listed.append((path.stat().st_mtime, session))
    return [session for _, session in sorted(listed, key=lambda entry: -entry[0])]


def local_time(utc: str) -> datetime | None:
    """Of a time in the journal; None for one that this computer cannot convert."""
    try:
        return datetime.fromisoformat(utc).astimezone()
    except (ValueError, OverflowError, OSError):  # Windows has no local time of most years
        return None


class EarlierSessions:
    """Suggestions from sessions in the order of list_sessions, the latest first."""

    def __init__(self, sessions: list[ListedSession], config: StationConfig) -> None:
        self.sessions, self._config = sessions, config

    @property
    def setup(self) -> Setup:
        """The plan of the last session, as far as the configuration still has it; else that of the configuration."""
        config = self._config
        conditions = config.body.conditions if config.body is not None else ()
        plan, has_bounce = config.protocol, config.bounce is not None
        default = Setup("", "", tuple(config.cuffs), plan.repeats, has_bounce, "1", plan.step_masses_kg, conditions)
        if not self.sessions:
            return default
        last = self.sessions[0].setup
        return replace(
            default,
            operator=last.operator,
            cuffs=tuple(cuff for cuff in last.cuffs if cuff in config.cuffs),
            repeats=last.repeats,
            has_bounce=has_bounce and last.has_bounce,
            step_masses_kg=last.step_masses_kg or plan.step_masses_kg,
            conditions=last.conditions if config.body is not None else (),
        )

    def next_number(self, subject: str) -> str:
        """The next free number of this subject."""
        used = {session.setup.number for session in self.sessions if session.setup.subject == subject}
        return str(1 + max((int(number) for number in used if number.isdecimal()), default=0))

    def wearer(self, subject: str) -> Subject:
        """Laboratory and suit as in the last session with a wearer, mass as in the last one of this subject."""
        known = [(listed.setup.subject, wearer) for listed in self.sessions if (wearer := _wearer_in(listed.folder))]
        if not known:
            return Subject()
        last = known[0][1]
        cord = last.cord
        if cord is not None and cord.cuff not in self._config.cuffs:
            cord = Cord(rest_length_m=cord.rest_length_m) if cord.rest_length_m is not None else None
        masses = (wearer.mass_kg for code, wearer in known if code == subject and wearer.mass_kg is not None)
        return last.model_copy(update={"mass_kg": next(masses, None), "cord": cord})


def _wearer_in(folder: Path) -> Subject | None:
    try:
        return read_subject(folder)
    except SubjectError:
        return None
