"""The bench on which faults happen while all three devices stream, and what each fault must leave behind."""

from __future__ import annotations

import math
import random
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from drivers.device import CaptureControl, Device
from drivers.errors import DeviceError
from drivers.reconnecting import make_device
from drivers.simulators.faults import fault_from_dict
from drivers.simulators.settings import settings_from_dict
from drivers.simulators.simulated_bench import Bench
from recordings.samples import Event, Item, Loss, Samples
from tests.drivers.simulated_qtm import WIRING
from tests.timeout import scaled_timeout

PACE = 10.0  # world seconds of a fault for each second that it lasts on the wall's own bench
STEP_S = 0.1  # world
PATIENCE_S = 15.0  # wall; a bound on failing tests, not an expectation
STREAMS = {"ni": ("/force", "/sync"), "qtm": ("/markers",), "serial": ("/force",)}
LOST_AND_FOUND = ("connection_lost", "connection_restored")


Aftermath = dict[str, list[Item]]
"""What was heard from each device since a fault began."""


@dataclass(frozen=True)
class Case:
    """A fault while all devices stream, its duration [wall s] at the wall's own pace, and what must be seen of it."""

    device: str
    fault: str
    wall_s: float = 0.0
    causes: frozenset[str] = frozenset()
    events: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        return f"{self.device} {self.fault}"


def _case(device: str, fault: str, wall_s: float = 0.0, cause: str = "", events: tuple[str, ...] = ()) -> Case:
    return Case(device, fault, wall_s, frozenset({cause} if cause else ()), events)


CASES = (
    _case("ni", "overrun", cause="overrun"),
    _case("ni", "fifo_overflow", cause="overrun"),
    _case("ni", "transfer_aborted", 0.2, "disconnected", LOST_AND_FOUND),
    _case("ni", "unplug", 0.4, "disconnected", LOST_AND_FOUND),
    _case("ni", "refuse", 0.1),  # who streams already does not notice
    _case("ni", "freeze", 3.0, events=LOST_AND_FOUND),  # the task runs on, and is read on
    _case("qtm", "skip_frames", 0.05, "skipped"),
    _case("qtm", "drop_labels", 0.2, events=("camera_settings_changed", "labels_lost")),
    _case("qtm", "reorder_labels", 0.2, events=("camera_settings_changed",)),
    _case("qtm", "rename_labels", 0.2, events=("camera_settings_changed", "labels_lost")),
    _case("qtm", "half_packet", 0.0, "disconnected", LOST_AND_FOUND),
    _case("qtm", "zero_length", 0.0, "disconnected", LOST_AND_FOUND),
    _case("qtm", "huge_length", 0.0, "disconnected", LOST_AND_FOUND),
    _case("qtm", "unknown_packet", events=("unreadable_packet",)),
    _case("qtm", "unknown_component", 0.05),  # the markers are still read
    _case("qtm", "unknown_event", events=("unreadable_packet",)),
    _case("qtm", "drop_images", 0.05, events=("images_dropped",)),
    _case("qtm", "silent", 3.0, "disconnected", LOST_AND_FOUND),
    _case("qtm", "restart", 0.4, "disconnected", LOST_AND_FOUND),
    _case("qtm", "full", 0.1),  # who streams already does not notice
    _case("qtm", "no_more_data", 0.1, "skipped", ("no_more_data",)),
    _case("qtm", "renumber", events=("numbering_restarted",)),
    _case("serial", "garbage", 0.3, "garbled"),
    _case("serial", "silence", 1.0, events=("silent",)),
    _case("serial", "unplug", 0.4, "disconnected", LOST_AND_FOUND),
)


