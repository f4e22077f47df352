"""The desk: one session and at most one running trial, which every open page shows and any of them may steer.

All of it runs in the event loop's thread. What takes long (recording, fitting) is done by other processes, so that no
page can slow the recorder and no fit a page.
"""

from __future__ import annotations

import asyncio
import math
import shutil
import time
from collections.abc import Callable
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from recordings.manifest import DataOrigin
from station.bench.check import Line, look_at_bench
from station.bench.session_folder import is_for_simulated, rehearsal_folder
from station.bench.simulation import SimulatedBench
from station.config import StationConfig
from station.errors import StationError
from station.journal import (
    JOURNAL_FILE,
    Assignment,
    Choice,
    Journal,
    Setup,
    read_journal,
    write_assigned,
    write_donned,
    write_mark,
    write_setup,
    write_skipped,
    write_undone,
    write_verdict,
)
from station.protocol import TrialSpec
from station.session.adoption import adopt_recordings
from station.session.agenda import Agenda, agenda, donning_is_open
from station.session.guide import ceilings_of, guide_for
from station.session.judgement import Judgement, be_ready, judge_recording, unjudged
from station.session.live import Live
from station.session.plan_check import fault_of, masses_of, plan_in_words
from station.session.simulated_hands import SimulatedHands
from station.session.summary import Summary, SummaryError, summarise
from station.session.trial_process import TrialProcess
from station.session.worker import Worker


class DeskRefusal(StationError):
    """The desk cannot do that now; one sentence."""


