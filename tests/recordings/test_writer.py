"""What the writer promises: it never overwrites, never waits, and never calls stored what is not."""

import errno
import gc
import io
import os
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.records import ChunkIndex

from documents.regular_file import sync_file
from recordings import recovery, writer
from recordings.errors import RecordingCode, RecordingError, WriteFailed
from recordings.manifest import TrialOutcome
from recordings.reader import open_recording
from recordings.recovery import recover
from recordings.samples import Event, Samples, Stream
from recordings.writer import BackgroundSync, RecordingWriter, create_exclusively, in_a_thread, sync_folder
from tests.recordings.trials import (
    ACCEPTED,
    MANIFEST,
    START_NS,
    STREAMS,
    WallClock,
    bits,
    frames,
    items_of,
    record,
    scalars,
    skipped,
    trial,
)
from tests.refusals import raises_refusal
from tests.timeout import scaled_timeout

ITEMS = tuple(trial(4.0))


def test_what_is_written_comes_back_in_order_without_empty_blocks(tmp_path: Path) -> None:
    items = [*trial(1.0), skipped(100, 3), Event("mark", "ä漢", 0, "operator")]
    recording = open_recording(record(tmp_path / "a.mcap", items))
    assert items_of(recording) == bits(items)
    assert (recording.manifest, recording.streams, recording.missing) == (MANIFEST, STREAMS, ())
    block = scalars("/force", 0, 1)
    nothing = Samples("/force", block.sample_numbers[1:], block.device_time_ns[1:], 0, block.values[1:])
    assert items_of(open_recording(record(tmp_path / "b.mcap", [nothing, block]))) == bits([block])


def test_the_outcome_counts_what_came_before_and_a_rejected_trial_keeps_its_data_and_the_reason(tmp_path: Path) -> None:
    outcome = open_recording(record(tmp_path / "a.mcap", list(trial(1.0)))).outcome
    assert (outcome.accepted, outcome.state, outcome.sentence) == (True, "closed", "the mocap capture ended")
    assert outcome.samples == {"/force": 1000, "/sync": 1000, "/markers": 100}
    assert outcome.messages["/events"] == 2
    assert outcome.messages["/manifest"] == 2
    items = list(trial(0.2))
    path = record(tmp_path / "b.mcap", items, TrialOutcome(False, "failed", "NI Dev1 is gone: unplugged"))
    recording = open_recording(path)
    assert recording.complete
    assert (recording.outcome.accepted, recording.outcome.sentence) == (False, "NI Dev1 is gone: unplugged")
    assert items_of(recording) == bits(items)


def test_what_has_no_time_of_its_own_has_the_latest_of_the_items_before(tmp_path: Path) -> None:
    times_ns = [START_NS + seconds * 10**9 for seconds in (2, 5, 3)]
    path = record(tmp_path / "a.mcap", [Event("mark", "", time_ns, "operator") for time_ns in times_ns])
    with path.open("rb") as file:
        logged = [message.log_time for *_, message in make_reader(file).iter_messages(log_time_order=False)]
    before, after = logged[: 1 + len(STREAMS)], logged[-2 - len(STREAMS) :]
    assert (set(before), set(after)) == ({START_NS}, {times_ns[1]})


def test_a_disk_that_never_answers_does_not_keep_the_process_from_ending() -> None:
    kinds, is_over = list[bool](), threading.Event()

    def work() -> None:
        kinds.append(threading.current_thread().daemon)
        is_over.set()

    in_a_thread(work)
    assert is_over.wait(scaled_timeout(10)) and kinds == [True]


def opened(path: Path, wall: WallClock, **options: Any) -> RecordingWriter:
    """A writer that syncs in this thread."""
    return RecordingWriter(path, MANIFEST, STREAMS, clock=wall, background=lambda work: work(), **options)


def _synced_writer(path: Path) -> tuple[RecordingWriter, WallClock, list[float]]:
    """A writer, its clock, and the times at which it has synced its file to the disk."""
    wall, syncs = WallClock(), list[float]()
    return opened(path, wall, sync=lambda _: syncs.append(wall.now)), wall, syncs


