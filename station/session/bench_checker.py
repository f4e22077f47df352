"""The check of the bench before a session: once for all pages, with readings of the empty cell and of known masses."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

from fitting.trial.mass_checks import MassCheck
from station.bench.check import CheckResult, inspect_bench_and_zero, read_known_mass, write_reading
from station.messages.codes import CheckCode
from station.messages.message import Message
from station.session.judgement import Grade
from station.session.open_session import OpenSession

VALID_S = 1800.0
"""Wall seconds after which the bench is checked again."""
_UNREAD = CheckResult("known mass", Message(CheckCode.MASS_UNREAD), is_good=True, is_doubtful=True)


class BenchChecker:
    """in_worker runs a function in the worker process; is_running while it reads the devices."""

    def __init__(self, session: OpenSession, in_worker: Callable[..., Awaitable[Any]]) -> None:
        self._session, self._in_worker = session, in_worker
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
        check, result = await self._in_worker(read_known_mass, config, config.session.folder, mass_kg, self._zero)
        self._readings += [reading for reading in (self._zero, check) if reading and reading not in self._readings]
        self._masses[mass_kg] = result

    def write_readings(self, folder: Path) -> None:
        """Move the readings into the folder of the session that begins. Raises JournalError."""
        while self._readings:
            write_reading(folder, self._readings[0])
            del self._readings[0]

    async def _check(self) -> None:
        config = self._session.config
        self._found, self._zero = await self._in_worker(inspect_bench_and_zero, config, config.session.folder)
        self._masses, self._checked_s = {}, time.perf_counter()
