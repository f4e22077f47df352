"""The trial that runs in its own process: start, marks, alarms, stop."""

from __future__ import annotations

import asyncio
from typing import Any

from station.bench.simulation import SimulatedBench
from station.journal import write_mark
from station.session.guide import ceilings_of, guide_for
from station.session.live import Live
from station.session.open_session import CommandRefused, OpenSession
from station.session.simulated_hands import SimulatedHands
from station.session.trial_process import TrialProcess


class TrialRunner:
    """Raises CommandRefused, JournalError, SimulationError: one sentence, for the page that asked.

    live is the running trial, ended the one before, with its result or its refusal.
    """

    def __init__(self, session: OpenSession, bench: SimulatedBench | None) -> None:
        self._session = session
        self.live: Live | None = None
        self.ended: TrialProcess | None = None
        self.ceilings = ceilings_of(session.config)
        self._trial: TrialProcess | None = None
        self._tasks: set[asyncio.Task[None]] = set()
        self._hands = SimulatedHands(bench, session.config.protocol.pause_s) if bench is not None else None

    async def arm(self) -> None:
        """Starts the recorder for the next trial of the plan."""
        self._session.refuse_while_running()
        plan = self._session.agenda
        if plan is None or self._session.folder is None:
            raise CommandRefused("no session is open; set one up first")
        spec = self._session.next_spec(plan)
        self._session.message, self._session.judgement = "", None
        self.live = Live(spec, guide_for(spec.test, self._session.trial_config.protocol))
        self._session.has_running_trial = True
        try:
            if self._hands is not None:
                await asyncio.to_thread(self._hands.prepare, plan)
            self._trial = await TrialProcess.start(
                self._session.trial_config, self._session.folder, spec, self._session.clock_port, self._session.speed
            )
        except BaseException:
            self.live, self._session.has_running_trial = None, False
            raise
        self._spawn(self._follow(self._trial))

    async def stop(self) -> None:
        """Once: the trial ends cleanly; twice: at once. While it is armed this cancels it."""
        if self._trial is None:
            raise CommandRefused("no trial is running")
        await self._trial.stop()

    async def end_early(self) -> None:
        """The session ends with what exists; a running trial is ended cleanly first, its recording counts."""
        if self._session.folder is None:
            raise CommandRefused("no session is open")
        self._session.is_ending = True
        if self._trial is not None:
            await self._trial.stop()

    async def mark(self) -> None:
        """Marks this moment in the recording, to be named later."""
        if self._trial is None or self.live is None:
            raise CommandRefused("no trial is running: there is nothing to mark")
        if not self.live.takes_marks:
            raise CommandRefused("nothing is recorded yet: marks count from the sync edge on")
        self.live.add_mark()
        await self._trial.mark()

    def note(self, number: int, name: str) -> None:
        """What a mark of the running trial was; the journal has it when the trial's file is there."""
        if self.live is None or number not in self.live.marks:
            raise CommandRefused(f"mark {number} is none of the running trial; name it with the verdict")
        self.live.mark_names[number] = name.strip()

    def tare(self) -> None:
        if self.live is None or not self.live.force:
            raise CommandRefused("no force yet: there is nothing to tare")
        self.live.tare()

    def silence(self) -> None:
        """Somebody has seen the alarm: it is not sounded any more, and goes with its cause."""
        if self.live is not None:
            self.live.is_alarm_seen = self.live.alarm is not None

    async def _follow(self, trial: TrialProcess) -> None:
        live = self.live
        assert live is not None  # noqa: S101  (arm() has just made it)
        try:
            await trial.follow(lambda said: self._take(live, said))
        finally:
            self.live, self._trial, self.ended = None, None, trial
            self._session.has_running_trial = False
        said = trial.recorded
        if said is not None and said.file and self._session.folder is not None:
            for number, name in live.mark_names.items():
                write_mark(self._session.folder, said.file, number, name)
        self._session.message = trial.refusal or (said.sentence if said else "")

    def _take(self, live: Live, said: dict[str, Any]) -> None:
        """An alarm marks its moment in the recording; the journal names it once the file is there."""
        if live.take(said, self.ceilings) and live.takes_marks and self._trial is not None:
            live.add_mark(live.alarm or "")
            self._spawn(self._trial.mark())
        if self._hands is not None and said["state"] == "recording" and self._hands.is_behind(live.cue):
            self._spawn(asyncio.to_thread(self._hands.follow, live.cue))

    def _spawn(self, work: Any) -> None:
        task: asyncio.Task[None] = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def close(self) -> None:
        """The console ends; a running trial goes on to its end by itself."""
        for task in self._tasks:
            task.cancel()