@pytest.mark.parametrize(("waited_s", "is_synced"), [(0.799, False), (0.8, True)])
def test_a_message_is_synced_to_the_disk_after_0_8_s(tmp_path: Path, waited_s: float, is_synced: bool) -> None:
    writer, wall, syncs = _synced_writer(tmp_path / "a.mcap")
    wall.now = 0.0
    writer.write(scalars("/force", 0, 10))
    wall.now = waited_s
    writer.flush_if_due()
    assert (waited_s in syncs) is is_synced
    writer.discard()


@pytest.mark.parametrize(
    ("name", "streams", "code"),
    [
        ("a.mcap", STREAMS, RecordingCode.EXISTS),
        ("no_such_folder/a.mcap", STREAMS, RecordingCode.NOT_CREATABLE),
        ("b.mcap", [Stream("/gyroscope", "rad/s", ("x",), 100.0, "IMU")], RecordingCode.UNKNOWN_STREAM),
    ],
)
def test_a_file_that_cannot_be_begun_is_refused_and_an_existing_one_left_alone(
    tmp_path: Path, name: str, streams: Sequence[Stream], code: RecordingCode
) -> None:
    (tmp_path / "a.mcap").write_bytes(b"precious")
    with raises_refusal(code):
        RecordingWriter(tmp_path / name, MANIFEST, streams)
    assert (tmp_path / "a.mcap").read_bytes() == b"precious"


def test_the_manifest_is_in_the_file_before_anything_else_happens(tmp_path: Path) -> None:
    writer = RecordingWriter(tmp_path / "a.mcap", MANIFEST, STREAMS)
    opened = open_recording(tmp_path / "a.mcap")
    assert (opened.manifest, opened.streams, opened.outcome) == (MANIFEST, STREAMS, None)
    writer.discard()


def test_no_message_waits_longer_than_a_fifth_of_a_second_for_the_operating_system(tmp_path: Path) -> None:
    path, wall = tmp_path / "a.mcap", WallClock()
    writer = RecordingWriter(path, MANIFEST, STREAMS, clock=wall)
    written: list[tuple[float, int]] = []
    for i in range(100):
        wall.now = i * 0.0333
        writer.write(scalars("/force", i * 10, 10))
        written.append((wall.now, i * 10 + 9))
        readable = len(open_recording(path).load("/force").sample_numbers)
        waiting = [time for time, last in written if last >= readable]
        assert all(wall.now - time <= 0.2 for time in waiting)
        assert writer.stored["/force"].samples == readable if readable else not writer.stored
    writer.discard()


def test_the_last_item_is_flushed_without_a_further_one(tmp_path: Path) -> None:
    path, wall = tmp_path / "a.mcap", WallClock()
    writer = RecordingWriter(path, MANIFEST, STREAMS, clock=wall)
    writer.write(scalars("/force", 0, 10))
    wall.now = 0.1
    writer.flush_if_due()
    assert len(open_recording(path).load("/force").sample_numbers) == 10
    writer.discard()


def test_no_message_waits_longer_than_a_second_for_the_disk(tmp_path: Path) -> None:
    writer, wall, syncs = _synced_writer(tmp_path / "a.mcap")
    for i in range(1, 200):
        wall.now = i * 0.05
        if i < 150:
            writer.write(scalars("/force", i * 10, 10))
        writer.flush_if_due()
    assert max(np.diff(syncs)) <= 1.0
    assert syncs[-1] >= 149 * 0.05
    assert len(syncs) < 15
    writer.discard()


def test_wherever_the_disk_takes_no_more_nothing_stored_is_missing(tmp_path: Path) -> None:
    errors = (errno.ENOSPC, "no more room"), (errno.EIO, "volume gone")
    for number, room in enumerate([*range(0, 6000, 122), *range(6000, 30_000, 1997)]):
        error, words = errors[number % 2]
        claim = write_trial(tmp_path / f"{room}.mcap", disk_with_room(room, error))
        assert claim is not None and words in claim.sentence
        assert (claim.returned, claim.missing) == (0, 0), f"room for {room} bytes"


def test_a_disk_that_fails_to_sync_takes_back_what_it_was_given_since(tmp_path: Path) -> None:
    for good in range(6):
        left = iter(range(good))

        def sync(_: int, left: Iterator[int] = left) -> None:
            if next(left, None) is None:
                raise OSError(errno.EIO, "Input/output error")

        claim = write_trial(tmp_path / f"{good}.mcap", sync=sync)
        assert claim is not None and "Input/output error" in claim.sentence
        assert (claim.returned, claim.missing) == (0, 0), f"after {good} syncs"


