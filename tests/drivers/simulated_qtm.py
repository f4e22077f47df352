"""The driver at the simulated QTM, and what it delivered."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from drivers.device import Device
from drivers.nidaq import AnalogInput, NiDaq
from drivers.qualisys import Qualisys
from drivers.simulators.qtm_server import QualisysSimulator
from drivers.simulators.settings import DaqClockSettings, settings_from_dict
from drivers.simulators.world import World
from recordings.samples import Event, Item
from tests.drivers.contract import blocks, read_until

FORCE, SYNC = AnalogInput("/force", "force", "ai0"), AnalogInput("/sync", "sync", "ai1")
WIRING: dict[str, Any] = {"device": "Dev1", "inputs": (FORCE, SYNC), "sample_rate_hz": 1000.0}
EXACT_CLOCK = DaqClockSettings(offset_ppm=0.0, drift_ppm_per_hour=0.0)


def driver(port: int, **options: Any) -> Qualisys:
    return Qualisys(host="127.0.0.1", port=port, host_clock=time.time_ns, **options)


@contextmanager
def simulator(**mocap: Any) -> Iterator[QualisysSimulator]:
    settings = settings_from_dict({"operator": {"capture": "remote"}, "mocap": mocap})
    with serving(World(settings, speed=30.0)) as qtm:
        yield qtm


@contextmanager
def serving(world: World) -> Iterator[QualisysSimulator]:
    """QTM alone, moved by its world's clock."""
    qtm = QualisysSimulator(world)
    qtm.start()
    world.clock.follow(qtm)
    try:
        yield qtm
    finally:
        world.clock.unfollow(qtm)
        qtm.stop()


def hang_up_on_everyone(qtm: QualisysSimulator) -> None:
    for client in qtm._server.clients:
        qtm._server.loop.call_soon_threadsafe(client.close)


def without_events(items: list[Item]) -> list[Item]:
    return [item for item in items if not isinstance(item, Event)]


def values(items: list[Item]) -> np.ndarray:
    return np.concatenate([block.values for block in blocks(items, "/markers")])


def numbers(items: list[Item]) -> list[int]:
    return [int(n) for block in blocks(items, "/markers") for n in block.sample_numbers]


def joined(items: list[Item], stream: str) -> tuple[np.ndarray, np.ndarray]:
    """Device time [s] (n,) and values (n, …) of everything received."""
    found = blocks(items, stream)
    times = np.concatenate([block.device_time_ns for block in found]) * 1e-9
    return times, np.concatenate([block.values for block in found]).astype(float)


def received(device: Device, frames: int) -> list[Item]:
    return read_until(device, lambda items: len(numbers(items)) >= frames)


@contextmanager
def opened(device: Any) -> Iterator[Any]:
    try:
        device.open()
        yield device
    finally:
        device.close()


def is_event(item: Item, kind: str) -> bool:
    return isinstance(item, Event) and item.kind == kind


# The driver of a DAQ that is wired as the simulated one: force on ai0, sync line on ai1.


def daq(port: int, host_clock: Callable[[], int], **options: Any) -> NiDaq:
    """Not yet opened."""
    return NiDaq(host_clock=host_clock, **{**WIRING, "grpc_target": f"127.0.0.1:{port}", **options})
