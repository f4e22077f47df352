"""After a recording: its fit, the operator's decision, and the summary of the session.

Recordings that are missing in the journal are adopted: left by a killed recorder, or written by `station record`.
"""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

from filelock import FileLock, Timeout

from documents.message import Message, because
from recordings.errors import RecordingError
from recordings.reader import open_recording
from recordings.recovery import RecoveryReport, recover
from station.bench.trial_recorder import LOCK
from station.checksums import write_checksums
from station.journal import (
    Assignment,
    Choice,
    Recorded,
    journal_error,
    read_journal,
    write_assigned,
    write_donned,
    write_mark,
    write_recorded,
    write_undone,
    write_verdict,
)
from station.messages.bench_messages import TrialCode
from station.messages.session_messages import CommandCode, JournalCode, TerminalCode
from station.progress import StageProgress
from station.protocol import TrialSpec
from station.recordings_of_session import recordings_in
from station.session.judgement import Judgement, judgement_without_fit
from station.session.open_session import CommandRefused, OpenSession
from station.session.plan_status import describe_plan, is_donned_without_trial, kept_recordings
from station.session.summary import Summary, SummaryError, summarise
from station.session.worker import Worker, WorkerKilled


class Reviewer:
    """Fits and assesses in a worker process. Methods raise CommandRefused and JournalError.

    progress is the current work on the session as a whole, empty while there is none; stages are those of it so far.
    """

    def __init__(self, session: OpenSession) -> None:
        self._session = session
        self.progress = ""
        self.stages: list[StageProgress] = []
        self.is_judging = False
        self._decided_s = -math.inf
        self._mvc_killed_by = ""  # file of the MVC trial that killed the worker once
        self._worker = Worker()

    @property
    def rest_left_s(self) -> float:
        """Remaining wall seconds of the wearer's pause."""
        return self._session.config.protocol.pause_s / (self._session.speed or 1.0) - (
            time.perf_counter() - self._decided_s
        )

    def decide(self, choice: Choice, reason: str, *, is_donned_anew: bool = False) -> None:
        """Accept or redo the recording that waits. A cuff that is donned anew starts its repeats again."""
        folder, undecided = self._undecided()
        write_verdict(folder, undecided.file, choice, reason)
        if is_donned_anew and undecided.cuff is not None:
            write_donned(folder, undecided.cuff)
        self._discard_fit()
        self._decided_s = time.perf_counter()

    def redo(self, spec: TrialSpec, reason: str, *, is_donned_anew: bool = False) -> None:
        """Set the accepted recording of a trial aside, so that the trial is left again."""
        self._session.refuse_while_running()
        plan, kept = self._session.plan, kept_recordings(spec, self._session.journal)
        if plan is None or self._session.folder is None or spec not in plan.done or not kept:
            raise CommandRefused.of(CommandCode.NOT_DONE, trial=spec.title)
        for recorded in kept:
            write_verdict(self._session.folder, recorded.file, "redo", reason)
        if is_donned_anew and spec.cuff is not None:
            write_donned(self._session.folder, spec.cuff)
        self._discard_fit()

    def undo(self, file: str = "") -> None:
        """Undo a decision, by default the last one: its recording waits for a decision again.

        If the cuff was donned anew with that decision and no trial was recorded since, the donning is undone as well.
        """
        self._session.refuse_while_running()
        journal = self._session.journal
        file = file or next(reversed(list(journal.verdicts)), "")
        recorded = next((trial for trial in journal.recorded if trial.file == file), None)
        if self._session.folder is None or recorded is None or file not in journal.verdicts:
            raise CommandRefused.of(CommandCode.NOTHING_TO_UNDO)
        is_undonned = is_donned_without_trial(recorded, journal)
        write_undone(self._session.folder, file, donned_cuff=recorded.cuff if is_undonned else None)
        self._discard_fit()

    def assign(self, file: str, cuff: str, test: Literal["static", "dynamic"], repeat: int) -> None:
        """Assign the recording to another trial of the plan, in the current donning of the cuff."""
        self._session.refuse_while_running()
        journal, setup = self._session.journal, self._session.journal.setup
        recorded = next((trial for trial in journal.recorded if trial.file == file), None)
        if self._session.folder is None or setup is None or recorded is None:
            raise CommandRefused.of(CommandCode.UNKNOWN_RECORDING, file=file)
        if recorded.cuff is None:
            raise CommandRefused.of(CommandCode.BOUNCE_NOT_ASSIGNABLE, file=file)
        if cuff not in setup.cuffs or not 1 <= repeat <= setup.repeats:
            plan = describe_plan(setup, self._session.config)
            raise CommandRefused.of(CommandCode.NOT_IN_PLAN, cuff=cuff, test=test, repeat=repeat, plan=plan)
        donning = recorded.donning if cuff == recorded.cuff else str(1 + journal.donnings.get(cuff, 0))
        assignment = Assignment(self._session.config.cuff_site(cuff), test, repeat, donning)
        write_assigned(self._session.folder, file, assignment)
        self._discard_fit()

    def name_mark(self, number: int, name: str) -> None:
        folder, undecided = self._undecided()
        write_mark(folder, undecided.file, number, name)

    def _undecided(self) -> tuple[Path, Recorded]:
        """The folder, and the recording that waits for a decision. Raises CommandRefused."""
        plan, folder = self._session.plan, self._session.folder
        if plan is None or folder is None or plan.undecided is None:
            raise CommandRefused.of(CommandCode.NOTHING_TO_DECIDE)
        return folder, plan.undecided

    async def process_recordings(self) -> None:
        """Adopt recordings without a journal entry, and judge the one that waits. Call once a second.

        Raises JournalError if the folder of the session is gone, or cannot be read or written.
        """
        if self._session.folder is None or self._session.has_running_trial or self.is_judging:
            return
        self._session.ensure_readable()
        self.is_judging = True
        try:
            adopted = await asyncio.to_thread(adopt_recordings, self._session.folder)
            self._session.is_recorded_elsewhere = adopted is None
            if any(code.code is TrialCode.RECORDER_KILLED for recorded in adopted or () for code in recorded.codes):
                self._session.message = ""  # the verdict states it
            plan = self._session.plan
            file = plan.undecided.file if plan is not None and plan.undecided is not None else None
            if file is not None and (self._session.judgement is None or self._session.judgement.file != file):
                try:
                    self._session.judgement = await self.in_worker(_judge, self._session.folder, file)
                except WorkerKilled:
                    self._session.judgement = judgement_without_fit(file)
            await self._read_mvc(self._session.folder)
        finally:
            self.is_judging = False

    async def _read_mvc(self, folder: Path) -> None:
        """Read the EMG of the last usable MVC trial, also of one that another console recorded. If the worker is killed
        twice by it, EMG stays in microvolts.
        """
        journal = self._session.journal
        usable = [trial for trial in journal.recorded if trial.accepted and trial.file not in journal.redone]
        file = next((trial.file for trial in reversed(usable) if trial.condition == "mvc"), "")
        if file != self._session.mvc_file:
            found: dict[str, float] = {}
            try:
                if file:
                    found = await self.in_worker(_read_largest_emg, folder / file)
            except WorkerKilled:
                if self._mvc_killed_by != file:
                    self._mvc_killed_by = file
                    return
                self._session.message = str(Message(TerminalCode.MVC_NOT_READ, {"file": file}))
            if self._session.folder == folder:
                self._session.mvc_file, self._session.mvc_uv = file, found

    async def finish(self) -> None:
        """Fit, assess and report the session."""
        if self._session.folder is None:
            raise CommandRefused.of(CommandCode.NO_SESSION)
        if self.progress:
            raise CommandRefused.of(CommandCode.SUMMARY_RUNNING)
        self.progress, self.stages = str(Message(TerminalCode.SUMMARY_STARTED)), []
        try:
            self._session.summary, self._session.message = await self._summarise(self._session.folder), ""
        except SummaryError as error:
            self._session.message = str(error)
        except Exception as error:  # a bug must reach the operator; recordings and decisions are stored
            figures = {"error": f"{type(error).__name__}: {error}"}
            self._session.message = str(Message(TerminalCode.SUMMARY_FAILED, figures))
        finally:
            self.progress = ""

    async def _summarise(self, folder: Path) -> Summary:
        summary: Summary = await self._worker.run_with_progress(self._note_progress, summarise, folder)
        return summary

    def _note_progress(self, stage: str, done: int, total: int) -> None:
        known = next((known for known in self.stages if known.name == stage), None)
        if known is None:
            self.stages = [*self.stages, StageProgress(stage, time.perf_counter(), done, total)]
        else:
            known.done, known.total = done, total

    async def warm_up(self) -> None:
        """Import the modules of the fit in the worker before the first trial needs them."""
        await self.in_worker(_import_fit)

    async def in_worker(self, work: Callable[..., Any], *arguments: Any) -> Any:
        """Run a function of a module in the worker process."""
        return await self._worker.run(work, *arguments)

    def _discard_fit(self) -> None:
        """A decision makes the last fit invalid."""
        self._session.judgement = self._session.summary = None
        self._session.message = ""

    def close(self) -> None:
        self._worker.close()