@dataclass
class Listener:
    """Reads one device in a thread of its own; heard are its items."""

    device: Device
    heard: list[Item] = field(default_factory=list)
    error: DeviceError | None = None
    is_ending: threading.Event = field(default_factory=threading.Event)

    def start(self) -> None:
        self.device.open()
        self._thread = threading.Thread(target=self._listen, name=f"listener of {self.device.name}", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        self.is_ending.set()
        self._thread.join()
        self.device.close()

    def _listen(self) -> None:
        try:
            while not self.is_ending.is_set():
                self.heard += self.device.read(0.05)
        except DeviceError as error:
            self.error = error


class FaultBench:
    """A context manager: within it a long capture runs, and all devices stream.

    The world moves in steps of STEP_S, only while the bench waits for something, so a busy machine makes no difference
    to what the drivers see.
    """

    def __init__(self) -> None:
        settings = {
            "protocol": {"repeats": 1, "static": {"hold_s": 600.0}},
            "operator": {"capture": "remote"},
            "mocap": {"occlusions_per_minute": 0},
            "daq_clock": {"offset_ppm": 0.0, "drift_ppm_per_hour": 0.0},
        }
        self._bench = Bench(settings_from_dict(settings), None, 0)
        self.world = self._bench.world
        self.listeners: dict[str, Listener] = {}

    def __enter__(self) -> FaultBench:
        self._bench.__enter__()
        start_utc_ns, now = self._bench.start_utc_ns, self.world.now

        def clock() -> int:
            return start_utc_ns + int(now() * 1e9)

        for name, options in device_options(self._bench.ports).items():
            self.listeners[name] = Listener(make_device(host_clock=clock, seconds=lambda: now() / PACE, **options))
            self.listeners[name].start()
        mocap = self.listeners["qtm"].device
        assert isinstance(mocap, CaptureControl)
        mocap.start_capture()
        self.wait_for(lambda: all(self.flows(name, 0) for name in STREAMS), "every device streams")
        return self

    def __exit__(self, *_: object) -> None:
        for listener in self.listeners.values():
            listener.stop()
        self._bench.__exit__(None, None, None)

    def flows(self, device: str, since: int) -> bool:
        """Whether every stream of the device delivered since so many items were heard."""
        items = self.listeners[device].heard[since:]
        return {item.stream for item in items if isinstance(item, Samples)} >= set(STREAMS[device])

    def suffer(self, case: Case) -> Aftermath:
        """Lets the fault happen, and waits until it was seen and the device streams as before; what was heard since."""
        before = {name: len(listener.heard) for name, listener in self.listeners.items()}
        listener = self.listeners[case.device]
        for_s = case.wall_s * PACE
        self.world.faults.inject(fault_from_dict({"device": case.device, "fault": case.fault, "for_s": for_s}))
        over = self.world.now() + for_s

        def is_seen() -> bool:
            items = listener.heard[before[case.device] :]
            return _causes(items) >= case.causes and _kinds(items) >= set(case.events)

        if for_s and "connection_lost" in case.events:
            self.wait_for(
                lambda: "connection_lost" in _kinds(listener.heard[before[case.device] :]),
                f"the connection is lost by {case.name}",
                until=over - STEP_S,
            )
        self.wait_for(lambda: self.world.now() > over, f"{case.name} is over")
        self.wait_for(is_seen, f"{case.name} is seen")
        since = len(listener.heard)
        self.wait_for(lambda: self.flows(case.device, since), f"the device streams after {case.name}; {listener.error}")
        return {name: one.heard[before[name] :] for name, one in self.listeners.items()}

    def suffer_all(self, faults: Sequence[dict[str, Any]]) -> None:
        """Lets them happen as they come, at_s and for_s from now, and waits until every device streams as before."""
        over = self.world.now()
        for fault in faults:
            self.world.faults.inject(fault_from_dict(fault))
            over = max(over, self.world.now() + fault["at_s"] + fault["for_s"])
        self.wait_for(lambda: self.world.now() > over, "the faults are over")
        since = {name: len(listener.heard) for name, listener in self.listeners.items()}
        self.wait_for(lambda: all(self.flows(name, since[name]) for name in STREAMS), "every device streams again")

    def wait_for(self, claim: Callable[[], bool], what: str, until: float = math.inf) -> None:
        """Returns once the claim holds; meanwhile the world moves, up to until [world s] at the most."""
        give_up_s = time.perf_counter() + scaled_timeout(PATIENCE_S)
        while not claim():
            assert time.perf_counter() < give_up_s, f"waited in vain: {what}"
            if self.world.now() + STEP_S <= until:
                self._bench.clock.advance(STEP_S)
            time.sleep(STEP_S / PACE)


def device_options(ports: Mapping[str, int]) -> dict[str, dict[str, Any]]:
    """What make_device() wants to know for each device of a bench, but the clock."""
    return {
        "ni": {"source": "nidaq", **WIRING, "grpc_target": f"127.0.0.1:{ports['ni']}"},
        "qtm": {"source": "qualisys", "host": "127.0.0.1", "port": ports["qtm"], "control": "start"},
        "serial": {
            "source": "serial_load_cell",
            "port": f"socket://127.0.0.1:{ports['serial']}",
            "baud_rate": 9600,
            "line_format": "usb220",
        },
    }


def random_faults(seed: int, count: int) -> list[dict[str, Any]]:
    """So many faults within a minute of the world, at random moments, many of them at once."""
    chance = random.Random(seed)  # noqa: S311
    faults = [
        {"device": case.device, "fault": case.fault, "at_s": chance.uniform(0, 60), "for_s": chance.uniform(0, 15)}
        for case in chance.choices(CASES, k=count)
    ]
    return sorted(faults, key=lambda fault: fault["at_s"])


def unaccounted(items: list[Item], stream: str) -> list[tuple[int, int]]:
    """Where the numbers of what was received and what was counted as lost do not meet: (expected, found)."""
    expected: int | None = None
    breaks = []
    for item in items:
        if isinstance(item, Event) and item.kind in ("numbering_restarted", "capture_replaced"):
            expected = None
        if not isinstance(item, Samples | Loss) or item.stream != stream:
            continue
        parts = (
            [(int(number), 1) for number in item.sample_numbers]
            if isinstance(item, Samples)
            else [(item.first_missing, item.count)]
        )
        for first, count in parts:
            if expected is not None and first != expected:
                breaks.append((expected, first))
            expected = first + count
    return breaks


def _causes(items: list[Item]) -> set[str]:
    return {item.cause for item in items if isinstance(item, Loss)}


def _kinds(items: list[Item]) -> set[str]:
    return {item.kind for item in items if isinstance(item, Event)}
