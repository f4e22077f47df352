"""Requests to the simulated bench as plain data, from the process that started it or over its clock's port.

    {"trial": {"cuff": "hand", "test": "static"}}   sets that trial up, for this and the following captures
    {"trial": {"cuff": null, "test": "bounce"}}     the weight on its spring, where the settings have one
    {"trial": {"cuff": null, "test": "motion", "condition": "tight"}}   a person's pose or motion, if set
    {"don": "hand"}                                 dons the cuff again
    {"hang_kg": 2}                                  hangs a known mass from the load cell until the next capture begins
    {"capture": false}                              ends a capture that runs, as one that a killed station left
    {"step": 2}                                     the console is at this step, and the hands follow (operator.hands)
    {"pause_s": 60}                                 answers after pause_s world seconds
    {"fault": {"device": "ni", "fault": "unplug"}}  starts now, or at_s from now (faults.py)
    {"truth": true}                                 parameters of every cuff, and its slip since it was donned
    {"ports": true}                                 ports of the devices, by name
    {"speed": 3}                                    world seconds per wall second at most; null: without a limit
    {"pace": true}                                  its speed, and the recent rate

Every answer carries "now", the world time [s] at which the request took effect.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from typing import Any, Protocol, cast, get_args

from drivers.simulators.errors import SimulatorCode, SimulatorError, refusal
from drivers.simulators.faults import fault_from_dict
from drivers.simulators.wearer import Worn
from drivers.simulators.world import SimulatedTrial, TestKind, World
from drivers.simulators.world_clock import ClockStopped, WorldClock

KNOWN = ("trial", "don", "hang_kg", "capture", "step", "fault", "pause_s", "truth", "ports", "speed", "pace")


class ServedBench(Protocol):
    """Parts of the bench that a request can change."""

    world: World
    clock: WorldClock
    start_utc_ns: int
    ports: dict[str, int]

    def sent(self) -> dict[str, dict[int, int | None]]: ...

    def pending(self) -> list[str]: ...


def answer(bench: ServedBench, request: dict[str, Any]) -> dict[str, Any]:
    """Answer to one request. Raises SimulatorError for a refusal, ClockStopped once the world has ended."""
    content = _answer(bench, request)
    return {**content, "now": bench.clock.now()}


def answer_or_refusal(bench: ServedBench, request: dict[str, Any] | str) -> dict[str, Any]:
    """Answer to one request or line of JSON, or "error" and "code" of its refusal."""
    try:
        return answer(bench, request_from_json(request) if isinstance(request, str) else request)
    except (ValueError, RecursionError, ClockStopped) as error:
        return dict(refusal(error))


def request_from_json(line: str | bytes) -> dict[str, Any]:
    """Raises SimulatorError or RecursionError if the line is not a JSON object."""
    try:
        request = json.loads(line)
    except ValueError:
        request = None
    if not isinstance(request, dict):
        raise SimulatorError(f"expected a JSON object on one line, found {line!r}", SimulatorCode.WRONG_REQUEST)
    return request


def _answer(bench: ServedBench, request: dict[str, Any]) -> dict[str, Any]:
    world = bench.world
    match request:
        case {"trial": dict(trial)}:
            content: dict[str, Any] = {"trial": asdict(_set_up(world, trial))}
        case {"don": str(cuff)}:
            content = {"trial": asdict(world.don(cuff))}
        case {"hang_kg": mass}:
            world.hang(_mass_from(mass))
            content = {"hang_kg": mass}
        case {"capture": False}:
            content = {"was_running": world.ensure_no_capture()}
        case {"step": int(step)}:
            world.follow(step)
            content = {"step": step}
        case {"ports": True}:
            content = {"ports": bench.ports}
        case {"fault": dict(fault)}:
            content = {"fault": world.faults.inject(fault_from_dict(fault))}
        case {"truth": True}:
            content = {"truth": world.truth()}
        case _:
            content = _answer_of_clock(bench.clock, request)
    return content


def _answer_of_clock(clock: WorldClock, request: dict[str, Any]) -> dict[str, Any]:
    match request:
        case {"pause_s": seconds}:
            clock.advance(seconds_from("pause_s", seconds))
            content: dict[str, Any] = {"pause_s": seconds}
        case {"speed": speed}:
            clock.speed = speed_from(speed)
            content = {"speed": clock.speed}
        case {"pace": True}:
            content = {"speed": clock.speed, "rate": clock.rate()}
        case _:
            raise SimulatorError(
                f"no request is {json.dumps(request)}; known are {', '.join(KNOWN)}", SimulatorCode.WRONG_REQUEST
            )
    return content


def _set_up(world: World, trial: dict[str, Any]) -> SimulatedTrial:
    cuff, test, worn = trial.get("cuff"), str(trial.get("test")), trial.get("condition")
    is_known = test in get_args(TestKind) and (worn is None or worn in get_args(Worn))
    if not is_known or not isinstance(cuff, str | None) or trial.keys() - {"cuff", "test", "condition"}:
        raise SimulatorError(
            f"no trial is {json.dumps(trial)}; tests are {', '.join(get_args(TestKind))}, conditions "
            f"{', '.join(get_args(Worn))}",
            SimulatorCode.UNKNOWN_TRIAL,
        )
    return world.select_trial(cuff, cast(TestKind, test), worn)


def seconds_from(key: str, value: Any) -> float:
    """Raises SimulatorError if the value is not a time."""
    if isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value < math.inf:
        return float(value)
    raise SimulatorError(f"{key} is {value!r}, expected seconds from 0", SimulatorCode.WRONG_VALUE)


def _mass_from(value: Any) -> float:
    if isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value < math.inf:
        return float(value)
    raise SimulatorError(f"hang_kg is {value!r}, expected kilograms from 0", SimulatorCode.WRONG_VALUE)


def speed_from(value: Any) -> float | None:
    """Raises SimulatorError if the value is not a speed."""
    if value is None:
        return None
    if isinstance(value, int | float) and not isinstance(value, bool) and 0 < value < math.inf:
        return float(value)
    raise SimulatorError(
        f"the speed is {value!r}, expected a number above 0, or null for as fast as it is handled",
        SimulatorCode.WRONG_VALUE,
    )
