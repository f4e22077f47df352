"""A recording opens as far as its bytes are good, and says how far that is."""

import tracemalloc
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import Writer

from recordings import topics
from recordings.errors import RecordingCode, RecordingError
from recordings.reader import TrackCollector, open_recording
from recordings.samples import Samples
from recordings.writer import RecordingWriter
from tests.recordings.trials import (
    ACCEPTED,
    MANIFEST,
    MARKERS,
    STREAMS,
    bits,
    chunk_ends,
    frames,
    items_of,
    record,
    scalars,
    trial,
)
from tests.refusals import raises_refusal


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> tuple[bytes, list[int], list[Any]]:
    """A short recording: its bytes, the ends of its chunks, its items."""
    return _recorded(tmp_path_factory.mktemp("small") / "a.mcap", seconds=0.04, block_s=0.01)


@pytest.fixture(scope="module")
def large(tmp_path_factory: pytest.TempPathFactory) -> tuple[bytes, list[int], list[Any]]:
    return _recorded(tmp_path_factory.mktemp("large") / "a.mcap", seconds=3.0, block_s=0.1)


def test_a_stream_loads_as_arrays(tmp_path: Path) -> None:
    recording = open_recording(record(tmp_path / "a.mcap", list(trial(0.5))))
    track = recording.load("/markers")
    blocks = [frames(i * 10, 10) for i in range(5)]
    assert track.stream == MARKERS
    assert track.sample_numbers.tolist() == list(range(50))
    assert track.device_time_ns.tolist() == [n * 10_000_000 for n in range(50)]
    assert track.host_time_ns.tolist() == [block.host_time_ns for block in blocks for _ in range(10)]
    assert track.values.tobytes() == np.concatenate([block.values for block in blocks]).tobytes()
    assert not track.values.flags.writeable


def test_all_streams_are_collected_while_the_recording_is_opened(tmp_path: Path) -> None:
    collector = TrackCollector(tmp_path / "a.mcap")
    recording = open_recording(record(tmp_path / "a.mcap", list(trial(0.5))), collector.take)
    for stream in recording.streams:
        collected, loaded = collector.track(stream), recording.load(stream.name)
        assert collected.stream == loaded.stream
        for name in ("sample_numbers", "device_time_ns", "host_time_ns", "values"):
            np.testing.assert_array_equal(getattr(collected, name), getattr(loaded, name))


def test_a_stream_without_samples_loads_as_empty_arrays_and_one_that_was_not_recorded_is_named(tmp_path: Path) -> None:
    track = open_recording(record(tmp_path / "a.mcap", [scalars("/force", 0, 5)])).load("/markers")
    assert track.values.shape == (0, 4, 4)
    assert track.values.dtype == np.float32
    assert len(track.sample_numbers) == len(track.device_time_ns) == len(track.host_time_ns) == 0
    RecordingWriter(tmp_path / "b.mcap", MANIFEST, STREAMS[:1]).close(ACCEPTED)
    with raises_refusal(RecordingCode.NO_STREAM):
        open_recording(tmp_path / "b.mcap").load("/markers")


def test_markers_keep_their_columns_when_the_labels_change_order(tmp_path: Path) -> None:
    """The classic way to swap two markers: the mocap system sends the same labels in another order."""
    reordered = replace(MARKERS, labels=("cuff_1", "extra", "anchor_1"))
    before, after = frames(0, 2), frames(2, 2, markers=3)
    writer = RecordingWriter(tmp_path / "a.mcap", MANIFEST, STREAMS)
    writer.write(before)
    writer.describe(reordered)
    writer.write(after)
    writer.close(ACCEPTED)
    recording = open_recording(tmp_path / "a.mcap")
    assert items_of(recording) == bits([before, reordered, after])
    track = recording.load("/markers")
    assert track.stream.labels == ("anchor_1", "anchor_2", "anchor_3", "cuff_1", "extra")
    np.testing.assert_array_equal(track.values[:2, :4], before.values)
    np.testing.assert_array_equal(track.values[2:, [3, 4, 0]], after.values)
    assert np.isnan(track.values[:2, 4]).all()
    assert np.isnan(track.values[2:, 1:3]).all()


def test_a_file_cut_around_any_chunk_opens_up_to_it(tmp_path: Path, small: tuple[bytes, list[int], list[Any]]) -> None:
    data, ends, items = small
    for cut in [0, 1, 8, *(end + step for end in ends for step in (-1, 0, 1)), len(data) - 1]:
        _check_cut(tmp_path / "cut.mcap", data, ends, items, cut)


@pytest.mark.parametrize("step", [41, pytest.param(5, marks=pytest.mark.slow)])
def test_a_flipped_bit_never_changes_an_item_unseen(
    step: int, tmp_path: Path, small: tuple[bytes, list[int], list[Any]]
) -> None:
    data, _, items = small
    path = tmp_path / "flipped.mcap"
    for at in range(0, len(data), step):
        flipped = bytearray(data)
        flipped[at] ^= 1 << at % 8
        path.write_bytes(flipped)
        recording = open_recording(path)
        found = items_of(recording)
        assert found == items if recording.complete else _is_subsequence(found, items), f"bit at byte {at}"


