"""The simulated DAQ server in a world whose time the test moves, unless its module has another world."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from drivers.simulators.daq_rpcs import NiDaqSimulator
from tests.drivers.simulated_qtm import EXACT_CLOCK
from tests.drivers.stand_in_world import StandInWorld


@pytest.fixture
def world() -> StandInWorld:
    return StandInWorld(is_standing=True)


@pytest.fixture
def server(world: StandInWorld) -> Iterator[NiDaqSimulator]:
    server = NiDaqSimulator(world, clock=EXACT_CLOCK)
    server.start()
    yield server
    world.flows.set()
    server.stop()
