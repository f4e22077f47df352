"""A fixture for pytest: the simulated bench, for the tests of any laboratory's own recorder.

    def test_my_recorder_survives_a_pulled_cable(simulated_bench):
        bench = simulated_bench(faults=[{"device": "ni", "fault": "unplug", "at_s": 3, "for_s": 2}])
        recorder = MyRecorder(ni=f"127.0.0.1:{bench.ports['ni']}", qtm=bench.ports["qtm"])
        for _ in range(100):
            bench.clock.advance(0.1)  # 0.1 s of the world, with all that the devices send in it
            recorder.read_everything()

The world stands still until clock.advance() moves it, so that the test gives the same result on any machine, however
busy. A recorder in another process or language does the same over the port bench.ports["clock"] (simulated_bench.py).
For one that cannot, simulated_bench(speed=1) keeps the pace of the wall clock, at most; such a run is not reproducible.

Faults are those of faults.py; further settings are sections of settings.py, as in mocap={"has_preview": True}. While it
runs, bench.world starts captures, and bench.world.faults.inject(fault_from_dict({...})) starts a fault now.

pytest loads this module in every run where cuffstation is installed. It imports nothing else of ours before the fixture
is used, because a project may have a file drivers.py or station.py of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

import pytest

from cuffstation import _ensure_own_packages

if TYPE_CHECKING:
    from drivers.simulators.simulated_bench import Bench


@pytest.fixture
def simulated_bench() -> Iterator[Callable[..., Bench]]:
    """Starts a bench each time it is called with (speed, seed, faults, **settings); all end with the test.

    Raises SimulatorError in one sentence where a fault or a setting cannot be used.
    """
    _ensure_own_packages()
    # Imported when asked for: physics and gRPC are slow to import.
    from drivers.simulators.faults import fault_from_dict
    from drivers.simulators.settings import settings_from_dict
    from drivers.simulators.simulated_bench import Bench

    with ExitStack() as running:

        def start(
            speed: float | None = None, seed: int = 0, faults: Sequence[dict[str, Any]] = (), **settings: Any
        ) -> Bench:
            plan = [fault_from_dict(fault) for fault in faults]
            return running.enter_context(Bench(settings_from_dict(settings), speed, seed, plan))

        yield start
