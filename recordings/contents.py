"""Summary of a recording: counts, rates, gaps, occlusions, and whether it is complete."""

from __future__ import annotations

import json
from bisect import bisect_right
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from documents.interval import counted
from recordings import topics
from recordings.chunks import Damage, read_entries
from recordings.manifest import Manifest, TrialOutcome
from recordings.reader import Survey, is_ours, read, survey_file
from recordings.samples import Event, Item, Loss, Samples, Stream

MOST_JUMPS_IN_A_BLOCK = 1000
"""Further jumps are reported as one: no device skips so often in 50 ms, but a forged block might."""


@dataclass(frozen=True)
class TopicContents:
    """One topic; times are log times, UTC of the host [ns]."""

    messages: int
    first_ns: int
    last_ns: int


@dataclass(frozen=True)
class StreamContents:
    """One stream, by its device's own numbers and clock.

    rate_hz       samples per second of the device's clock between the first and the last of them, gaps included;
                  None below two samples
    occluded      by marker label, the fraction of frames in which it was missing; empty for scalar streams
    """

    samples: int
    first_sample_number: int
    last_sample_number: int
    first_device_time_ns: int
    last_device_time_ns: int
    unit: str
    nominal_rate_hz: float
    rate_hz: float | None
    occluded: dict[str, float]


@dataclass(frozen=True)
class Contents:
    """Summary of a recording.

    manifest  None where both its copies are damaged
    gaps      all samples that are not in the file, in the order of their discovery. Beside the causes of the ledger:
              "file_damage" (the file has lost messages), "unexplained" (the sample numbers jump and no Loss says why)
              and "numbers_went_back" (the device restarted its count; the number missing is unknown, so 0)
    events    events of the devices, the station and the operator, in file order
    missing   damage to the file and lost messages, as sentences
    """

    path: Path
    manifest: Manifest | None
    outcome: TrialOutcome | None
    topics: dict[str, TopicContents]
    streams: dict[str, StreamContents]
    gaps: tuple[Loss, ...]
    events: tuple[Event, ...]
    missing: tuple[str, ...]

    def lost(self, stream: str) -> int:
        """Samples of a stream that are not in the file, as far as their number is known."""
        return sum(gap.count for gap in self.gaps if gap.stream == stream)

    @property
    def complete(self) -> bool:
        """Whether everything the writer was given is in the file; losses before the writer are in `gaps`."""
        return not self.missing

    @property
    def shortfalls(self) -> tuple[str, ...]:
        """Gaps, damage and lost messages, as sentences; empty for a complete file without gaps."""
        gaps = (
            f"gap in {gap.stream}: {counted(gap.count, 'sample')} from {gap.first_missing} on, {gap.cause}"
            for gap in self.gaps
        )
        return (*gaps, *self.missing)

    def to_json(self) -> str:
        """One JSON object with the keys topics, streams, gaps, events, complete, missing, manifest, outcome, file."""
        plain: dict[str, Any] = asdict(self)
        plain["file"] = str(plain.pop("path"))
        plain["complete"] = self.complete
        return json.dumps(plain, indent=2, ensure_ascii=False)


def read_contents(path: Path) -> Contents:
    """Summarise a recording, whole or cut, in bounded memory. Raises RecordingError if nothing can be read."""
    return summarise(path, survey_file(path))


def summarise(path: Path, survey: Survey, listen: Callable[[Stream | Item], None] = lambda _: None) -> Contents:
    """Summarise a surveyed file. `listen` receives every item, so that one pass over the file is enough."""
    found: dict[str, TopicContents] = {}
    tallies = {stream.name: _Tally(stream) for stream in survey.streams}
    losses: list[Loss] = []
    events: list[Event] = []
    for entry in read_entries(path):
        if isinstance(entry, Damage) or not is_ours(entry):
            continue
        now = entry.log_time_ns
        seen = found.get(entry.topic, TopicContents(0, now, now))
        found[entry.topic] = TopicContents(seen.messages + 1, min(seen.first_ns, now), max(seen.last_ns, now))
        message = read(entry)
        if isinstance(message, Stream | Item):
            listen(message)
        match message:
            case Stream() as stream if stream.name in tallies:
                tallies[stream.name].stream = stream
            case Samples() as block:
                if block.stream not in tallies:
                    tallies[block.stream] = _undescribed(block.stream)
                tallies[block.stream].add(block, entry.sequence)
            case Loss() as loss:
                losses.append(loss)
            case Event() as event:
                events.append(event)
    return Contents(
        path=path,
        manifest=survey.manifest,
        outcome=survey.outcome,
        topics={topic: found[topic] for topic in topics.SCHEMA_OF_TOPIC if topic in found},
        streams={name: tally.contents() for name, tally in tallies.items()},
        gaps=_explained([gap for tally in tallies.values() for gap in tally.gaps], losses),
        events=tuple(events),
        missing=survey.missing,
    )


