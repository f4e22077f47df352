"""What is typed while the devices are simulated: `ni unplug for_s=2`, a fault, or `hang 2`, a known mass."""

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


def typed_fault(line: str) -> Fault:
    """Device, fault, and keys of a fault plan with their values. Raises ValueError in one sentence."""
    from drivers.simulators.faults import fault_from_dict

    words = line.split()
    if len(words) < 2:
        raise ValueError(
            f"{line.strip()!r} is no fault, expected a device and its fault, such as `ni unplug for_s=2`, or `hang 2`"
        )
    device, fault, *keys = words
    try:
        given = tomllib.loads("\n".join(keys))
    except tomllib.TOMLDecodeError as error:
        raise ValueError(
            f"{' '.join(keys)!r} is not understood, expected keys of a fault plan such as for_s=2"
        ) from error
    return fault_from_dict({**given, "device": device, "fault": fault})


def typed_mass(line: str) -> float:
    """Kilograms after `hang`. Raises ValueError in one sentence."""
    _, *words = line.split()
    try:
        mass = float(words[0]) if len(words) == 1 else math.nan
    except ValueError:
        mass = math.nan
    if not 0 <= mass < math.inf:
        raise ValueError(
            f"{line.strip()!r} is not understood, expected kilograms: `hang 2`, or `hang 0`, the empty cell"
        )
    return mass


def handle_command(lines: Iterable[str], world: World, say: Callable[[str], None]) -> None:
    """Carry out each line and answer it in a sentence."""
    for line in lines:
        if not line.strip():
            continue
        try:
            say(_obeyed(line, world))
        except ValueError as error:
            say(str(error))


def _obeyed(line: str, world: World) -> str:
    if line.split(maxsplit=1)[0] == "hang":
        mass = typed_mass(line)
        world.hang(mass)
        return f"{mass:g} kg on the load cell, until the next capture begins"
    fault = typed_fault(line)
    world.faults.inject(fault)
    return f"{fault.fault} of {fault.device} in {fault.at_s:g} s, for {fault.for_s:g} s"


def handle_commands_in_thread(
    lines: Iterable[str] | None, world: World, say: Callable[[str], None]
) -> threading.Thread:
    """A thread that ends with the lines, or where there is nothing to read them from."""

    def listen() -> None:
        try:
            handle_command(lines or (), world, say)
        except (OSError, ValueError):  # a terminal that belongs to somebody else, or a standard input that is closed
            return

    # In the background of a terminal the first read would stop the devices; so it fails instead.
    if hasattr(signal, "SIGTTIN"):
        signal.signal(signal.SIGTTIN, signal.SIG_IGN)
    thread = threading.Thread(target=listen, name="typed faults", daemon=True)
    thread.start()
    return thread
