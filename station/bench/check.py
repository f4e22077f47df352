"""What is plugged in, does it answer, at which rate, what the sync line says, which labels are there, is there disk."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from datetime import UTC, date, datetime
from pathlib import Path
from queue import Empty

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from fitting.calibration import full_scale
from recordings.samples import DeviceIdentity, Samples, Stream
from station.bench.devices import devices_for
from station.bench.disk import bytes_free, bytes_needed
from station.bench.feed import Delivered, DeviceFeed, FeedQueue, Gone, Opened
from station.bench.trial_recorder import MakeDevices
from station.clock import Clock, RealClock
from station.config import StationConfig

REST_PART_OF_CAPACITY = 0.02
"""What an empty hook may read; as much as the zero may drift within a trial."""
OPEN_S = 5.0
LISTEN_S = 1.5


@dataclass(frozen=True)
class Line:
    """One line of the check: what was looked at, whether it is as it should be, what was found.

    is_doubtful: nothing is known to be wrong, but it could not be checked or may not be right.
    """

    subject: str
    is_good: bool = field(kw_only=True)
    found: str
    is_doubtful: bool = field(default=False, kw_only=True)


class Answers:
    """What the devices said while they were listened to."""

    def __init__(self, clock: Clock) -> None:
        self.errors: dict[str, str] = {}
        self.streams: dict[str, Stream] = {}
        self.identities: dict[str, DeviceIdentity] = {}
        self._clock = clock
        self._count: dict[str, int] = {}
        self._span: dict[str, tuple[int, int]] = {}
        self._last_value: dict[str, float] = {}
        self._force: list[NDArray[np.float64]] = []

    def take(self, message: Opened | Delivered | Gone) -> None:
        if isinstance(message, Gone):
            self.errors[message.device] = str(message.error)
        elif isinstance(message, Opened):
            self.streams |= {stream.name: stream for stream in message.streams}
            self.identities[message.device] = message.identity
        else:
            for item in message.items:
                if isinstance(item, Samples) and len(item.values):
                    self._add(item)

    def rate_hz(self, stream: str) -> float:
        """Samples a second by the device's own clock."""
        first, last = self._span.get(stream, (0, 0))
        return (self._count[stream] - 1) / ((last - first) * 1e-9) if last > first else 0.0

    def force(self) -> NDArray[np.float64]:
        """(n,) all that came of /force, in its device's unit."""
        return np.concatenate([np.zeros(0), *self._force])

    def last_value(self, stream: str) -> float | None:
        return self._last_value.get(stream)

    def _add(self, samples: Samples) -> None:
        first = self._span.get(samples.stream, (int(samples.device_time_ns[0]), 0))[0]
        self._span[samples.stream] = first, int(samples.device_time_ns[-1])
        self._count[samples.stream] = self._count.get(samples.stream, 0) + len(samples.values)
        self._last_value[samples.stream] = float(samples.values[-1].flat[0])
        if samples.stream == "/force":
            self._force.append(samples.values[:, 0].astype(np.float64))


def check_bench(
    config: StationConfig,
    folder: Path,
    console: Console | None = None,
    make_devices: MakeDevices = devices_for,
    *,
    as_json: bool = False,
) -> int:
    """Prints what was found, with the room on the folder's disk; returns 0 when all is as it should be, else 1."""
    with Console(stderr=True).status("listening to the devices"):
        lines = look_at_bench(config, folder, make_devices)
    return show_lines(lines, console, as_json=as_json)


def show_lines(lines: Sequence[Line], console: Console | None = None, *, as_json: bool = False) -> int:
    """Prints them; returns 0 when all is as it should be, else 1."""
    if as_json:
        print(json.dumps([asdict(line) for line in lines], indent=2, ensure_ascii=False))
    else:
        table = Table("", "what", "found")
        for line in lines:
            grade = "[red]no[/]" if not line.is_good else "[yellow]?[/]" if line.is_doubtful else "[green]ok[/]"
            table.add_row(grade, line.subject, line.found)
        (console or Console()).print(table)
    return 0 if all(line.is_good for line in lines) else 1


def look_at_bench(config: StationConfig, folder: Path, make_devices: MakeDevices = devices_for) -> list[Line]:
    """Opens the devices, listens for some seconds and says what is as it should be and what is not."""
    answers, names = listen(config, folder, RealClock(), make_devices)
    return [
        *_device_lines(answers, names),
        *_force_line(answers, config),
        calibration_line(config, datetime.now(UTC).date()),
        *_sync_line(answers, config),
        *_label_lines(answers, config),
        _disk_line(folder, bytes_needed(answers.streams.values(), config, folder, None)),
    ]


def calibration_line(config: StationConfig, today: date) -> Line:
    """How old the load cell's calibration is, and whether it is still current."""
    cell, subject = config.load_cell, "calibration of the load cell"
    if cell.calibrated_on is None or cell.due_on is None:
        words = "its date is not known; write load_cell.calibrated_on from its certificate"
        return Line(subject, words, is_good=True, is_doubtful=True)
    age = (today - cell.calibrated_on).days
    number = f" of {cell.serial_number}" if cell.serial_number else ""
    words = f"certificate{number} of {cell.calibrated_on}, {age} days old, due on {cell.due_on}"
    if age < 0:
        return Line(subject, f"{words}: it is in the future; correct load_cell.calibrated_on", is_good=False)
    is_current = today < cell.due_on
    return Line(subject, words + ("" if is_current else "; have it calibrated"), is_good=is_current)


