"""Write items into one MCAP file: on the disk within 0.2 s; after a failed write nothing more is claimed as stored.

BackgroundSync flushes from the operating system to the disk, which a power cut cannot take back. The index of the
chunks, which MCAP puts at the end of a file, is kept encoded while the file is written: the package keeps an object for
each chunk, some 600 bytes, and a trial has ten chunks a second. Encoded it is a hundred bytes, of which few change from
one chunk to the next, so that compressed it is some 30. The file is the same.
"""

from __future__ import annotations

import errno
import math
import os
import threading
import time
import zlib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO, Self

from mcap.data_stream import RecordBuilder
from mcap.records import ChunkIndex
from mcap.writer import CompressionType, Writer

from documents.interval import counted
from documents.regular_file import sync_file
from recordings import topics
from recordings.errors import RecordingCode, RecordingError, WriteFailed
from recordings.manifest import Manifest, TrialOutcome
from recordings.packing import Message, pack
from recordings.samples import Item, Samples, Stream

FLUSH_AFTER_S = 0.1
"""Wall seconds from the first message of a chunk to its closing. Polled every 0.1 s: no message waits over 0.2 s."""
SYNC_AFTER_S = 0.8
"""Wall seconds from the first message since the last fsync to the next fsync. Polled as often: never over 1 s."""
LONGEST_FINISH_S = 60.0
"""Wall seconds that the end of a recording waits for its disk: far longer than a slow one takes."""


def in_a_thread(work: Callable[[], None]) -> None:
    """A daemon thread: a disk that never answers does not keep the process from ending."""
    threading.Thread(target=work, name="fsync", daemon=True).start()


@dataclass(frozen=True)
class Stored:
    """Samples of a stream handed to the operating system; after a failed write, those known to be on the disk."""

    samples: int
    last_sample_number: int
    last_device_time_ns: int


def create_exclusively(path: Path) -> BinaryIO:
    """A new file for writing, its name on the disk. Raises FileExistsError rather than overwrite one."""
    file = path.open("xb")
    sync_folder(path.parent)
    return file


