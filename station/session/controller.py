"""One session, its running trial and its review, shared by all open pages or used by the terminal.

All of it runs in the thread of the event loop. Recording and fitting run in other processes, so that no page can slow
the recorder and no fit can slow a page.
"""

from __future__ import annotations

from station.bench.simulation import SimulatedBench
from station.config import StationConfig
from station.session.adoption import is_being_recorded
from station.session.bench_checker import BenchChecker
from station.session.listing import list_sessions
from station.session.open_session import OpenSession
from station.session.reviewer import Reviewer
from station.session.trial_runner import TrialRunner


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

    def close(self) -> None:
        """End the console; a running trial continues to its end."""
        self.runner.close()
        self.reviewer.close()