def test_a_disk_that_goes_with_its_cache_takes_back_what_it_was_given_since_the_last_sync(tmp_path: Path) -> None:
    for number, room in enumerate(range(2000, 40_000, 733)):
        error = (errno.EROFS, errno.EIO)[number % 2]
        claim = write_trial_on_disk_that_goes(tmp_path / f"{room}.mcap", room, error)
        assert claim is not None and claim.sentence
        assert (claim.returned, claim.missing) == (0, 0), f"room for {room} bytes"


def test_what_was_synced_before_a_failed_write_is_still_claimed(tmp_path: Path) -> None:
    claim = write_trial_on_disk_that_goes(tmp_path / "a.mcap", 30_000, errno.EROFS)
    assert claim.stored["/force"] == claim.kept["/force"] > 1000
    assert f"last stored samples are /force {claim.stored['/force'] - 1}," in claim.sentence


def test_the_first_failed_write_is_final_and_names_the_last_stored_samples(tmp_path: Path) -> None:
    path, wall = tmp_path / "a.mcap", WallClock()
    room = len(record(tmp_path / "whole.mcap", []).read_bytes()) + 3000
    writer = opened(path, wall, create=disk_with_room(room))
    failures = 0
    stored = {}
    for i in range(60):
        wall.now += 0.2
        try:
            writer.write(scalars("/force", i * 100, 100))
        except WriteFailed as error:
            failures += 1
            stored = stored or dict(writer.stored)
            last = stored["/force"].last_sample_number
            assert f"(no more room): the last stored samples are /force {last}" in str(error)
    assert failures > 1
    assert writer.stored == stored
    with pytest.raises(WriteFailed):
        writer.flush_if_due()
    with pytest.raises(WriteFailed):
        writer.close(ACCEPTED)
    assert open_recording(path).outcome is None


def test_a_failed_fsync_is_a_failed_write(tmp_path: Path) -> None:
    wall, broken = WallClock(), False

    def sync(_: int) -> None:
        if broken:
            raise OSError(errno.EIO, "Input/output error")

    writer = opened(tmp_path / "a.mcap", wall, sync=sync)
    writer.write(scalars("/force", 0, 10))
    wall.now = 1.0
    writer.flush_if_due()
    broken = True
    writer.write(scalars("/force", 10, 10))
    wall.now = 1.2
    writer.flush_if_due()
    assert writer.stored["/force"].samples == 20
    wall.now = 2.0
    with raises_refusal(RecordingCode.WRITE_FAILED, naming="last stored samples are /force 9;"):
        writer.flush_if_due()
    assert writer.stored["/force"].samples == 10, "it is unknown what the disk has of the rest"
    writer.discard()


@pytest.mark.skipif(sys.platform == "win32", reason="Windows deletes and moves no open file")
def test_a_recording_that_is_deleted_while_it_is_written_is_reported_within_a_second(tmp_path: Path) -> None:
    path, wall = tmp_path / "a.mcap", WallClock()
    writer = opened(path, wall)
    writer.write(scalars("/force", 0, 100))
    path.unlink()
    told_s = None
    for i in range(1, 20):
        wall.now = 0.1 * i
        try:
            writer.write(scalars("/force", 100 * i, 100))
        except WriteFailed as error:
            told_s = told_s or wall.now
            assert "it was deleted while it was written): the last stored samples are none" in str(error)
    assert told_s is not None and told_s <= 1.0
    assert not writer.stored
    with pytest.raises(WriteFailed):
        writer.close(ACCEPTED)


@pytest.mark.skipif(sys.platform == "win32", reason="Windows deletes and moves no open file")
def test_a_recording_that_is_moved_while_it_is_written_continues_and_is_reported_at_its_end(tmp_path: Path) -> None:
    session = tmp_path / "monday"
    session.mkdir()
    writer = RecordingWriter(session / "a.mcap", MANIFEST, STREAMS)
    writer.write(scalars("/force", 0, 100))
    session.rename(tmp_path / "tuesday")
    writer.write(scalars("/force", 100, 100))
    with raises_refusal(RecordingCode.MOVED):
        writer.close(ACCEPTED)
    moved = open_recording(tmp_path / "tuesday" / "a.mcap")
    assert moved.complete and len(moved.load("/force").values) == 200


