"""A trial whose devices are played by hand, by a clock that only the test moves."""

from __future__ import annotations

import numpy as np

from recordings.samples import Event, Item, Samples, Stream
from station.bench.trial_context import TrialRules
from station.bench.trial_state_machine import TrialStateMachine
from station.clock import ManualClock
from station.messages.bench_messages import TrialCode

STREAMS = [Stream(n, "V", (n[1:],), 1000.0, "NI Dev1") for n in ("/force", "/sync")] + [
    Stream("/markers", "mm", ("anchor_1",), 100.0, "QTM 127.0.0.1:22223")
]
BLOCK_S = 0.1


class Writer:
    def __init__(self) -> None:
        self.items: list[Item] = []

    def write(self, item: Item) -> None:
        self.items.append(item)

    def flush_if_due(self) -> None:
        pass

    def samples(self, stream: str) -> list[Samples]:
        return [i for i in self.items if isinstance(i, Samples) and i.stream == stream]

    def events(self) -> list[str]:
        return [i.kind for i in self.items if isinstance(i, Event)]


class Bench:
    """Devices by hand: a DAQ that sends a block every 0.1 station seconds and a mocap that sends while capturing."""

    def __init__(
        self,
        start: str = "sync_edge",
        timeout_s: float = 10.0,
        duration_s: float | None = None,
        force_device: str = "NI Dev1",
        *,
        is_force_needed: bool = True,
    ) -> None:
        self.clock, self.writer, self.force_device = ManualClock(), Writer(), force_device
        rules = TrialRules(start, 2.5, timeout_s, duration_s, is_force_needed=is_force_needed)  # type: ignore[arg-type]
        self.trial = TrialStateMachine(rules, self.writer, self.clock)
        self.sample, self.frame, self.level, self.capturing = 0, 1, 0.0, False
        self.daq_sends = self.mocap_sends = self.force_is_sent = True

    def arm(self, armed_s: float = 0.0) -> Bench:
        """Arm, and wait for armed_s."""
        self.trial.arm(STREAMS, {"/force": self.force_device, "/sync": "NI Dev1", "/markers": "QTM"})
        self.run(armed_s)
        return self

    def record(self, recorded_s: float = 2.0, *, armed_s: float = 1.0) -> Bench:
        """Arm, start the capture after armed_s, and record for recorded_s."""
        self.arm(armed_s)
        self.start_capture()
        self.run(recorded_s)
        return self

    @property
    def codes(self) -> list[TrialCode]:
        """Of the trial's state, or of its end."""
        return [message.code for message in self.trial.messages]

    def run(self, station_s: float) -> None:
        for _ in range(round(station_s / BLOCK_S)):
            self.clock.advance(BLOCK_S)
            if self.daq_sends:
                self.send_daq(np.full(100, self.level))
            if self.capturing and self.mocap_sends:
                self.send_frames(10)
            self.trial.tick()

    def send_daq(self, volts: np.ndarray) -> None:
        numbers = np.arange(self.sample, self.sample + len(volts), dtype=np.uint64)
        self.sample += len(volts)
        for stream in ("/force", "/sync") if self.force_is_sent else ("/sync",):
            values = volts[:, None] if stream == "/sync" else np.zeros((len(volts), 1))
            times = numbers.astype(np.int64) * 1_000_000
            self.trial.handle(Samples(stream, numbers, times, self.clock.utc_ns(), values))

    def send_frames(self, count: int) -> None:
        numbers = np.arange(self.frame, self.frame + count, dtype=np.uint64)
        self.frame += count
        values = np.zeros((count, 1, 4), dtype=np.float32)
        times = numbers.astype(np.int64) * 10_000_000
        self.trial.handle(Samples("/markers", numbers, times, self.clock.utc_ns(), values))

    def event(self, kind: str) -> None:
        self.trial.handle(Event(kind, kind, self.clock.utc_ns(), "QTM"))

    def start_capture(self) -> None:
        self.level, self.capturing = 5.0, True
        self.event("capture_started")

    def stop_capture(self, then_s: float = 0.0, *, with_event: bool = True) -> None:
        """Stop the capture, and go on for then_s."""
        self.level, self.capturing = 0.0, False
        if with_event:
            self.event("capture_stopped")
        self.run(then_s)
