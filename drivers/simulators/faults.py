"""Faults of the simulated bench and their times: a plan read from TOML, and faults added while it runs.

A plan is a list of tables; times are world seconds:

    [[faults]]
    device = "ni"        # "ni", "qtm", "serial" or "sync"
    fault = "unplug"     # one of FAULTS
    at_s = 3.0           # after the start of the capture …
    capture = 1          # … of this number; 0: after the start of the world
    for_s = 2.0          # duration; the default is that of FAULTS
    labels = ["cuff_1"]  # for drop_labels and rename_labels; without it the last label
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass
from math import inf
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field, Strict, TypeAdapter, ValidationError, with_config

from documents.plain_data import PlainDataError, read_toml
from documents.validation import NonNegative, Whole, describe_error
from drivers.simulators.errors import SimulatorCode, SimulatorError

FAULTS: Mapping[str, Mapping[str, float]] = {
    "ni": {
        "overrun": 0.0,  # the PC buffer was overwritten (-200279), until the task is stopped and started
        "fifo_overflow": 0.0,  # the on-board FIFO was overwritten (-200361), until the task is stopped and started
        "transfer_aborted": 1.0,  # USB transfer aborted (-50405); the task is dead, no other starts meanwhile
        "unplug": 1.0,  # the device is removed (-200045) and plugged in again; earlier tasks stay dead
        "refuse": 1.0,  # no task starts: reserved by another program (-50103)
        "freeze": 1.0,  # no call is answered
    },
    "qtm": {
        "skip_frames": 0.05,  # frames are exposed, numbered and not sent
        "drop_labels": inf,  # labels are removed from the list, with an event
        "reorder_labels": inf,  # the list is reversed, with an event
        "rename_labels": inf,  # labels become "… (old)", with an event
        "half_packet": 0.0,  # a frame's packet is cut in the middle, the next follows
        "zero_length": 0.0,  # a packet with a length of 0
        "huge_length": 0.0,  # a packet with a length of two billion bytes
        "unknown_packet": 0.0,  # a packet of type 77
        "unknown_component": 0.05,  # frames carry a component of type 99 before the markers
        "unknown_event": 0.0,  # event 200
        "drop_images": 0.05,  # frames report 5 % of the cameras' images as dropped and 2 % as out of synchronisation
        "silent": 1.0,  # the connection stays open, nothing is sent, no command is answered
        "restart": 1.0,  # every connection is closed and the port refuses; the capture continues
        "renumber": 0.0,  # frame numbers and time stamps start again
        "full": 1.0,  # new clients get the answer that ten are connected
        "no_more_data": 1.0,  # announces no more data and sends no frames
    },
    "serial": {
        "garbage": 0.5,  # lines are garbled
        "silence": 0.5,  # no lines
        "unplug": 1.0,  # closes every connection at once
    },
    "sync": {
        "glitch": 0.003,  # the line is at the other level
        "early_edge": 0.1,  # the line rises for_s before the first frame is exposed; at_s is ignored
        "double_edge": 0.05,  # the line falls back, to rise a second time
        "no_stop_edge": inf,  # the line stays high after the end of the capture; at_s is ignored
        "wrong_polarity": inf,  # the line is low where it should be high
    },
}
"""Default duration by device and fault [world s]; 0: an instant."""

INVERSIONS = ("glitch", "double_edge", "wrong_polarity")


@with_config(ConfigDict(extra="forbid"))
@dataclass(frozen=True)
class Fault:
    """One entry of a plan, as the module's first lines describe it. Raises ValueError for one that its device lacks."""

    device: Literal["ni", "qtm", "serial", "sync"]
    fault: str
    at_s: NonNegative
    for_s: Annotated[float, Strict(), Field(ge=0)]
    capture: Annotated[Whole, Field(ge=0)] = 1
    labels: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.device not in FAULTS:
            raise ValueError(f"{self.device!r} is not a device with faults; those are {', '.join(FAULTS)}")
        if self.fault not in FAULTS[self.device]:
            raise ValueError(f"{self.device} has no fault {self.fault!r}; it has {', '.join(FAULTS[self.device])}")


