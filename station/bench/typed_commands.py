"""Commands typed at the simulated devices: `ni unplug for_s=2`, a fault, or `hang 2`, a known mass."""

from __future__ import annotations

import math
import signal
import threading
import tomllib
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from drivers.simulators.faults import Fault
    from drivers.simulators.world import World


def parse_fault(line: str) -> Fault:
    """Device, fault, and keys of a fault plan with their values. Raises ValueError."""
    from drivers.simulators.faults import fault_from_dict

    fields = line.split()
    if len(fields) < 2:
        raise ValueError(
            f"{line.strip()!r} is not a fault, expected a device and its fault, such as `ni unplug for_s=2`, or "
            "`hang 2`"
        )
    device, fault, *keys = fields
    try:
        values = tomllib.loads("\n".join(keys))
    except tomllib.TOMLDecodeError as error:
        raise ValueError(
            f"{' '.join(keys)!r} cannot be parsed, expected keys of a fault plan such as for_s=2"
        ) from error
    return fault_from_dict({**values, "device": device, "fault": fault})


def parse_mass(line: str) -> float:
    """Kilograms after `hang`. Raises ValueError."""
    _, *fields = line.split()
    try:
        mass = float(fields[0]) if len(fields) == 1 else math.nan
    except ValueError:
        mass = math.nan
    if not 0 <= mass < math.inf:
        raise ValueError(
            f"{line.strip()!r} cannot be parsed, expected kilograms: `hang 2`, or `hang 0` for the empty cell"
        )
    return mass


def execute_commands(lines: Iterable[str], world: World, reply: Callable[[str], None]) -> None:
    """Execute every line and reply with one sentence."""
    for line in lines:
        if not line.strip():
            continue
        try:
            reply(_execute(line, world))
        except ValueError as error:
            reply(str(error))


def _execute(line: str, world: World) -> str:
    if line.split(maxsplit=1)[0] == "hang":
        mass = parse_mass(line)
        world.hang(mass)
        return f"{mass:g} kg on the load cell, until the next capture begins"
    fault = parse_fault(line)
    world.faults.inject(fault)
    return f"{fault.fault} of {fault.device} in {fault.at_s:g} s, for {fault.for_s:g} s"


def execute_commands_in_thread(lines: Iterable[str], world: World, reply: Callable[[str], None]) -> None:
    """Execute lines until they end, in a thread."""
    # In the background of a terminal the first read would stop the devices; with the signal ignored it fails instead.
    if hasattr(signal, "SIGTTIN"):
        signal.signal(signal.SIGTTIN, signal.SIG_IGN)
    threading.Thread(target=execute_commands, args=(lines, world, reply), name="typed commands", daemon=True).start()
