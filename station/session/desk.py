"""One session, its running trial and its review, which every open page shows and any of them may command.

All of it runs in the thread of the event loop. What takes long (recording, fitting) is done by other processes, so that
no page can slow the recorder and no fit a page.
"""

from __future__ import annotations

from station.bench.simulation import SimulatedBench
from station.config import StationConfig
from station.session.open_session import OpenSession
from station.session.reviewer import Reviewer
from station.session.trial_runner import TrialRunner


class Desk:
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
        self.session = OpenSession(config, speed, clock_port if bench is None else bench.clock_port)
        self.runner = TrialRunner(self.session, bench)
        self.reviewer = Reviewer(self.session)

    def close(self) -> None:
        """The console ends; a running trial goes on to its end by itself."""
        self.runner.close()
        self.reviewer.close()