@pytest.mark.skipif(sys.platform == "win32", reason="Windows moves no open file")
def test_another_file_under_its_name_is_no_recording_and_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    for end in ("close", "discard"):
        writer = RecordingWriter(path, MANIFEST, STREAMS)
        writer.write(scalars("/force", 0, 100))
        path.rename(tmp_path / f"{end}.mcap")
        path.write_bytes(b"precious")
        if end == "close":
            with raises_refusal(RecordingCode.MOVED):
                writer.close(ACCEPTED)
        else:
            writer.discard()
        assert path.read_bytes() == b"precious"
        path.unlink()
    assert open_recording(tmp_path / "close.mcap").complete


@pytest.mark.parametrize("size", [0, 3000])
@pytest.mark.parametrize("goes_on", [True, False])
def test_a_recording_that_another_program_cuts_is_reported_at_the_next_flush(
    tmp_path: Path, size: int, goes_on: bool
) -> None:
    path, wall = tmp_path / "a.mcap", WallClock()
    writer = opened(path, wall)
    for i in range(20):
        wall.now = 0.1 * i
        writer.write(scalars("/force", 100 * i, 100))
    os.truncate(path, size)
    with raises_refusal(RecordingCode.WRITE_FAILED, naming=f" to {size} bytes): the last stored samples are none"):
        if goes_on:
            writer.write(scalars("/force", 2000, 100))
            wall.now = 2.2
            writer.flush_if_due()
        else:
            writer.close(ACCEPTED)
    assert not writer.stored
    assert path.stat().st_size == size, "nothing is written behind a hole"
    if goes_on:
        writer.discard()


def test_a_disk_that_takes_its_time_holds_up_no_flush(tmp_path: Path) -> None:
    path, wall, release = tmp_path / "a.mcap", WallClock(), threading.Event()
    writer = RecordingWriter(path, MANIFEST, STREAMS, clock=wall, sync=lambda _: None if wall.now < 1 else stuck())

    def stuck() -> None:
        assert release.wait(scaled_timeout(20))

    for i in range(50):
        wall.now = i * 0.1
        writer.write(scalars("/force", i * 10, 10))
    assert len(open_recording(path).load("/force").sample_numbers) >= 480
    release.set()
    writer.close(ACCEPTED)
    assert open_recording(path).complete


def test_the_name_of_a_new_file_is_put_on_the_disk_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    synced: list[int] = []
    monkeypatch.setattr(os, "fsync", lambda file: synced.append(os.fstat(file).st_ino))
    create_exclusively(tmp_path / "a.mcap").close()
    assert sys.platform == "win32" or synced == [tmp_path.stat().st_ino]


def test_a_discarded_recording_leaves_no_file(tmp_path: Path) -> None:
    writer = RecordingWriter(tmp_path / "a.mcap", MANIFEST, STREAMS)
    writer.write(scalars("/force", 0, 10))
    writer.discard()
    assert list(tmp_path.iterdir()) == []
    with raises_refusal(RecordingCode.CLOSED):
        writer.write(scalars("/force", 10, 10))


def test_a_block_that_its_stream_did_not_announce_is_refused(tmp_path: Path) -> None:
    writer = RecordingWriter(tmp_path / "a.mcap", MANIFEST, STREAMS)
    with raises_refusal(RecordingCode.WRONG_BLOCK, naming="4 columns"):
        writer.write(frames(0, 2, markers=7))
    with raises_refusal(RecordingCode.WRONG_BLOCK, naming="announced was nothing"):
        writer.write(scalars("/load_cell", 0, 2))
    writer.write(frames(0, 2))
    writer.close(ACCEPTED)
    assert len(open_recording(tmp_path / "a.mcap").load("/markers").values) == 2


def test_beginning_returns_while_the_disk_is_busy_and_finishing_waits_for_it() -> None:
    release, done = threading.Event(), list[int]()

    def sync() -> None:
        assert release.wait(scaled_timeout(20))
        done.append(1)

    disk = BackgroundSync(sync)
    disk.begin()
    assert disk.is_busy and not done
    release.set()
    disk.finish()
    assert not disk.is_busy and len(done) == 2


