"""A state of a trial: it takes items, time and commands, and returns the next state."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

from recordings.samples import Event, Item, Samples
from station.bench.snapshot import TrialState
from station.bench.states.context import DeviceFailure, TrialContext
from station.messages.codes import TrialCode
from station.messages.message import Message


@dataclass(frozen=True)
class StartEdge:
    """The sync edge on the clock of /sync and in station seconds."""

    device_ns: int
    station_s: float


class State:
    """Every method returns the next state; by default this one. `messages` are the state of the trial for views."""

    name: TrialState
    messages: tuple[Message[TrialCode], ...]
    edge: StartEdge | None = None
    armed_s: float | None = None  # station seconds at which the time-out began, while one runs
    wants_capture_start = False

    def handle(self, item: Item) -> State:  # noqa: ARG002
        """Take one item from a device, in the order of arrival."""
        return self

    def tick(self) -> State:
        """Check what depends on time alone."""
        return self

    def stop(self, *, at_once: bool) -> State:  # noqa: ARG002
        """The operator ends the trial: cleanly, or at once."""
        return self

    def fail(self, failure: DeviceFailure) -> State:  # noqa: ARG002
        """A device is lost."""
        return self

    def cut_short(self, message: Message[TrialCode]) -> State:  # noqa: ARG002
        """End a trial that cannot continue: what was recorded is closed and kept, and not accepted."""
        return self

    def note_stall(self, event: Event) -> None:
        """The station itself was suspended."""

    def mark(self) -> None:
        """The operator marks this moment, if samples are being recorded."""


class Ended(State):
    """CLOSED (accepted) or FAILED."""

    def __init__(self, *messages: Message[TrialCode], edge: StartEdge | None = None, is_accepted: bool = False) -> None:
        self.name = TrialState.CLOSED if is_accepted else TrialState.FAILED
        self.messages, self.edge = messages, edge


class OpenState(State, ABC):
    """A state in which the devices are read."""

    def __init__(self, context: TrialContext) -> None:
        self.context = context

    def handle(self, item: Item) -> State:
        self.context.record_arrival(item)
        self.store(item)
        if isinstance(item, Event):
            self.context.watchdog.handle_event(item)
            self.context.first_frame.handle_event(item)
            return self.handle_event(item)
        if isinstance(item, Samples) and item.stream == "/sync" and len(item.device_time_ns):
            self.context.latest_device_ns = int(item.device_time_ns[-1])
            return self.handle_sync(item)
        return self

    @abstractmethod
    def store(self, item: Item) -> None:
        """Keep or write the item."""

    def handle_event(self, event: Event) -> State:  # noqa: ARG002
        """Take an event of a device that was stored already."""
        return self

    @abstractmethod
    def handle_sync(self, samples: Samples) -> State:
        """Take a block of the sync line that was stored already."""

    def note_stall(self, event: Event) -> None:
        self.store(event)
