"""Write a recording from arrays: samples in blocks as devices deliver them, and the file in one piece."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from documents.regular_file import replace_file
from fitting.trial.reader import read_trials
from recordings.manifest import Manifest, TrialOutcome
from recordings.samples import Item, Loss, Samples, Stream
from recordings.writer import RecordingWriter
from station.checksums import write_checksums
from station.files.foreign_files import ImportRefused
from station.messages.file_codes import ImportCode
from station.messages.message import Message

BLOCK_S = 0.5


def blocks(
    stream: str,
    numbers: NDArray[np.int64],
    device_ns: NDArray[np.int64],
    host_ns: NDArray[np.int64],
    values: NDArray[Any],
) -> Iterator[Samples | Loss]:
    """Samples (n,) in blocks of half a second that arrive with their last sample; a gap begins with its loss."""
    cuts = np.flatnonzero(np.diff((host_ns - host_ns[0]) // round(1e9 * BLOCK_S)) | (np.diff(numbers) != 1)) + 1
    for part in np.split(np.arange(len(numbers)), cuts):
        begin, end = int(part[0]), int(part[-1]) + 1
        lost = int(numbers[begin - 1]) + 1 if begin else int(numbers[begin])
        if numbers[begin] > lost:
            count, arrival = int(numbers[begin]) - lost, int(host_ns[begin])
            yield Loss(stream, "skipped", lost, count, int(device_ns[begin - 1]), arrival)
        counted = numbers[begin:end].astype(np.uint64)
        yield Samples(stream, counted, device_ns[begin:end], int(host_ns[end - 1]), values[begin:end])


def nanoseconds(seconds: NDArray[np.float64]) -> NDArray[np.int64]:
    return np.rint(1e9 * seconds).astype(np.int64)


def write_recording(
    path: Path, manifest: Manifest, streams: Sequence[Stream], items: Iterable[Item], outcome: TrialOutcome, files: str
) -> None:
    """Write a recording under its name once it is complete and readable by the fit; otherwise leave no file.

    files: the sources of the data, for messages. Raises ImportRefused or RecordingError.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_name(f"{path.name}.part")
    draft.unlink(missing_ok=True)
    writer = RecordingWriter(draft, manifest, streams)
    try:
        for item in items:
            writer.write(item)
        writer.close(outcome)
        rejected = read_trials([draft])[1]
        if rejected:
            reason = {"files": files, "reason": str(rejected[0].reason)}
            raise ImportRefused(Message(ImportCode.NOT_USABLE, reason))
        if path.exists():
            raise ImportRefused(Message(ImportCode.FILE_EXISTS, {"path": str(path)}))
        replace_file(draft, path)
        write_checksums(path)
    finally:
        writer.discard()
