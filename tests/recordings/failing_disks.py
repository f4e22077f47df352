"""Disks that take no more, and what a writer claims to have stored on them."""

from __future__ import annotations

import errno
import io
import os
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from recordings.errors import RecordingError, WriteFailed
from recordings.reader import open_recording
from recordings.samples import Item
from recordings.writer import RecordingWriter, create_exclusively
from tests.recordings.trials import ACCEPTED, MANIFEST, STREAMS, WallClock, trial


class DiskThatFills(io.FileIO):
    """A file with room for so many bytes; the last write may get a part of its bytes down, as in life."""

    def __init__(self, path: Path, room: int, error: int = errno.ENOSPC) -> None:
        super().__init__(path, "xb")
        self._room, self._error = room, error

    def write(self, data: bytes) -> int:  # type: ignore[override]
        written = super().write(memoryview(data)[: self._room])
        self._room -= written
        if not written and len(data):
            raise OSError(self._error, "no more room" if self._error == errno.ENOSPC else "volume gone")
        return written


class DiskThatGoes(DiskThatFills):
    """A file whose disk goes with its cache when its room is used up: what was not synced is not there any more."""

    def __init__(self, path: Path, room: int, error: int) -> None:
        super().__init__(path, room, error)
        self._synced_bytes = 0

    def sync(self, _: int) -> None:
        self._synced_bytes = os.fstat(self.fileno()).st_size

    def write(self, data: bytes) -> int:  # type: ignore[override]
        try:
            return super().write(data)
        except OSError:
            self.truncate(self._synced_bytes)
            raise


def disk_with_room(room: int, error: int = errno.ENOSPC) -> Callable[[Path], BinaryIO]:
    return lambda path: io.BufferedWriter(DiskThatFills(path, room, error))  # type: ignore[type-var]


@dataclass(frozen=True)
class Claim:
    """What a writer said of a trial that its disk did not take.

    returned  calls that returned normally after the first that failed
    stored    samples claimed as stored, by stream;  kept  those that can be read
    """

    sentence: str
    returned: int
    stored: dict[str, int]
    kept: dict[str, int]

    @property
    def missing(self) -> int:
        """Samples that were claimed and are not there."""
        return sum(max(0, count - self.kept.get(stream, 0)) for stream, count in self.stored.items())


def write_trial(
    path: Path,
    seconds: float,
    create: Callable[[Path], BinaryIO] = create_exclusively,
    sync: Callable[[int], None] = lambda _: None,
) -> Claim | None:
    """Writes a trial and goes on calling after the first failure, as a careless caller would; None where none came."""
    wall = WallClock()
    items: list[Item] = list(trial(seconds))
    try:
        writer = RecordingWriter(
            path, MANIFEST, STREAMS, clock=wall, create=create, sync=sync, background=lambda work: work()
        )
    except WriteFailed as error:
        return Claim(str(error), 0, {}, {})
    sentence, returned = "", 0
    for item in items:
        wall.now += 0.03
        try:
            writer.write(item)
        except WriteFailed as error:
            sentence = sentence or str(error)
        else:
            returned += bool(sentence)
    try:
        writer.close(ACCEPTED)
    except WriteFailed as error:
        sentence = sentence or str(error)
    else:
        return None
    stored = {name: kept.samples for name, kept in writer.stored.items()}
    return Claim(sentence, returned, stored, _readable(path))


def write_trial_on_disk_that_goes(path: Path, seconds: float, room: int, error: int) -> Claim | None:
    """As write_trial(), on a disk that takes so many bytes and then goes."""
    disks: list[DiskThatGoes] = []

    def create(path: Path) -> BinaryIO:
        disks.append(DiskThatGoes(path, room, error))
        return io.BufferedWriter(disks[0])  # type: ignore[return-value]

    def sync(file: int) -> None:
        disks[0].sync(file)

    return write_trial(path, seconds, create, sync)


def _readable(path: Path) -> dict[str, int]:
    """Samples by stream; none where the file ends before its first chunk does."""
    with suppress(RecordingError):
        recording = open_recording(path)
        return {stream.name: len(recording.load(stream.name).sample_numbers) for stream in recording.streams}
    return {}