def test_after_a_damaged_chunk_the_rest_is_read(tmp_path: Path, large: tuple[bytes, list[int], list[Any]]) -> None:
    data, ends, items = large
    path = tmp_path / "damaged.mcap"
    for victim in (0, 1, len(ends) // 2, len(ends) - 2):
        damaged = bytearray(data)
        damaged[ends[victim] - 5] ^= 0x10
        path.write_bytes(damaged)
        recording = open_recording(path)
        assert not recording.complete
        assert recording.outcome is not None
        assert recording.manifest == MANIFEST
        found = items_of(recording)
        assert _is_subsequence(found, items)
        assert len(items) - 3 <= len(found) < len(items) or victim == 0


def test_a_wrong_length_costs_no_more_than_its_own_chunk(
    tmp_path: Path, large: tuple[bytes, list[int], list[Any]]
) -> None:
    data, ends, items = large
    victim = bytes(data).index(b"\x04\x00\x00\x00zstd", ends[5]) - 37
    for length in (0, 1, 10_000, 2**31, 2**63):
        damaged = bytearray(data)
        damaged[victim + 1 : victim + 9] = length.to_bytes(8, "little")
        (tmp_path / "damaged.mcap").write_bytes(damaged)
        assert len(items_of(open_recording(tmp_path / "damaged.mcap"))) == len(items) - 3


def test_zeros_after_a_cut_are_damage_and_not_data(tmp_path: Path, small: tuple[bytes, list[int], list[Any]]) -> None:
    """After a power cut a file system may have given the file its length, but not its bytes."""
    data, ends, items = small
    path = tmp_path / "zeros.mcap"
    path.write_bytes(data[: ends[1]] + bytes(5000))
    recording = open_recording(path)
    found = items_of(recording)
    assert found == items[: len(found)]
    assert len(found) == 3
    assert "no MCAP record has the opcode 0" in recording.missing[0]


def test_reading_takes_no_more_memory_for_a_longer_file(tmp_path: Path) -> None:
    peaks = []
    for name, seconds in (("short", 4.0), ("long", 40.0)):
        path = record(tmp_path / f"{name}.mcap", list(trial(seconds)))
        tracemalloc.start()
        assert sum(isinstance(item, Samples) for item in open_recording(path).items()) == round(seconds * 30)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 2 * peaks[0]


@pytest.mark.parametrize(
    ("content", "code"),
    [(b"", RecordingCode.EMPTY), (b"time,force\n" * 1000, RecordingCode.NOT_MCAP), (None, RecordingCode.UNREADABLE)],
    ids=["empty", "text", "missing"],
)
def test_a_file_that_is_no_recording_is_refused(tmp_path: Path, content: bytes | None, code: RecordingCode) -> None:
    if content is not None:
        (tmp_path / "a.mcap").write_bytes(content)
    with raises_refusal(code):
        open_recording(tmp_path / "a.mcap")


@pytest.mark.parametrize("use_chunking", [True, False])
def test_a_foreign_mcap_file_is_refused_as_foreign(tmp_path: Path, use_chunking: bool) -> None:
    file = BytesIO()
    writer = Writer(file, use_chunking=use_chunking)
    writer.start(profile="ros2")
    schema = writer.register_schema("std_msgs/msg/Float64", "ros2msg", b"float64 data")
    channel = writer.register_channel(topic="/force", message_encoding="cdr", schema_id=schema)
    writer.add_message(channel_id=channel, log_time=1, publish_time=1, data=bytes(12))
    writer.finish()
    (tmp_path / "a.mcap").write_bytes(file.getvalue())
    with raises_refusal(RecordingCode.OTHER_PROGRAM):
        open_recording(tmp_path / "a.mcap")


@pytest.mark.parametrize("size", [10, 2**30])
def test_a_chunk_that_would_fill_the_memory_is_not_unpacked(tmp_path: Path, size: int) -> None:
    """A chunk may announce any size; here its compressed bytes hold 200 MB of zeros."""
    file = BytesIO()
    writer = Writer(file, chunk_size=2**40)
    writer.start(profile=topics.PROFILE)
    channels = topics.register_topics(writer)
    for _ in range(50):
        writer.add_message(channel_id=channels["/force"], log_time=0, publish_time=0, data=bytes(4_000_000))
    writer.finish()
    data = bytearray(file.getvalue())
    at = data.index(b"\x04\x00\x00\x00zstd") - 12
    data[at : at + 8] = size.to_bytes(8, "little")
    (tmp_path / "a.mcap").write_bytes(data)
    tracemalloc.start()
    with raises_refusal(RecordingCode.DAMAGED, naming="announces"):
        open_recording(tmp_path / "a.mcap")
    assert tracemalloc.get_traced_memory()[1] < 20e6
    tracemalloc.stop()


def _recorded(path: Path, seconds: float, block_s: float) -> tuple[bytes, list[int], list[Any]]:
    record(path, list(trial(seconds, block_s)))
    return path.read_bytes(), chunk_ends(path), items_of(open_recording(path))


def _check_cut(path: Path, data: bytes, ends: list[int], items: list[Any], cut: int) -> None:
    path.write_bytes(data[:cut])
    whole_chunks = sum(end <= cut for end in ends)
    if not whole_chunks:
        with pytest.raises(RecordingError):
            open_recording(path)
        return
    recording = open_recording(path)
    found = items_of(recording)
    assert recording.manifest == MANIFEST
    assert not recording.complete
    assert found == items[: len(found)]
    # The first chunk holds the manifest, every other three items, and the last what was left and the outcome.
    is_whole = whole_chunks == len(ends)
    assert len(found) == (len(items) if is_whole else 3 * (whole_chunks - 1)), f"cut at {cut}"
    assert (recording.outcome is not None) == is_whole


def _is_subsequence(part: list[Any], whole: list[Any]) -> bool:
    rest = iter(whole)
    return all(any(item == other for other in rest) for item in part)