@dataclass(frozen=True)
class Happening:
    """A fault with its times: [begin, end) in world seconds."""

    fault: Fault
    begin: float
    end: float


def fault_from_dict(data: Any) -> Fault:
    """One entry of a plan. Raises SimulatorError in one sentence that names the key and the value."""
    if not isinstance(data, dict):
        raise SimulatorError(f"a fault is {data!r}, expected a table with device and fault", SimulatorCode.WRONG_FAULT)
    duration = FAULTS.get(str(data.get("device")), {}).get(str(data.get("fault")), 0.0)
    try:
        return TypeAdapter(Fault).validate_python({"at_s": 0.0, "for_s": duration, **data})
    except ValidationError as error:
        raise SimulatorError(
            f"fault {data.get('fault')} of {data.get('device')}: {describe_error(error)}", SimulatorCode.WRONG_FAULT
        ) from error


def read_fault_plan(path: Path) -> tuple[Fault, ...]:
    """The plan in a TOML file. Raises SimulatorError in one sentence that names file, key and value."""
    try:
        content = read_toml(path)
    except OSError as error:
        raise SimulatorError(
            f"the fault plan {path} cannot be read: {error.strerror or error}", SimulatorCode.WRONG_FAULT_PLAN
        ) from error
    except PlainDataError as error:
        raise SimulatorError(
            f"the fault plan {path} cannot be used: it {' '.join(str(error).split())}", SimulatorCode.WRONG_FAULT_PLAN
        ) from error
    entries = content.pop("faults", [])
    if content or not isinstance(entries, list):
        raise SimulatorError(
            f"the fault plan {path} cannot be used: expected a list of [[faults]] and nothing else",
            SimulatorCode.WRONG_FAULT_PLAN,
        )
    try:
        return tuple(fault_from_dict(entry) for entry in entries)
    except ValueError as error:
        raise SimulatorError(
            f"the fault plan {path} cannot be used: {error}", SimulatorCode.WRONG_FAULT_PLAN
        ) from error


class Faults:
    """The faults of the plan in world time. Thread-safe; results do not depend on earlier queries."""

    def __init__(self, now: Callable[[], float], plan: Iterable[Fault] = ()) -> None:
        self._now = now
        self._lock = threading.Lock()
        self._waiting = [fault for fault in plan if fault.capture > 0]
        self._happenings = tuple(_happening(fault, 0.0) for fault in plan if fault.capture == 0)

    def now(self) -> float:
        """World time [s]; a reader that advances in steps of this clock sees every injected fault."""
        with self._lock:
            return self._now()

    def inject(self, fault: Fault) -> dict[str, Any]:
        """Start the fault at_s from now, independent of its capture; returns it as plain data."""
        with self._lock:
            self._happenings = (*self._happenings, _happening(fault, self._now()))
        return asdict(fault)

    def capture_started(self, number: int, start: float) -> None:
        """Set the times of the faults of this capture."""
        with self._lock:
            due = [fault for fault in self._waiting if fault.capture == number]
            self._waiting = [fault for fault in self._waiting if fault.capture != number]
            self._happenings = (*self._happenings, *(_happening(fault, start) for fault in due))

    def active(self, device: str, kind: str, at: float | None = None) -> Fault | None:
        """The fault of this kind that is active at a world time, by default now."""
        moment = self._now() if at is None else at
        for one in self.of(device, kind):
            if one.begin <= moment < one.end:
                return one.fault
        return None

    def has_begun(self, device: str, kind: str, since: float) -> bool:
        """Whether a fault of that kind began after the world time since, and up to now."""
        now = self._now()
        return any(since < one.begin <= now for one in self.of(device, kind))

    def of(self, device: str, *kinds: str) -> list[Happening]:
        """All faults of these kinds, by default of any, with a known time."""
        known = (one for one in self._happenings if one.fault.device == device)
        return [one for one in known if not kinds or one.fault.fault in kinds]


def _happening(fault: Fault, origin: float) -> Happening:
    return Happening(fault, origin + fault.at_s, origin + fault.at_s + fault.for_s)