@dataclass
class _Tally:
    """Counts one stream while it passes."""

    stream: Stream
    samples: int = 0
    next_sequence: int = 0
    first: tuple[int, int] | None = None  # sample number and device time
    last: tuple[int, int] | None = None
    gaps: list[Loss] = field(default_factory=list)
    occlusions: Counter[str] = field(default_factory=Counter)
    frames: Counter[str] = field(default_factory=Counter)

    def add(self, block: Samples, sequence: int) -> None:
        times = block.device_time_ns
        self._find_gaps(block, "unexplained" if sequence == self.next_sequence else "file_damage")
        self.first = self.first or (int(block.sample_numbers[0]), int(times[0]))
        self.last = (int(block.sample_numbers[-1]), int(times[-1]))
        self.samples += len(times)
        self.next_sequence = sequence + 1
        if block.values.ndim == 3 and block.values.shape[1] == len(self.stream.labels):
            missing = np.isnan(block.values).any(axis=2).sum(axis=0)
            self.occlusions.update(dict(zip(self.stream.labels, missing.tolist(), strict=True)))
            self.frames.update(dict.fromkeys(self.stream.labels, len(times)))

    def _find_gaps(self, block: Samples, cause_between_blocks: str) -> None:
        """A jump between blocks may be damage to the file; one within a block was a jump when it arrived."""
        numbers, times = block.sample_numbers, block.device_time_ns
        if self.last:
            self._compare(*self.last, int(numbers[0]), cause_between_blocks, block.host_time_ns)
        jumps = np.flatnonzero(numbers[1:] - numbers[:-1] != 1)
        for i in jumps[:MOST_JUMPS_IN_A_BLOCK]:
            before = int(numbers[i]), int(times[i])
            self._compare(*before, int(numbers[i + 1]), "unexplained", block.host_time_ns)
        if len(rest := jumps[MOST_JUMPS_IN_A_BLOCK:]):
            steps = (numbers[rest + 1] - numbers[rest]).astype(np.int64)  # below 0 where the numbers went back
            missing = int(np.maximum(steps - 1, 0).sum())
            first, at = int(numbers[rest[0]]) + 1, int(times[rest[0]])
            self.gaps.append(Loss(self.stream.name, "unexplained", first, missing, at, block.host_time_ns))

    def _compare(self, last_number: int, last_time_ns: int, number: int, cause: str, host_time_ns: int) -> None:
        if number != last_number + 1:
            count = max(0, number - last_number - 1)
            cause = cause if count else "numbers_went_back"
            self.gaps.append(Loss(self.stream.name, cause, last_number + 1, count, last_time_ns, host_time_ns))

    def contents(self) -> StreamContents:
        first, last = self.first or (0, 0), self.last or (0, 0)
        seconds = (last[1] - first[1]) * 1e-9
        return StreamContents(
            samples=self.samples,
            first_sample_number=first[0],
            last_sample_number=last[0],
            first_device_time_ns=first[1],
            last_device_time_ns=last[1],
            unit=self.stream.unit,
            nominal_rate_hz=self.stream.rate_hz,
            rate_hz=(self.samples - 1) / seconds if seconds > 0 else None,
            occluded={label: self.occlusions[label] / frames for label, frames in self.frames.items()},
        )


def _undescribed(name: str) -> _Tally:
    """Counter for a stream whose description was in a damaged chunk."""
    return _Tally(Stream(name=name, unit="", labels=(), rate_hz=0.0, source=""))


def _explained(jumps: list[Loss], ledger: list[Loss]) -> tuple[Loss, ...]:
    """Jumps in the sample numbers with the causes from the ledger, and losses that only the ledger has."""
    gaps = sorted(jumps, key=lambda gap: (gap.stream, gap.first_missing))
    starts = [(gap.stream, gap.first_missing) for gap in gaps]
    for loss in ledger:
        at = bisect_right(starts, (loss.stream, loss.first_missing)) - 1
        jump = gaps[at] if at >= 0 and gaps[at].stream == loss.stream else None
        if jump and loss.first_missing < jump.first_missing + jump.count:
            gaps[at] = replace(jump, cause=loss.cause)
        else:
            gaps.append(loss)
    return tuple(sorted(gaps, key=lambda gap: gap.host_time_ns))
