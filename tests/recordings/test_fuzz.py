"""Random files for reading and recovery of recordings, and what must hold for all of them.

This is a short run; benchmarks/fuzz.py runs longer.
"""

import contextlib
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from recordings import topics
from recordings.contents import read_contents
from recordings.errors import RecordingError
from recordings.packing import MOST_SAMPLES_IN_A_BLOCK, pack, unpack
from recordings.reader import open_recording
from recordings.recovery import recover
from recordings.samples import Samples
from tests.drivers.test_fuzz import Target, run
from tests.recordings.trials import MANIFEST, STREAMS, frames, record, scalars, trial

Change = tuple[str, int, bytes]
"""What is done to the bytes: "put", "insert", "delete" or "cut"; where, modulo the length; and with what."""
_numbers = st.one_of(st.integers(0, 2**16), st.integers(0, 2**64))
changes_to_a_file = st.lists(
    st.tuples(st.sampled_from(["put", "insert", "delete", "cut"]), _numbers, st.binary(max_size=40)), max_size=6
)
_topic = st.sampled_from(list(topics.SCHEMA_OF_TOPIC))


@cache
def _whole() -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        return record(Path(folder) / "a.mcap", list(trial(1.0))).read_bytes()


@cache
def _bodies() -> list[tuple[str, bytes]]:
    """One right message of each kind."""
    return [pack(one) for one in (MANIFEST, *STREAMS, scalars("/force", 0, 5), frames(0, 2), *list(trial(0.2))[-2:])]


def _changed(whole: bytes, changes: list[Change]) -> bytes:
    data = bytearray(whole)
    for what, place, with_what in changes:
        at = place % (len(data) + 1)
        match what:
            case "put":
                data[at : at + len(with_what)] = with_what
            case "insert":
                data[at:at] = with_what
            case "delete":
                del data[at : at + len(with_what)]
            case "cut":
                del data[at:]
    return bytes(data)


def forged_file(messages: list[tuple[str, bytes]], folder: Path) -> Path:
    """A file in which every CRC is right, whatever its messages hold."""
    path = folder / "forged.mcap"
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        writer.start(profile=topics.PROFILE)
        channels = topics.register_topics(writer)
        for i, (topic, data) in enumerate(messages):
            writer.add_message(channel_id=channels[topic], log_time=i, publish_time=i, sequence=i, data=data)
        writer.finish()  # type: ignore[no-untyped-call]
    return path


forged_messages = st.one_of(
    st.tuples(_topic, st.binary(max_size=80)),
    st.builds(
        lambda which, changes: (_bodies()[which][0], _changed(_bodies()[which][1], changes)),
        st.integers(0, len(STREAMS) + 4),
        changes_to_a_file,
    ),
)


def damaged_file(changes: list[Change], folder: Path) -> Path:
    path = folder / "a.mcap"
    path.write_bytes(_changed(_whole(), changes))
    return path


def _a_damaged_file_is_recovered_or_refused(changes: list[Change]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        _is_read_or_refused(damaged_file(changes, Path(folder)))


def _forged_messages_are_read_or_refused(messages: list[tuple[str, bytes]]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        _is_read_or_refused(forged_file(messages, Path(folder)))


def _is_read_or_refused(path: Path) -> None:
    before = path.read_bytes()
    with _one_line():
        read_contents(path)
    with _one_line():
        recording = open_recording(path)
        list(recording.items())
        for stream in recording.streams:
            with _one_line():
                recording.load(stream.name)
    with _one_line(), recover(path).output.open("rb") as file:
        list(make_reader(file, validate_crcs=True).iter_messages())
    assert path.read_bytes() == before
    assert not list(path.parent.glob(".draft-*"))


@contextlib.contextmanager
def _one_line() -> Iterator[None]:
    try:
        yield
    except RecordingError as error:
        assert "\n" not in str(error), str(error)


def _a_message_is_what_it_says_or_refused(message: tuple[str, bytes]) -> None:
    with _one_line():
        read = unpack(message[0], 0, message[1])
        if isinstance(read, Samples):
            count = len(read.sample_numbers)
            assert 0 < count <= MOST_SAMPLES_IN_A_BLOCK
            assert len(read.device_time_ns) == len(read.values) == count


TARGETS = (
    Target("message", forged_messages, _a_message_is_what_it_says_or_refused),
    Target("damaged file", changes_to_a_file, _a_damaged_file_is_recovered_or_refused, 0.25),
    Target("forged file", st.lists(forged_messages, max_size=12), _forged_messages_are_read_or_refused, 0.25),
)


@pytest.mark.parametrize("target", TARGETS, ids=lambda target: target.name)
def test_no_content_of_a_file_causes_a_hang_a_crash_or_a_wrong_number(target: Target) -> None:
    assert run(target, 200) > 0


def test_a_stream_without_a_name_is_no_stream_of_the_summary(tmp_path: Path) -> None:
    assert read_contents(forged_file([("/streams", b"")], tmp_path)).streams == {}