class RecordingWriter:
    """Write one trial, from one thread. Only fsync runs in another thread, so that a slow disk does not block.

    The owner calls write() for every item in the order of arrival, and flush_if_due() at least every 0.1 s, also
    without items: the bounds on loss depend on it. Only items counted in `stored` are stored. The first failed write is
    final: it and every later call raise WriteFailed, which names the last samples that a good fsync put on the disk.
    """

    def __init__(
        self,
        path: Path,
        manifest: Manifest,
        streams: Sequence[Stream],
        *,
        clock: Callable[[], float] = time.perf_counter,
        create: Callable[[Path], BinaryIO] = create_exclusively,
        sync: Callable[[int], None] = sync_file,
        background: Callable[[Callable[[], None]], None] = in_a_thread,
    ) -> None:
        """Creates the file and puts the manifest and the streams on the disk at once.

        clock gives monotonic wall seconds; create and sync are the two doors to the disk, background has a call of sync
        done. Raises RecordingError when the file exists or cannot be made.
        """
        self._path, self._manifest, self._clock = path, manifest, clock
        self._streams: dict[str, Stream] = {}
        self._counts: Counter[str] = Counter()
        self._stored: dict[str, Stored] = {}
        self._written: dict[str, Stored] = {}
        self._synced: dict[str, Stored] = {}  # by the last fsync that went well
        self._syncing: dict[str, Stored] = {}  # by the latest
        self._failure: WriteFailed | None = None
        self._latest_ns = manifest.start_utc_ns  # host time of messages that have none of their own
        self._flush_due_s = self._sync_due_s = math.inf
        self._size = 0  # bytes of the file at the last flush
        try:
            self._file = create(path)
            self._identity = os.fstat(self._file.fileno())
        except FileExistsError as error:
            raise RecordingError(
                f"{path} exists, and a recording is never overwritten; take another run", RecordingCode.EXISTS
            ) from error
        except OSError as error:
            raise RecordingError(
                f"{path} cannot be made: {error.strerror or error}; check the folder", RecordingCode.NOT_CREATABLE
            ) from error
        self._disk = BackgroundSync(lambda: self._sync_to_disk(sync), background)
        self._mcap = Writer(self._file, compression=CompressionType.ZSTD)
        keep_index_encoded(self._mcap)
        try:
            with self._writing():
                self._mcap.start(profile=topics.PROFILE)
                self._channels = topics.register_topics(self._mcap)
            self._put(manifest)
            for stream in streams:
                self.describe(stream)
            self._flush_and_sync()
        except BaseException:
            self._release()
            raise

    @property
    def stored(self) -> Mapping[str, Stored]:
        """Samples by stream that survive a kill of this process: the operating system has them.

        After a failed write or fsync: those that the last successful fsync put on the disk; the cache may be lost.
        """
        return dict(self._stored)

    def describe(self, stream: Stream) -> None:
        """Write a stream's description before its first block, and new labels before the first block that has them."""
        if stream.name not in topics.SAMPLE_TOPICS:
            raise RecordingError(
                f"{stream.source} sends {stream.name!r}, expected one of {', '.join(topics.SAMPLE_TOPICS)}",
                RecordingCode.UNKNOWN_STREAM,
            )
        self._streams[stream.name] = stream
        self._put(stream)

    def write(self, item: Item) -> None:
        """Takes one item, and flushes when that is due.

        Raises WriteFailed, or RecordingError for a block that is not what its stream announced.
        """
        self._latest_ns = max(self._latest_ns, item.host_time_ns)
        if isinstance(item, Samples):
            self._write_samples(item)
        else:
            self._put(item)
        self.flush_if_due()

    def flush_if_due(self) -> None:
        """To be called at least every 0.1 s of wall time. Raises WriteFailed."""
        if self._failure:
            raise self._failure
        self._look_at_disk()
        now = self._clock()
        is_sync_due = now >= self._sync_due_s and not self._disk.is_busy
        if now >= self._flush_due_s or is_sync_due:
            self._flush()
        if is_sync_due:
            self._syncing, self._sync_due_s = self._stored, math.inf
            self._disk.begin()
            self._look_at_disk()

    def close(self, outcome: TrialOutcome) -> None:
        """Writes the outcome with the counts of all that came before it, and the index; releases the file in any case.

        The manifest and the streams are written once more: one bad sector at the start must not cost the calibration.
        Raises WriteFailed when this or any earlier write failed.
        """
        try:
            self._put(self._manifest)
            for stream in self._streams.values():
                self._put(stream)
            samples = {name: written.samples for name, written in self._written.items()}
            self._put(replace(outcome, messages=dict(self._counts), samples=samples))
            self._flush()  # looks whether the file is whole before its end is written
            with self._writing():
                self._mcap.finish()  # type: ignore[no-untyped-call]
            self._flush_and_sync()
            self._ensure_at_its_path()
        finally:
            self._release()

    def discard(self) -> None:
        """Releases and deletes the file, where nothing worth keeping was recorded; never another one of its name."""
        is_at_its_path = self._is_at_its_path
        self._release()
        try:
            if is_at_its_path:
                self._path.unlink(missing_ok=True)
        except OSError as error:
            raise RecordingError(
                f"{self._path} cannot be deleted: {error.strerror or error}", RecordingCode.NOT_DELETABLE
            ) from error

    def _write_samples(self, block: Samples) -> None:
        count = len(block.sample_numbers)
        if count == 0:
            return
        stream = self._streams.get(block.stream)
        if stream is None or block.values.shape[1:2] != (len(stream.labels),):
            announced = "nothing" if stream is None else counted(len(stream.labels), "column")
            raise RecordingError(
                f"a block of {block.stream} holds values of shape {block.values.shape}, announced was {announced}; "
                "describe the stream first",
                RecordingCode.WRONG_BLOCK,
            )
        self._put(block)
        before = self._written.get(block.stream)
        self._written[block.stream] = Stored(
            samples=count + (before.samples if before else 0),
            last_sample_number=int(block.sample_numbers[-1]),
            last_device_time_ns=int(block.device_time_ns[-1]),
        )

    def _put(self, message: Message) -> None:
        topic, data = pack(message)
        time_ns = message.host_time_ns if isinstance(message, Item) else self._latest_ns
        now = self._clock()
        with self._writing():
            self._mcap.add_message(
                channel_id=self._channels[topic],
                log_time=time_ns,
                publish_time=time_ns,
                sequence=self._counts[topic],
                data=data,
            )
        self._counts[topic] += 1
        self._flush_due_s = min(self._flush_due_s, now + FLUSH_AFTER_S)
        self._sync_due_s = min(self._sync_due_s, now + SYNC_AFTER_S)

    def _flush(self) -> None:
        with self._writing():
            self._ensure_whole()
            self._mcap.flush()  # type: ignore[no-untyped-call]
            self._size = self._file.tell()
        self._flush_due_s = math.inf
        self._stored = dict(self._written)

    def _flush_and_sync(self) -> None:
        self._flush()
        self._disk.finish()
        self._syncing, self._sync_due_s = self._stored, math.inf
        self._look_at_disk()

    def _sync_to_disk(self, sync: Callable[[int], None]) -> None:
        sync(self._file.fileno())
        if os.fstat(self._file.fileno()).st_nlink == 0:  # every write to it goes well, and into nothing
            raise _ContentLost(errno.ENOENT, "it was deleted while it was written")

    def _ensure_whole(self) -> None:
        """Raise _ContentLost if the file was truncated: further writes would leave a hole of zeros."""
        size = os.fstat(self._file.fileno()).st_size
        if size < self._size:
            raise _ContentLost(errno.EIO, f"another program cut it from {self._size} to {size} bytes")

    def _ensure_at_its_path(self) -> None:
        """Raises WriteFailed if the path no longer names the file that was written."""
        if not self._path.exists():
            raise WriteFailed(
                f"{self._path} was moved while it was written; it is complete at its new place", RecordingCode.MOVED
            )
        if not self._is_at_its_path:
            raise WriteFailed(
                f"{self._path} is now another file: the recording was moved while it was written, and is complete at "
                "its new place; find it before you record the trial again",
                RecordingCode.MOVED,
            )

    @property
    def _is_at_its_path(self) -> bool:
        try:
            return os.path.samestat(self._path.stat(), self._identity)
        except FileNotFoundError:
            return False

    def _look_at_disk(self) -> None:
        if self._disk.is_busy:
            return
        if self._disk.failure is not None:
            with self._writing():
                raise self._disk.failure
        self._synced = self._syncing

    @contextmanager
    def _writing(self) -> Iterator[None]:
        """Latch: after a failed write mcap would continue as if nothing had happened, so it is not called again."""
        if self._failure:
            raise self._failure
        try:
            yield
        except Exception as error:
            self._stored = {} if isinstance(error, _ContentLost) else self._synced
            self._failure = WriteFailed(self._failure_sentence(error))
            raise self._failure from error

    def _failure_sentence(self, error: Exception) -> str:
        reason = (error.strerror if isinstance(error, OSError) else None) or error
        last = ", ".join(f"{name} {stored.last_sample_number}" for name, stored in self._stored.items())
        return (
            f"{self._path} could not be written ({reason}): the last stored samples are {last or 'none'}; "
            "check the disk and record the trial again"
        )

    def _release(self) -> None:
        # Closing tries once more what could not be written; whether it can, the trial has already failed.
        with suppress(OSError):
            self._file.close()
        self._failure = self._failure or WriteFailed(f"{self._path} is closed for writing", RecordingCode.CLOSED)


