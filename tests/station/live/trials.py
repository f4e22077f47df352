"""Parts of the recorded wearer (tests/station/wearer.py) and plans on the generic body, for tests of live operation."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recordings.reader import Recording, open_recording
from recordings.samples import Item, Samples, Stream
from recordings.topics import MARKERS
from station.config import LiveSection, StationConfig
from station.live.engine import LiveEngine
from station.live.pipeline import PreparedTrial, prepare_trial
from station.live.published import LiveDelivery, LiveSetup, LiveUpdate, LiveValues
from tests.station.wearer import SPECS, WearerSession

TIGHT = SPECS[2]
Change = Callable[[int, NDArray[np.float32]], NDArray[np.float32]]
"""Number of the frame since the first one, its values (markers, 4) → other values."""


@dataclass(frozen=True)
class PartOfTrial:
    """The items of a recording up to so many frames, one frame to a block, changed on their way."""

    recording: Recording
    frames: int
    change: Change = lambda _, values: values
    rate_hz: float | None = None

    @property
    def streams(self) -> tuple[Stream, ...]:
        return tuple(
            replace(stream, rate_hz=self.rate_hz) if self.rate_hz and stream.name == MARKERS else stream
            for stream in self.recording.streams
        )

    @property
    def path(self) -> Path:
        return self.recording.path

    @property
    def manifest(self):  # type: ignore[no-untyped-def]
        return self.recording.manifest

    def items(self) -> Iterator[Item | Stream]:
        count = 0
        for item in self.recording.items():
            if isinstance(item, Stream):
                continue
            if not isinstance(item, Samples) or item.stream != MARKERS:
                yield item
                continue
            for k in range(len(item.sample_numbers)):
                values = self.change(count, np.array(item.values[k]))
                numbers, times = item.sample_numbers[k : k + 1], item.device_time_ns[k : k + 1]
                yield replace(item, sample_numbers=numbers, device_time_ns=times, values=values[None])
                count += 1
                if count == self.frames:
                    return

    def blocks(self) -> list[Samples]:
        return [item for item in self.items() if isinstance(item, Samples)]


def part_of(wearer: WearerSession, frames: int, change: Change = lambda _, values: values) -> PartOfTrial:
    return PartOfTrial(open_recording(wearer.path(TIGHT)), frames, change)


def generic_plan(config: StationConfig, folder: Path, settings: LiveSection | None = None) -> PreparedTrial:
    """The generic body with a slack and a rigid suit: the folder has no subject.toml."""
    live = (settings or LiveSection()).model_copy(update={"enabled": True})
    return prepare_trial(config.model_copy(update={"live": live}), folder, TIGHT, 0)


def without_glenoid(plan: PreparedTrial) -> PreparedTrial:
    """The same plan on a model whose markers do not show the glenoid."""
    body = plan.plan.body
    model = replace(body.model, markers=tuple(m for m in body.model.markers if "glenoid" not in m.name.lower()))
    assert len(model.markers) < len(body.model.markers)
    return replace(plan, plan=replace(plan.plan, body=replace(body, model=model)))


@dataclass
class Collected:
    """A sink and a view that keep everything."""

    values: list[LiveValues] = field(default_factory=list)
    updates: list[LiveUpdate] = field(default_factory=list)
    notes: list[tuple[str, str]] = field(default_factory=list)
    setup: LiveSetup | None = None

    def begin(self, setup: LiveSetup) -> None:
        self.setup = setup

    def begin_recording(self, recording: Path) -> None: ...

    def write(self, values: LiveValues, delivery: LiveDelivery) -> None:
        self.values.append(values)

    def note(self, kind: str, text: str) -> None:
        self.notes.append((kind, text))

    @property
    def codes(self) -> set[str]:
        return {finding.code for update in self.updates for finding in update.findings}


def engine_of(
    prepared: PreparedTrial, streams: Iterable[Stream], *sinks: object, now_s: Callable[[], float] = lambda: 0.0
) -> tuple[LiveEngine, Collected]:
    """An engine that knows these streams, and what it gives; its clock stands still unless it is given one."""
    kept = Collected()
    engine = LiveEngine(prepared, on_setup=lambda _: kept.updates.append, sinks=[kept, *sinks], now_s=now_s)  # type: ignore[list-item]
    for stream in streams:
        engine.describe(stream)
    return engine, kept


def solve(prepared: PreparedTrial, part: PartOfTrial, *sinks: object) -> tuple[LiveEngine, Collected]:
    engine, kept = engine_of(prepared, part.streams, *sinks)
    for block in part.blocks():
        engine.take(block, 0.0)
    engine.finish()
    return engine, kept


def outcomes(values: Sequence[LiveValues]) -> list[str]:
    return [one.outcome for one in values]
