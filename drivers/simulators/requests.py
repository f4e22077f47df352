"""Requests to the simulated bench as plain data, received by its process or over its clock's port.

    {"trial": {"cuff": "hand", "test": "static"}}   sets that trial up, for this and the following captures
    {"trial": {"cuff": null, "test": "bounce"}}     the weight on its spring, where the settings have one
    {"don": "hand"}                                 dons the cuff anew
    {"hang_kg": 2}                                  hangs a known mass from the load cell until the next capture begins
    {"step": 2}                                     the page is at this step, and the hands follow (operator.hands)
    {"pause_s": 60}                                 answers when so many seconds of the world have passed
    {"fault": {"device": "ni", "fault": "unplug"}}  goes wrong now, or at_s from now (faults.py)
    {"truth": true}                                 parameters by cuff, and what each has slipped since it was donned
    {"ports": true}                                 where the devices answer, by name
    {"speed": 3}                                    world seconds per wall second at the most; null: as fast as handled
    {"pace": true}                                  its speed, and the rate of late

Every answer carries "now", the world time [s] at which the request took effect.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from typing import Any, Protocol

from drivers.simulators.faults import fault_from_dict
from drivers.simulators.world import World
from drivers.simulators.world_clock import WorldClock

KNOWN = ("trial", "don", "hang_kg", "step", "fault", "pause_s", "truth", "ports", "speed", "pace", "quit")


class ServedBench(Protocol):
    """Parts of the bench that a request can change."""

    world: World
    clock: WorldClock
    start_utc_ns: int
    ports: dict[str, int]

    def sent(self) -> dict[str, dict[int, int | None]]: ...

    def pending(self) -> list[str]: ...


def answer(bench: ServedBench, request: dict[str, Any]) -> dict[str, Any]:
    """The answer to one request. Raises ValueError in one sentence where it cannot be met, ClockStopped at the end."""
    content = _answer(bench, request)
    return {**content, "now": bench.clock.now()}


def _answer(bench: ServedBench, request: dict[str, Any]) -> dict[str, Any]:
    world, clock = bench.world, bench.clock
    match request:
        case {"trial": {"cuff": str() | None as cuff, "test": "static" | "dynamic" | "bounce" as test}}:
            content: dict[str, Any] = {"trial": asdict(world.select_trial(cuff, test))}
        case {"don": str(cuff)}:
            content = {"trial": asdict(world.don(cuff))}
        case {"hang_kg": mass}:
            world.hang(_mass_from(mass))
            content = {"hang_kg": mass}
        case {"step": int(step)}:
            world.follow(step)
            content = {"step": step}
        case {"ports": True}:
            content = {"ports": bench.ports}
        case {"pause_s": seconds}:
            clock.advance(seconds_from("pause_s", seconds))
            content = {"pause_s": seconds}
        case {"fault": dict(fault)}:
            content = {"fault": world.faults.inject(fault_from_dict(fault))}
        case {"truth": True}:
            content = {"truth": world.truth()}
        case {"speed": speed}:
            clock.speed = speed_from(speed)
            content = {"speed": clock.speed}
        case {"pace": True}:
            content = {"speed": clock.speed, "rate": clock.rate()}
        case {"quit": True}:
            content = {"quit": True}
        case _:
            raise ValueError(f"no request is {json.dumps(request)}; known are {', '.join(KNOWN)}")
    return content


def seconds_from(key: str, value: Any) -> float:
    """Raises ValueError where the value is no time."""
    if isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value < math.inf:
        return float(value)
    raise ValueError(f"{key} is {value!r}, expected seconds from 0")


def _mass_from(value: Any) -> float:
    if isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value < math.inf:
        return float(value)
    raise ValueError(f"hang_kg is {value!r}, expected kilograms from 0")


def speed_from(value: Any) -> float | None:
    """Raises ValueError where the value is no speed."""
    if value is None:
        return None
    if isinstance(value, int | float) and not isinstance(value, bool) and 0 < value < math.inf:
        return float(value)
    raise ValueError(f"the speed is {value!r}, expected a number above 0, or null for as fast as it is handled")