def test_what_one_failed_with_stays() -> None:
    answers = [OSError("Input/output error"), None]

    def sync() -> None:
        answer = answers.pop(0)
        if answer is not None:
            raise answer

    disk = BackgroundSync(sync, start=lambda work: work())
    disk.begin()
    disk.finish()
    assert str(disk.failure) == "Input/output error"


def test_a_device_that_refuses_a_flush_is_the_reason_on_every_system() -> None:
    with Path(os.devnull).open("wb") as device, pytest.raises(OSError, match="the drive did not flush it to the disk"):
        sync_file(device.fileno())


def test_a_folder_that_cannot_be_synced_is_no_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []

    def refuse(file: int) -> None:
        asked.append(file)
        raise OSError(22, "Invalid argument")

    monkeypatch.setattr(os, "fsync", refuse)
    sync_folder(tmp_path)
    sync_folder(tmp_path / "missing")
    assert len(asked) == (sys.platform != "win32"), "Windows opens no folder"
    for opened in asked:
        with pytest.raises(OSError, match="Bad file descriptor"):
            os.fstat(opened)


@pytest.mark.parametrize("begun", [True, False], ids=["hangs before the end", "hangs at the end"])
def test_a_disk_that_hangs_does_not_hold_up_the_end_for_ever(monkeypatch: pytest.MonkeyPatch, begun: bool) -> None:
    monkeypatch.setattr(writer, "LONGEST_FINISH_S", 0.01)
    disk = BackgroundSync(lambda: None, start=lambda _: None)
    if begun:
        disk.begin()
    disk.finish()
    assert not disk.is_busy
    assert isinstance(disk.failure, TimeoutError) and disk.failure.strerror == "the disk does not answer"


def test_the_file_is_what_the_package_would_have_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    items = list(trial(20.0))
    ours = record(tmp_path / "ours.mcap", items)
    ours_recovered = recover(ours, tmp_path / "ours_recovered.mcap").output
    for module in (writer, recovery):
        monkeypatch.setattr(module, "keep_index_encoded", lambda _: None)
    theirs = record(tmp_path / "theirs.mcap", items)
    theirs_recovered = recover(theirs, tmp_path / "theirs_recovered.mcap").output
    assert ours.read_bytes() == theirs.read_bytes()
    assert ours_recovered.read_bytes() == theirs_recovered.read_bytes()


def test_no_object_is_kept_for_a_chunk(tmp_path: Path) -> None:
    wall, path = WallClock(), tmp_path / "a.mcap"
    long_one = RecordingWriter(path, MANIFEST, STREAMS, clock=wall, sync=lambda _: None)
    gc.collect()  # what other tests have left
    before = path.stat().st_size
    for i in range(200):
        wall.now += 0.2
        long_one.write(scalars("/force", i * 10, 10))
    assert path.stat().st_size > before + 200 * 100, "each block is a chunk of its own"
    assert not [each for each in gc.get_objects() if type(each) is ChunkIndex]
    long_one.close(ACCEPTED)


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
    path: Path, create: Callable[[Path], BinaryIO] = create_exclusively, sync: Callable[[int], None] = lambda _: None
) -> Claim | None:
    """Writes a trial and goes on calling after the first failure, as a careless caller would; None where none came."""
    wall = WallClock()
    try:
        writer = opened(path, wall, create=create, sync=sync)
    except WriteFailed as error:
        return Claim(str(error), 0, {}, {})
    sentence, returned = "", 0
    for item in ITEMS:
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


def write_trial_on_disk_that_goes(path: Path, room: int, error: int) -> Claim | None:
    """As write_trial(), on a disk that takes so many bytes and then goes."""
    disks: list[DiskThatGoes] = []

    def create(path: Path) -> BinaryIO:
        disks.append(DiskThatGoes(path, room, error))
        return io.BufferedWriter(disks[0])  # type: ignore[return-value]

    def sync(file: int) -> None:
        disks[0].sync(file)

    return write_trial(path, create, sync)


def _readable(path: Path) -> dict[str, int]:
    """Samples by stream; none where the file ends before its first chunk does."""
    with suppress(RecordingError):
        recording = open_recording(path)
        return {stream.name: len(recording.load(stream.name).sample_numbers) for stream in recording.streams}
    return {}