class Desk:
    """Raises DeskRefusal, JournalError, SimulationError: each one sentence, for the page that asked."""

    def __init__(
        self,
        config: StationConfig,
        speed: float | None = 1.0,
        bench: SimulatedBench | None = None,
        clock_port: int | None = None,
    ) -> None:
        """bench: simulated devices of its own; clock_port: the clock of a simulated bench that runs elsewhere.

        speed is the pace of either; None: as fast as it is handled.
        """
        self.config, self.speed = config, speed
        self._clock_port = clock_port if bench is None else bench.clock_port
        self.folder: Path | None = None
        self.is_rehearsal = False
        self.live: Live | None = None
        self.judgement: Judgement | None = None
        self.summary: Summary | None = None
        self.message = self.progress = ""
        self.is_judging = self.is_ending = False
        self._decided_s = -math.inf
        self._read: tuple[tuple[int, int], Journal] | None = None
        self._trial: TrialProcess | None = None
        self.ended: TrialProcess | None = None  # the trial before, with its result or its refusal
        self._tasks: set[asyncio.Task[None]] = set()
        self._worker = Worker()
        self.ceilings = ceilings_of(config)
        self._hands = SimulatedHands(bench, config.protocol.pause_s) if bench is not None else None

    # -- the session ---------------------------------------------------------------------------------------------

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
        is_marked = any(each.origin == DataOrigin.SIMULATED for each in self.journal.recorded)
        is_in_place = self.folder is not None and not self.is_rehearsal and is_for_simulated(self.folder)
        return self._clock_port is not None or is_marked or is_in_place

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
        self._refuse_while_running()
        fault = fault_of(setup, self.config)
        if fault is not None:
            raise DeskRefusal(fault)
        folder = rehearsal_folder() if is_rehearsal else folder or self.folder_of(setup)
        before = read_journal(folder).setup
        if before is not None and (planned := plan_in_words(before, self.config)) != plan_in_words(setup, self.config):
            raise DeskRefusal(
                f"session {setup.number} of {setup.subject} was planned with {planned}; resume it "
                "as it is or give this one another session number"
            )
        if before is None:
            write_setup(folder, setup)
        self._open(folder, is_rehearsal=is_rehearsal)

    def resume(self, folder: Path) -> None:
        """Opens the session of this folder where it was left, by whomever: another console, or a terminal."""
        self._refuse_while_running()
        if read_journal(folder).setup is None:
            raise DeskRefusal(f"{folder} holds no session that could go on: its {JOURNAL_FILE} has no plan")
        self._open(folder, is_rehearsal=False)

    def _open(self, folder: Path, *, is_rehearsal: bool) -> None:
        self.folder, self.is_rehearsal, self.judgement, self.summary = folder, is_rehearsal, None, None
        self.message, self._read, self.is_ending = "", None, False

    def leave(self) -> None:
        """Closes the session; nothing is kept of a rehearsal."""
        self._refuse_while_running()
        if self.is_rehearsal and self.folder is not None:
            shutil.rmtree(self.folder.parent, ignore_errors=True)
        self.folder, self.is_rehearsal, self.judgement, self.message = None, False, None, ""

    async def preflight(self) -> list[Line]:
        """What answers at the bench, and what does not."""
        self._refuse_while_running()
        lines: list[Line] = await self.in_worker(look_at_bench, self.config, self.config.session.folder)
        return lines

    async def end_early(self) -> None:
        """The session ends with what exists; a running trial is ended cleanly first, its recording counts."""
        if self.folder is None:
            raise DeskRefusal("no session is open")
        self.is_ending = True
        if self._trial is not None:
            await self._trial.stop()

    def resume_plan(self) -> None:
        """Back from an early end: the plan goes on where it was."""
        self.is_ending, self.summary, self.message = False, None, ""

    async def finish(self) -> None:
        """Fit, assessment and report of the session; a minute or two."""
        if self.folder is None or self.progress:
            raise DeskRefusal("it is being done already" if self.progress else "no session is open")
        self.progress = "fitting, assessing and writing the report: a minute or two"
        try:
            self.summary, self.message = await self.in_worker(summarise, self.folder), ""
        except SummaryError as error:
            self.message = str(error)
        except Exception as error:  # a fault of ours is told too; what was recorded and decided is stored
            self.message = f"the session could not be summed up ({type(error).__name__}: {error}); its files are whole"
        finally:
            self.progress = ""

    @property
    def rest_left_s(self) -> float:
        """Wall seconds that the wearer should still rest, of the protocol's pause."""
        return self.config.protocol.pause_s / (self.speed or 1.0) - (time.monotonic() - self._decided_s)

    # -- the trial -----------------------------------------------------------------------------------------------

    async def arm(self) -> None:
        """Starts the recorder for the next trial of the plan."""
        self._refuse_while_running()
        plan = self.agenda
        if plan is None or self.folder is None:
            raise DeskRefusal("no session is open; set one up first")
        if plan.undecided is not None:
            raise DeskRefusal(f"{plan.undecided.file} waits for accept or redo; decide that first")
        if plan.spec is None:
            raise DeskRefusal("every trial of the plan is accepted; the session is complete")
        spec = replace(plan.spec, name=self._name())
        self.message, self.judgement = "", None
        self.live = Live(spec, guide_for(spec.test, self._session_config.protocol))
        try:
            if self._hands is not None:
                await asyncio.to_thread(self._hands.prepare, plan)
            self._trial = await TrialProcess.start(
                self._session_config, self.folder, spec, self._clock_port, self.speed
            )
        except BaseException:
            self.live = None
            raise
        self._spawn(self._follow(self._trial))

    async def stop(self) -> None:
        """Once: the trial ends cleanly; twice: at once. While it is armed this cancels it."""
        if self._trial is None:
            raise DeskRefusal("no trial is running")
        await self._trial.stop()

    async def mark(self) -> None:
        """Marks this moment in the recording, to be named later."""
        if self._trial is None or self.live is None:
            raise DeskRefusal("no trial is running: there is nothing to mark")
        if not self.live.takes_marks:
            raise DeskRefusal("nothing is recorded yet: marks count from the sync edge on")
        self.live.add_mark()
        await self._trial.mark()

    def note(self, number: int, name: str) -> None:
        """What a mark of the running trial was; the journal has it when the trial's file is there."""
        if self.live is None or number not in self.live.marks:
            raise DeskRefusal(f"mark {number} is none of the running trial; name it with the verdict")
        self.live.mark_names[number] = name.strip()

    def tare(self) -> None:
        if self.live is None or not self.live.force:
            raise DeskRefusal("no force yet: there is nothing to tare")
        self.live.tare()

    def silence(self) -> None:
        """Somebody has seen the alarm: it is not sounded any more, and goes with its cause."""
        if self.live is not None:
            self.live.is_alarm_seen = self.live.alarm is not None

    # -- the verdict ---------------------------------------------------------------------------------------------

    def decide(self, choice: Choice, reason: str, *, is_donned_anew: bool = False) -> None:
        """What counts of the recording that waits. A cuff that is donned anew starts its repeats anew."""
        plan = self.agenda
        if plan is None or self.folder is None or plan.undecided is None:
            raise DeskRefusal("no recording waits for a decision")
        write_verdict(self.folder, plan.undecided.file, choice, reason)
        if is_donned_anew and plan.undecided.cuff is not None:
            write_donned(self.folder, plan.undecided.cuff)
        self._forget_fit()
        self._decided_s = time.monotonic()

    def undo(self, file: str = "") -> None:
        """Takes a decision back, the last one unless a file is given: its recording waits for a decision again.

        If nothing was recorded since the cuff was donned anew with that decision, the donning is taken back, too.
        """
        self._refuse_while_running()
        journal = self.journal
        file = file or next(reversed(list(journal.verdicts)), "")
        recorded = next((trial for trial in journal.recorded if trial.file == file), None)
        if self.folder is None or recorded is None or file not in journal.verdicts:
            raise DeskRefusal("no decision to undo: no recording of this session was kept or redone")
        write_undone(self.folder, file, donned_cuff=recorded.cuff if donning_is_open(recorded, journal) else None)
        self._forget_fit()

    def assign(self, file: str, cuff: str, test: Literal["static", "dynamic"], repeat: int) -> None:
        """The recording is of another trial of the plan than it was recorded as, in the donning that is worn now."""
        self._refuse_while_running()
        journal, setup = self.journal, self.journal.setup
        recorded = next((trial for trial in journal.recorded if trial.file == file), None)
        if self.folder is None or setup is None or recorded is None:
            raise DeskRefusal(f"{file} is no recording of this session")
        if recorded.cuff is None:
            raise DeskRefusal("a bounce calibrates the load cell and is no trial of a cuff; it cannot be assigned")
        if cuff not in setup.cuffs or not 1 <= repeat <= setup.repeats:
            planned = plan_in_words(setup, self.config)
            raise DeskRefusal(f"the plan has no {cuff}, {test}, repeat {repeat}; it has {planned}")
        donning = recorded.donning if cuff == recorded.cuff else str(1 + journal.donnings.get(cuff, 0))
        write_assigned(self.folder, file, Assignment(self.config.cuff_site(cuff), test, repeat, donning))
        self._forget_fit()

    def skip(self) -> TrialSpec:
        """Passes over the next trial of the plan, while none runs."""
        self._refuse_while_running()
        plan = self.agenda
        if plan is None or self.folder is None or plan.spec is None:
            raise DeskRefusal("no trial of the plan is left to skip")
        write_skipped(self.folder, plan.spec)
        return plan.spec

    def name_mark(self, number: int, name: str) -> None:
        plan = self.agenda
        if plan is None or self.folder is None or plan.undecided is None:
            raise DeskRefusal("no recording is looked at; marks are named before it is accepted or redone")
        write_mark(self.folder, plan.undecided.file, number, name)

    async def warm_up(self) -> None:
        """Lets the worker import what a fit needs before the first trial waits for it."""
        await self.in_worker(be_ready)

    async def in_worker(self, work: Callable[..., Any], *arguments: Any) -> Any:
        """Runs a function of a module in the worker process."""
        return await self._worker.run(work, *arguments)

    def close(self) -> None:
        """The console ends; a running trial goes on to its end by itself."""
        for task in self._tasks:
            task.cancel()
        self._worker.close()

    def _forget_fit(self) -> None:
        """What was fitted holds no longer."""
        self.judgement = self.summary = None
        self.message = ""

    # -- inside --------------------------------------------------------------------------------------------------

    def _refuse_while_running(self) -> None:
        if self.live is not None:
            raise DeskRefusal("a trial is running; stop it or wait for its end")

    def _name(self) -> str:
        setup = self.journal.setup
        assert setup is not None  # noqa: S101  (an agenda has one)
        keep = {"test": "{test}", "cuff": "{cuff}", "run": "{run}"}
        return self.config.session.file_name.format(subject=setup.subject, session=setup.number, **keep)

    @property
    def _session_config(self) -> StationConfig:
        """The configuration with the load steps of this session, which the fit checks and every recording tells."""
        setup = self.journal.setup
        assert setup is not None  # noqa: S101  (an agenda has one)
        protocol = self.config.protocol.model_copy(update={"step_masses_kg": masses_of(setup, self.config)})
        return self.config.model_copy(update={"protocol": protocol})

    async def _follow(self, trial: TrialProcess) -> None:
        live = self.live
        assert live is not None  # noqa: S101  (arm() has just made it)
        try:
            await trial.follow(lambda said: self._take(live, said))
        finally:
            self.live, self._trial, self.ended = None, None, trial
        said = trial.recorded
        if said is not None and said.file and self.folder is not None:
            for number, name in live.mark_names.items():
                write_mark(self.folder, said.file, number, name)
        self.message = trial.refusal or (said.sentence if said else "")

    def _take(self, live: Live, said: dict[str, Any]) -> None:
        """An alarm marks its moment in the recording; the journal names it once the file is there."""
        if live.take(said, self.ceilings) and live.takes_marks and self._trial is not None:
            live.add_mark(live.alarm or "")
            self._spawn(self._trial.mark())
        if self._hands is not None and said["state"] == "recording" and self._hands.is_behind(live.cue):
            self._spawn(asyncio.to_thread(self._hands.follow, live.cue))

    async def look_after(self) -> None:
        """What is to be done without anybody's asking, once a second: adopt recordings, judge what waits."""
        if self.folder is None or self.live is not None or self.is_judging:
            return
        self.is_judging = True
        try:
            await asyncio.to_thread(adopt_recordings, self.folder)
            plan = self.agenda
            waits = plan.undecided.file if plan is not None and plan.undecided is not None else None
            if waits is not None and (self.judgement is None or self.judgement.file != waits):
                try:
                    self.judgement = await self.in_worker(judge_recording, self.folder, waits)
                except BrokenProcessPool:
                    self.judgement = unjudged(waits)
        finally:
            self.is_judging = False

    def _spawn(self, work: Any) -> None:
        task: asyncio.Task[None] = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
