"""Recover the remains of a killed writer or a failing disk into a whole file; the original stays unchanged."""

from __future__ import annotations

import filecmp
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from mcap.writer import CompressionType, Writer

from documents.interval import counted
from documents.regular_file import draft_folder, replace_file, sync_file
from recordings import topics
from recordings.chunks import Damage, read_entries
from recordings.contents import Contents, StreamContents, read_contents
from recordings.errors import RecordingCode, RecordingError
from recordings.reader import is_ours, survey_file
from recordings.writer import keep_index_encoded, sync_folder


@dataclass(frozen=True)
class RecoveryReport:
    """Result of a recovery.

    damage    the bytes of the source that could not be read, in file order; empty for a whole file
    contents  of the output: what was kept and what is missing
    """

    source: Path
    output: Path
    damage: tuple[Damage, ...]
    contents: Contents

    @property
    def lossless(self) -> bool:
        """Whether every message that the writer was given is in the output."""
        return self.contents.complete

    def sentences(self) -> tuple[str, ...]:
        """Damage, missing samples and the end of every stream, as sentences; empty if nothing is missing."""
        gaps = [gap for gap in self.contents.gaps if gap.cause == "file_damage"]
        if self.lossless:
            return ()
        return (
            *(str(damage) for damage in self.damage),
            *self.contents.missing,
            *(f"{gap.stream} lost samples {gap.first_missing} to {gap.first_missing + gap.count - 1}" for gap in gaps),
            *(_kept(name, stream) for name, stream in self.contents.streams.items()),
        )


def _kept(name: str, stream: StreamContents) -> str:
    if not stream.samples:
        return f"{name} keeps no sample"
    return (
        f"{name} keeps {counted(stream.samples, 'sample')}, the last is number {stream.last_sample_number} "
        f"at {stream.last_device_time_ns * 1e-9:.3f} s of its device's clock"
    )


def recovered_path(path: Path) -> Path:
    """Default output of a recovery: run-1.mcap → run-1.recovered.mcap."""
    return path.with_suffix(".recovered.mcap")


def recover(path: Path, output: Path | None = None, progress: Callable[[int], None] = lambda _: None) -> RecoveryReport:
    """Copy every readable message of a recording into a new file with an index and correct CRCs.

    Messages stay in their chunks, with their times and sequence numbers, and nothing is added: recovering a recovered
    file gives the same bytes again. The output takes its name when it is whole, and never replaces a different file.
    progress receives the number of bytes of the source read. Raises RecordingError if nothing can be kept, or the
    output cannot be made.
    """
    output = output or recovered_path(path)
    try:
        with draft_folder(output.parent) as folder:
            with (folder / output.name).open("xb") as file:
                damage = _copy(path, file, progress)
            _give_name(folder / output.name, output)
        sync_folder(output.parent)
    except OSError as error:
        raise RecordingError(
            f"{output} cannot be written: {error.strerror or error}", RecordingCode.NOT_WRITABLE
        ) from error
    return RecoveryReport(path, output, damage, read_contents(output))


def _copy(path: Path, file: BinaryIO, progress: Callable[[int], None]) -> tuple[Damage, ...]:
    """Returns what of the source could not be read. Raises RecordingError where nothing could."""
    writer = Writer(file, compression=CompressionType.ZSTD)
    keep_index_encoded(writer)
    writer.start(profile=topics.PROFILE)
    channels = topics.register_topics(writer)
    damage: list[Damage] = []
    chunk = None
    for entry in read_entries(path):
        if isinstance(entry, Damage):
            damage.append(entry)
            continue
        if not is_ours(entry):
            continue
        if chunk is not None and entry.chunk_offset != chunk:
            writer.flush()  # type: ignore[no-untyped-call]
            progress(entry.chunk_offset)
        chunk = entry.chunk_offset
        writer.add_message(
            channel_id=channels[entry.topic],
            log_time=entry.log_time_ns,
            publish_time=entry.log_time_ns,
            sequence=entry.sequence,
            data=entry.data,
        )
    if chunk is None:
        survey_file(path)  # raises with the reason
    writer.finish()  # type: ignore[no-untyped-call]
    file.flush()
    sync_file(file.fileno())
    progress(path.stat().st_size)
    return tuple(damage)


def _give_name(part: Path, output: Path) -> None:
    if not output.exists():
        replace_file(part, output)
    elif not filecmp.cmp(part, output, shallow=False):
        raise RecordingError(
            f"{output} exists and holds something else; name another output", RecordingCode.OUTPUT_EXISTS
        )
