"""What follows a recording: its fit, the operator's decision, and the summary of the session."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Callable
from concurrent.futures.process import BrokenProcessPool
from typing import Any, Literal

from station.bench.check import Line, look_at_bench
from station.journal import (
    Assignment,
    Choice,
    write_assigned,
    write_donned,
    write_mark,
    write_undone,
    write_verdict,
)
from station.session.adoption import adopt_recordings
from station.session.agenda import donning_is_open
from station.session.judgement import be_ready, judge_recording, unjudged
from station.session.open_session import CommandRefused, OpenSession
from station.session.plan_check import plan_in_words
from station.session.summary import SummaryError, summarise
from station.session.worker import Worker


class Reviewer:
    """Fits and assesses in a worker process. Raises CommandRefused, JournalError, each one sentence.

    progress is what it is doing to the session as a whole, empty while it does nothing.
    """

    def __init__(self, session: OpenSession) -> None:
        self._session = session
        self.progress = ""
        self.is_judging = False
        self._decided_s = -math.inf
        self._worker = Worker()

    @property
    def rest_left_s(self) -> float:
        """Wall seconds that the wearer should still rest, of the protocol's pause."""
        return self._session.config.protocol.pause_s / (self._session.speed or 1.0) - (
            time.monotonic() - self._decided_s
        )

    def decide(self, choice: Choice, reason: str, *, is_donned_anew: bool = False) -> None:
        """What counts of the recording that waits. A cuff that is donned anew starts its repeats anew."""
        plan = self._session.agenda
        if plan is None or self._session.folder is None or plan.undecided is None:
            raise CommandRefused("no recording waits for a decision")
        write_verdict(self._session.folder, plan.undecided.file, choice, reason)
        if is_donned_anew and plan.undecided.cuff is not None:
            write_donned(self._session.folder, plan.undecided.cuff)
        self._forget_fit()
        self._decided_s = time.monotonic()

    def undo(self, file: str = "") -> None:
        """Takes a decision back, the last one unless a file is given: its recording waits for a decision again.

        If nothing was recorded since the cuff was donned anew with that decision, the donning is taken back, too.
        """
        self._session.refuse_while_running()
        journal = self._session.journal
        file = file or next(reversed(list(journal.verdicts)), "")
        recorded = next((trial for trial in journal.recorded if trial.file == file), None)
        if self._session.folder is None or recorded is None or file not in journal.verdicts:
            raise CommandRefused("no decision to undo: no recording of this session was kept or redone")
        write_undone(
            self._session.folder, file, donned_cuff=recorded.cuff if donning_is_open(recorded, journal) else None
        )
        self._forget_fit()

    def assign(self, file: str, cuff: str, test: Literal["static", "dynamic"], repeat: int) -> None:
        """The recording is of another trial of the plan than it was recorded as, in the donning that is worn now."""
        self._session.refuse_while_running()
        journal, setup = self._session.journal, self._session.journal.setup
        recorded = next((trial for trial in journal.recorded if trial.file == file), None)
        if self._session.folder is None or setup is None or recorded is None:
            raise CommandRefused(f"{file} is no recording of this session")
        if recorded.cuff is None:
            raise CommandRefused("a bounce calibrates the load cell and is no trial of a cuff; it cannot be assigned")
        if cuff not in setup.cuffs or not 1 <= repeat <= setup.repeats:
            planned = plan_in_words(setup, self._session.config)
            raise CommandRefused(f"the plan has no {cuff}, {test}, repeat {repeat}; it has {planned}")
        donning = recorded.donning if cuff == recorded.cuff else str(1 + journal.donnings.get(cuff, 0))
        write_assigned(
            self._session.folder, file, Assignment(self._session.config.cuff_site(cuff), test, repeat, donning)
        )
        self._forget_fit()

    def name_mark(self, number: int, name: str) -> None:
        plan = self._session.agenda
        if plan is None or self._session.folder is None or plan.undecided is None:
            raise CommandRefused("no recording is looked at; marks are named before it is accepted or redone")
        write_mark(self._session.folder, plan.undecided.file, number, name)

    async def look_after(self) -> None:
        """What is to be done without anybody's asking, once a second: adopt recordings, judge what waits."""
        if self._session.folder is None or self._session.has_running_trial or self.is_judging:
            return
        self.is_judging = True
        try:
            await asyncio.to_thread(adopt_recordings, self._session.folder)
            plan = self._session.agenda
            waits = plan.undecided.file if plan is not None and plan.undecided is not None else None
            if waits is not None and (self._session.judgement is None or self._session.judgement.file != waits):
                try:
                    self._session.judgement = await self.in_worker(judge_recording, self._session.folder, waits)
                except BrokenProcessPool:
                    self._session.judgement = unjudged(waits)
        finally:
            self.is_judging = False

    async def finish(self) -> None:
        """Fit, assessment and report of the session; a minute or two."""
        if self._session.folder is None or self.progress:
            raise CommandRefused("it is being done already" if self.progress else "no session is open")
        self.progress = "fitting, assessing and writing the report: a minute or two"
        try:
            self._session.summary, self._session.message = await self.in_worker(summarise, self._session.folder), ""
        except SummaryError as error:
            self._session.message = str(error)
        except Exception as error:  # a fault of ours is told too; what was recorded and decided is stored
            self._session.message = (
                f"the session could not be summed up ({type(error).__name__}: {error}); its files are whole"
            )
        finally:
            self.progress = ""

    async def preflight(self) -> list[Line]:
        """What answers at the bench, and what does not."""
        self._session.refuse_while_running()
        lines: list[Line] = await self.in_worker(
            look_at_bench, self._session.config, self._session.config.session.folder
        )
        return lines

    async def warm_up(self) -> None:
        """Lets the worker import what a fit needs before the first trial waits for it."""
        await self.in_worker(be_ready)

    async def in_worker(self, work: Callable[..., Any], *arguments: Any) -> Any:
        """Runs a function of a module in the worker process."""
        return await self._worker.run(work, *arguments)

    def _forget_fit(self) -> None:
        """What was fitted holds no longer."""
        self._session.judgement = self._session.summary = None
        self._session.message = ""

    def close(self) -> None:
        self._worker.close()