def listen(
    config: StationConfig, folder: Path, clock: Clock, make_devices: MakeDevices, listen_s: float = LISTEN_S
) -> tuple[Answers, list[str]]:
    """What the devices say in so many wall seconds after all of them have opened, and the devices' names."""
    inbox, answers = FeedQueue(), Answers(clock)
    feeds = [DeviceFeed(device, inbox) for device in make_devices(config, None, clock, folder)]
    for feed in feeds:
        feed.start()
    settled: set[str] = set()
    open_until, listen_until = clock.wall_s() + OPEN_S, float("inf")
    while clock.wall_s() < min(open_until, listen_until):
        try:
            message = inbox.get(timeout=0.05)
        except Empty:
            continue
        answers.take(message)
        settled.add(message.device)
        if len(settled) == len(feeds) and listen_until == float("inf"):
            listen_until = clock.wall_s() + listen_s
            open_until = listen_until
    for feed in feeds:
        feed.ask_to_stop()
    for feed in feeds:
        feed.has_ended(1.0)
        if feed.device.name not in settled:
            answers.errors[feed.device.name] = f"{feed.device.name} did not answer within {OPEN_S:g} s"
    return answers, [feed.device.name for feed in feeds]


def _device_lines(answers: Answers, names: Sequence[str]) -> list[Line]:
    lines = [
        Line(name, answers.errors.get(name) or _answer(answers, name), is_good=name not in answers.errors)
        for name in names
    ]
    for stream in answers.streams.values():
        rate = answers.rate_hz(stream.name)
        if stream.name == "/markers" and rate == 0:
            words = f"no frames: no capture is running (nominal {stream.rate_hz:g} Hz)"
            lines.append(Line(stream.name, words, is_good=True, is_doubtful=True))
        else:
            good = abs(rate - stream.rate_hz) <= 0.1 * stream.rate_hz
            lines.append(
                Line(stream.name, f"{rate:.1f} samples/s, nominal {stream.rate_hz:g}; {stream.source}", is_good=good)
            )
    return lines


def _answer(answers: Answers, name: str) -> str:
    """That it answers, and what it says of itself."""
    identity = answers.identities.get(name)
    if identity is None:
        return "answers"
    words = f"answers: {identity.text}" if identity.text else "answers"
    return f"{words}; it says that it is SIMULATED" if identity.is_simulated else words


def _force_line(answers: Answers, config: StationConfig) -> list[Line]:
    """With nothing pulling this is the zero, which every fit leaves free; a cell at its end cannot be fitted."""
    raw, cell = answers.force(), config.calibration()
    if not len(raw):
        return []
    unit = answers.streams["/force"].unit
    limit = full_scale(cell, config.daq.force_range_v if cell.source == "daq" else float("inf"))
    newtons = cell.polarity * cell.newtons_per_unit * raw
    good = float(np.abs(raw).max()) < 0.99 * limit
    words = f"{newtons.mean():+.2f} N, scatter {newtons.std():.2f} N"
    most = REST_PART_OF_CAPACITY * config.load_cell.capacity_n
    is_loaded = good and abs(float(newtons.mean())) > most
    if not good:
        words += f"; saturated at {limit:.4g} {unit}, check the wiring"
    elif is_loaded:
        words += f", expected within ±{most:.1f} N with the hook empty; unload the rope or correct the amplifier's zero"
    return [Line("force at rest", words, is_good=good, is_doubtful=is_loaded)]


def _sync_line(answers: Answers, config: StationConfig) -> list[Line]:
    level = answers.last_value("/sync")
    if level is None:
        return []
    good = level < config.sync.threshold_v
    advice = "" if good else "; expected low until a capture starts: stop the capture or check the polarity"
    return [Line("sync line", f"{level:z.2f} V, threshold {config.sync.threshold_v:g} V{advice}", is_good=good)]


def _label_lines(answers: Answers, config: StationConfig) -> list[Line]:
    if "/markers" not in answers.streams:
        return []
    there = set(answers.streams["/markers"].labels)
    lines = []
    for name, cuff in config.cuffs.items():
        missing = sorted({*cuff.anchor_markers, *cuff.cuff_markers, *cuff.rope_markers} - there)
        found = f"missing {', '.join(missing)}; there are {', '.join(sorted(there))}" if missing else "all labels there"
        lines.append(Line(f"markers of cuff {name}", found, is_good=not missing))
    return lines


def _disk_line(folder: Path, needed: float) -> Line:
    free = bytes_free(folder)
    where = folder.resolve() if folder == Path() else folder
    words = f"{free / 1e9:.1f} GB free for {where}, the plan needs {needed / 1e9:.2f} GB"
    return Line("disk", words, is_good=free >= needed)