# Executed by the worker, which alone imports the fit: that takes seconds, and this process starts without it.


def _import_fit() -> None:
    import station.session.fitted_judgement  # noqa: F401  (the import is the effect)


def _judge(folder: Path, file: str) -> Judgement:
    from station.session.fitted_judgement import judge_recording

    return judge_recording(folder, file)


def _read_largest_emg(path: Path) -> dict[str, float]:
    from station.session.fitted_judgement import largest_emg

    return largest_emg(path)


def adopt_recordings(folder: Path) -> tuple[Recorded, ...] | None:
    """Enter every recording of the folder into the journal if it is missing there; recover a cut one first.

    Returns the new entries; None, without effect, while a recorder runs in the folder: it writes its own entry.
    Raises JournalError if the folder cannot be written.
    """
    adopted = []
    try:
        with FileLock(folder / LOCK, timeout=0):
            known = {trial.file for trial in read_journal(folder).recorded}
            for path in recordings_in(folder):
                if path.name not in known:
                    adopted.append(_recorded_from(path))
                    write_recorded(folder, adopted[-1])
    except Timeout:
        return None
    except (OSError, NotImplementedError) as error:  # read-only, or without locks
        raise journal_error(JournalCode.NOT_WRITTEN, folder, **because(error)) from error
    return tuple(adopted)


