"""The simulated DAQ server in a world whose time the test moves, unless its module has another world."""

from collections.abc import Iterator

import pytest

from drivers import lsl, nidaq, qualisys
from drivers.simulators.daq_rpcs import NiDaqSimulator
from tests.drivers.simulated_qtm import EXACT_CLOCK
from tests.drivers.stand_in_world import StandInWorld
from tests.timeout import scaled_timeout


@pytest.fixture(autouse=True, scope="module")
def patient_drivers() -> Iterator[None]:
    """A busy machine holds up a test, and the device simulated in it, for longer than a driver waits for an answer.

    A test of a device that does not answer shortens the time-out itself, once the device is open.
    """
    with pytest.MonkeyPatch.context() as patch:
        for driver, name in (
            (nidaq, "CONNECT_TIMEOUT_S"),
            (nidaq, "RPC_DEADLINE_S"),
            (qualisys, "CONNECT_TIMEOUT_S"),
            (qualisys, "COMMAND_TIMEOUT_S"),
            (lsl, "CONNECT_TIMEOUT_S"),
            (lsl, "RESOLVE_TIMEOUT_S"),
        ):
            patch.setattr(driver, name, scaled_timeout(20.0))
        yield


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