class _ContentLost(OSError):
    """Data that were written and synced are no longer in the file."""


class BackgroundSync:
    """Flush what was written to the disk without delaying the writer: an fsync can take longer than a kill may cost.

    One flush at a time. failure is the error of the last one that failed; it stays.
    """

    def __init__(self, sync: Callable[[], None], start: Callable[[Callable[[], None]], None] = in_a_thread) -> None:
        self._sync, self._start = sync, start
        self._idle = threading.Event()
        self._idle.set()
        self.failure: Exception | None = None

    @property
    def is_busy(self) -> bool:
        """Whether a flush is under way."""
        return not self._idle.is_set()

    def begin(self) -> None:
        """Start a flush of all that is written by now, and return at once."""
        self._idle.clear()
        self._start(self._run)

    def finish(self) -> None:
        """Wait for the flush under way, then flush once more and wait for it. A disk that hangs has failed."""
        if self._idle.wait(LONGEST_FINISH_S):
            self.begin()
        if not self._idle.wait(LONGEST_FINISH_S):
            self.failure = TimeoutError(errno.ETIMEDOUT, "the disk does not answer")
            self._idle.set()  # no caller waits for it any more

    def _run(self) -> None:
        try:
            self._sync()
        except Exception as error:
            self.failure = error
        finally:
            self._idle.set()


def sync_folder(folder: Path) -> None:
    """Flush the folder's list of files to the disk: the name of a new file is not in the file itself.

    Windows cannot open a folder, and journals its entries itself; fsync of the file reports a failing disk.
    """
    with suppress(OSError):
        opened = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(opened)
        finally:
            os.close(opened)


def keep_index_encoded(writer: Writer) -> None:
    """Call before the first chunk.

    The package has no interface for this. If it renames its list, nothing breaks, but memory grows; a test detects it.
    """
    writer._Writer__chunk_indices = _EncodedIndex()  # type: ignore[attr-defined]


class _EncodedIndex:
    """The list of chunk indices as the package uses it: entries are appended, and written in their order at the end."""

    def __init__(self) -> None:
        self._deflate = zlib.compressobj(level=1)
        self._encoded = bytearray()

    def append(self, entry: ChunkIndex) -> None:
        record = RecordBuilder()
        entry.write(record)
        self._encoded += self._deflate.compress(record.end())  # type: ignore[no-untyped-call]

    def __iter__(self) -> Iterator[Self]:
        """Itself, as the one entry that writes all."""
        yield self

    def write(self, summary: Any) -> None:
        """Once, when the file is finished."""
        summary.write(zlib.decompress(self._encoded + self._deflate.flush()))