def is_being_recorded(folder: Path) -> bool:
    """Whether a recorder runs in the folder of a session."""
    if not (folder / LOCK).exists():
        return False
    try:
        with FileLock(folder / LOCK, timeout=0):
            return False
    except Timeout:
        return True
    except (OSError, NotImplementedError):  # a folder without locks records nothing
        return False


def _recorded_from(path: Path) -> Recorded:
    try:
        recording = open_recording(path)
        killed = None
        if not recording.complete:
            report = recover(path)
            write_checksums(path, report.output)
            path, killed = report.output, _describe_kill(report)
        manifest, outcome = recording.manifest, recording.outcome
    except RecordingError as error:
        unreadable = Message(TrialCode.UNREADABLE, because(error))
        place = (path.name, None, "unreadable", 0, "")
        return Recorded(*place, accepted=False, lost_samples=0, sentence=str(unreadable), codes=(unreadable,))
    cuff = manifest.cuff.name if manifest.cuff else None
    is_accepted = killed is None and outcome is not None and outcome.accepted
    sentence = str(killed) if killed else outcome.sentence if outcome else ""
    known = {code.value: code for code in TrialCode}
    codes = [Message(known[code]) for code in outcome.codes if code in known] if outcome else []
    return Recorded(
        path.name,
        cuff,
        manifest.test,
        manifest.repeat,
        manifest.donning,
        is_accepted,
        0,
        sentence,
        (killed,) if killed else tuple(codes),
        manifest.origin,
        manifest.condition,
    )


def _describe_kill(report: RecoveryReport) -> Message[TrialCode]:
    """The time that was kept for the operator; the damage to the file and to its streams as `details`."""
    streams = report.contents.streams.values()
    kept_s = max(((stream.last_device_time_ns - stream.first_device_time_ns) * 1e-9 for stream in streams), default=0)
    figures = {"kept_s": kept_s, "details": "; ".join(report.sentences())}
    return Message(TrialCode.RECORDER_KILLED, figures)
