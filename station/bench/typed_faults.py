"""Faults that somebody types while the devices are simulated, a line each: `ni unplug for_s=2`."""

from __future__ import annotations

import signal
import threading
import tomllib
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from drivers.simulators.faults import Fault, Faults


def typed_fault(line: str) -> Fault:
    """Device, fault, and keys of a fault plan with their values. Raises ValueError in one sentence."""
    from drivers.simulators.faults import fault_from_dict

    words = line.split()
    if len(words) < 2:
        raise ValueError(f"{line.strip()!r} is no fault, expected a device and its fault, such as `ni unplug for_s=2`")
    device, fault, *keys = words
    try:
        given = tomllib.loads("\n".join(keys))
    except tomllib.TOMLDecodeError as error:
        raise ValueError(
            f"{' '.join(keys)!r} is not understood, expected keys of a fault plan such as for_s=2"
        ) from error
    return fault_from_dict({**given, "device": device, "fault": fault})


def obey(lines: Iterable[str], faults: Faults, say: Callable[[str], None]) -> None:
    """Lets happen what the lines say, each from its moment on, and answers each in a sentence."""
    for line in lines:
        if not line.strip():
            continue
        try:
            fault = typed_fault(line)
        except ValueError as error:
            say(str(error))
            continue
        faults.inject(fault)
        say(f"{fault.fault} of {fault.device} in {fault.at_s:g} s, for {fault.for_s:g} s")


def obey_in_a_thread(lines: Iterable[str] | None, faults: Faults, say: Callable[[str], None]) -> threading.Thread:
    """A thread that ends with the lines, or where there is nothing to read them from."""

    def listen() -> None:
        try:
            obey(lines or (), faults, say)
        except (OSError, ValueError):  # a terminal that belongs to somebody else, or a standard input that is closed
            return

    # In the background of a terminal the first read would stop the devices; so it fails instead.
    if hasattr(signal, "SIGTTIN"):
        signal.signal(signal.SIGTTIN, signal.SIG_IGN)
    thread = threading.Thread(target=listen, name="typed faults", daemon=True)
    thread.start()
    return thread
