"""One session: its check of the bench, running trial and review, shared by all open pages or used by the terminal.

All of it runs in the thread of the event loop. Recording and fitting run in other processes, so that no page can slow
the recorder and no fit can slow a page. The bench is checked once for all pages, with readings of the empty cell and of
known masses.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

from documents.message import Message
from fitting.trial.mass_checks import MassCheck
from station.bench.bench_clock import BenchClock
from station.bench.check import CheckResult, inspect_bench_and_zero, read_known_mass, write_reading
from station.bench.simulation import SimulatedBench
from station.clock import RealClock
from station.config import StationConfig
from station.journal import JournalError
from station.messages.bench_messages import CheckCode
from station.session.judgement import Grade
from station.session.open_session import OpenSession, list_sessions
from station.session.reviewer import Reviewer, is_being_recorded
from station.session.trial_runner import TrialRunner

VALID_S = 1800.0
"""Wall seconds after which the bench is checked again."""
_UNREAD = CheckResult("known mass", Message(CheckCode.MASS_UNREAD), is_good=True, is_doubtful=True)


class SessionController:
    def __init__(
        self,
        config: StationConfig,
        speed: float | None = 1.0,
        bench: SimulatedBench | None = None,
        clock_port: int | None = None,
    ) -> None:
        """bench: own simulated devices; clock_port: the clock of a simulated bench in another process.

        speed is the pace of either; None: as fast as the station handles it.
        """
        self.session = OpenSession(config, speed, clock_port if bench is None else bench.clock_port)
        self.runner = TrialRunner(self.session, bench)
        self.reviewer = Reviewer(self.session)
        self.checker = BenchChecker(self.session, self.reviewer.in_worker)

    async def prepare(self) -> None:
        """Return to a trial that is still recorded, check the bench, and import the fit for the first verdict."""
        self.resume_recorded()
        await self.checker.wait()
        await self.reviewer.warm_up()

    def resume_recorded(self) -> None:
        """Resume the session in which the recorder of a killed console records a trial, if there is one."""
        for listed in list_sessions(self.session.config.session.folder):
            if is_being_recorded(listed.folder):
                self.session.resume(listed.folder)
                self.session.is_recorded_elsewhere = True
                return

    async def process_recordings(self) -> None:
        """As the reviewer does. A session whose folder is gone, or cannot be read or written, is closed."""
        try:
            await self.reviewer.process_recordings()
        except JournalError as error:
            self.session.abandon(str(error))

    def close(self) -> None:
        """End the console; a running trial continues to its end."""
        self.runner.close()
        self.reviewer.close()


class BenchChecker:
    """in_worker runs a function in the worker process; is_running while it reads the devices."""

    def __init__(self, session: OpenSession, in_worker: Callable[..., Awaitable[Any]]) -> None:
        self._session, self._in_worker = session, in_worker
        self._timeout_scale = RealClock().timeout_scale if session.clock_port is None else BenchClock.timeout_scale
        self._found: list[CheckResult] = []
        self._masses: dict[float, CheckResult] = {}
        self._readings: list[MassCheck] = []
        self._zero: MassCheck | None = None
        self._checked_s = 0.0
        self._task: asyncio.Task[None] | None = None

    @property
    def is_running(self) -> bool:
        return self._task is not None and not self._task.done()

    @property
    def results(self) -> tuple[CheckResult, ...]:
        """The worst first; empty before the first check."""
        if not self._found:
            return ()
        masses = list(self._masses.values()) or [_UNREAD]
        return tuple(sorted((*self._found, *masses), key=lambda result: (result.is_good, not result.is_doubtful)))

    @property
    def grade(self) -> Grade | None:
        """Of the worst result; None before the first check."""
        return self.results[0].grade if self.results else None

    def ensure_started(self) -> None:
        """Check the bench unless that was done in the last VALID_S or is being done."""
        if not self.is_running and (not self._found or time.perf_counter() - self._checked_s > VALID_S):
            self._task = asyncio.get_running_loop().create_task(self._check())

    async def check(self) -> None:
        """Check the bench with the empty cell. Raises CommandRefused while a trial runs."""
        self._session.refuse_while_running()
        if not self.is_running:
            self._found = []
        await self.wait()

    async def wait(self) -> None:
        """Return once the bench is checked."""
        self.ensure_started()
        if self._task is not None:
            await asyncio.shield(self._task)

    async def read_mass(self, mass_kg: float) -> None:
        """Read a known mass on the cell, above the reading of the empty cell. Raises CommandRefused, MassCheckError."""
        self._session.refuse_while_running()
        await self.wait()
        config = self._session.config
        reading = (config, config.session.folder, mass_kg, self._zero, self._timeout_scale)
        check, result = await self._in_worker(read_known_mass, *reading)
        self._readings += [reading for reading in (self._zero, check) if reading and reading not in self._readings]
        self._masses[mass_kg] = result

    def write_readings(self, folder: Path) -> None:
        """Move the readings into the folder of the session that begins. Raises JournalError."""
        while self._readings:
            write_reading(folder, self._readings[0])
            del self._readings[0]

    async def _check(self) -> None:
        config = self._session.config
        self._found, self._zero = await self._in_worker(
            inspect_bench_and_zero, config, config.session.folder, self._timeout_scale
        )
        self._masses, self._checked_s = {}, time.perf_counter()
