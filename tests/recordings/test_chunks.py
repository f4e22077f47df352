"""Framing, byte by byte: what stands before a cut is read, what is broken is named, and nothing is made up."""

import struct
from dataclasses import replace
from io import BufferedReader, FileIO
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.records import Channel, Header, Message, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, IndexType, Writer

from recordings import chunks
from recordings.chunks import Damage, Entry, read_entries
from recordings.topics import PROFILE, register_topics
from tests.recordings.bombs import BOMBS, chunk_with_an_event
from tests.recordings.trials import chunk_ends, record, trial


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(tmp_path_factory.mktemp("whole") / "a.mcap", list(trial(0.04, 0.01)))


def test_a_whole_file_has_no_damage_and_every_message_in_its_chunk(whole: Path) -> None:
    entries, damage = _read(whole)
    assert damage == []
    assert len({entry.chunk_offset for entry in entries}) == len(chunk_ends(whole))
    assert [entry.topic for entry in entries[:4]] == ["/manifest", "/streams", "/streams", "/streams"]
    assert entries[-1].topic == "/outcome"


@pytest.mark.parametrize("step", [7, pytest.param(1, marks=pytest.mark.slow)])
def test_a_cut_at_any_byte_keeps_the_messages_of_every_whole_chunk(step: int, whole: Path, tmp_path: Path) -> None:
    data, ends = whole.read_bytes(), chunk_ends(whole)
    entries, _ = _read(whole)
    path = tmp_path / "cut.mcap"
    path.write_bytes(data)
    for cut in sorted({*range(1, len(data), step), *ends, *(end - 1 for end in ends)}, reverse=True):
        with path.open("r+b") as file:
            file.truncate(cut)
        found, damage = _read(path)
        last_whole = max((end for end in ends if end <= cut), default=0)
        assert found == [entry for entry in entries if entry.chunk_offset < last_whole], f"cut at byte {cut}"
        assert len(damage) == 1
        assert last_whole <= damage[0].offset <= damage[0].end == cut


@pytest.mark.parametrize(
    "options",
    [
        {"compression": CompressionType.LZ4},
        {"compression": CompressionType.NONE},
        {"use_chunking": False},
        {"enable_crcs": False},
        {"compression": CompressionType.LZ4, "chunk_size": 200, "index_types": IndexType.NONE},
    ],
    ids=str,
)
def test_a_file_that_other_tools_have_rewritten_has_the_same_messages(
    whole: Path, tmp_path: Path, options: dict[str, Any]
) -> None:
    path = tmp_path / "rewritten.mcap"
    with whole.open("rb") as source, path.open("wb") as target:
        writer, ids = Writer(target, **options), {}
        for record in StreamReader(source).records:
            match record:
                case Header(profile=profile):
                    writer.start(profile=profile)
                case Schema(id=number, name=name, encoding=encoding, data=data):
                    ids["schema", number] = writer.register_schema(name, encoding, data)
                case Channel(id=number, topic=topic, message_encoding=encoding, schema_id=schema):
                    ids.setdefault(number, writer.register_channel(topic, encoding, ids["schema", schema]))
                case Message(channel_id=number):
                    times = record.log_time, record.data, record.publish_time, record.sequence
                    writer.add_message(ids[number], *times)
        writer.finish()
    entries, damage = _read(path)
    assert damage == []
    assert [replace(entry, chunk_offset=0) for entry in entries] == [
        replace(entry, chunk_offset=0) for entry in _read(whole)[0]
    ]


def test_an_lz4_chunk_that_unpacks_to_another_size_is_damage(tmp_path: Path) -> None:
    path = tmp_path / "bomb.mcap"
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.LZ4)
        writer.start(profile=PROFILE)
        register_topics(writer)
        writer.add_message(1, 0, b"\0" * 2**22, 0, 0)
        writer.finish()
    data = bytearray(path.read_bytes())
    at = data.index(b"\x03\0\0\0lz4") - 12
    data[at : at + 8] = struct.pack("<Q", 1000)
    path.write_bytes(data)
    entries, damage = _read(path)
    assert entries == [] and "another size" in damage[0].reason


def test_the_damage_names_its_bytes_and_a_record_that_ends_early_says_so(whole: Path, tmp_path: Path) -> None:
    data, ends = bytearray(whole.read_bytes()), chunk_ends(whole)
    offsets = sorted({entry.chunk_offset for entry in _read(whole)[0]})
    data[ends[2] - 3] ^= 1
    _, damage = _read(_written(tmp_path, data))
    assert [(found.offset, found.end) for found in damage] == [(offsets[2], offsets[3])]
    assert str(damage[0]).startswith(f"damage at bytes {offsets[2]} to {offsets[3]}: the record here is damaged (")
    data = bytearray(whole.read_bytes())
    at = data.rindex(b"/force")
    data[at - 1] = 0x7F
    assert "()" not in str(_read(_written(tmp_path, data))[1][0])


def test_damage_that_costs_nothing_is_seen_and_nothing_is_lost(whole: Path, tmp_path: Path) -> None:
    """The index records between the chunks may be broken: they are not needed."""
    data, ends = bytearray(whole.read_bytes()), chunk_ends(whole)
    data[ends[1] + 1 : ends[1] + 9] = (2**40).to_bytes(8, "little")
    found, damage = _read(_written(tmp_path, data))
    assert found == _read(whole)[0]
    assert len(damage) == 1


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(at=st.integers(0, 7000), replaced=st.integers(0, 60), junk=st.binary(max_size=60))
def test_junk_in_the_middle_makes_up_no_message(
    whole: Path, tmp_path: Path, at: int, replaced: int, junk: bytes
) -> None:
    data = whole.read_bytes()
    path = _written(tmp_path, data[:at] + junk + data[at + replaced :])
    known = {(entry.topic, entry.sequence, entry.data) for entry in _read(whole)[0]}
    assert {(entry.topic, entry.sequence, entry.data) for entry in _read(path)[0]} <= known


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(junk=st.binary(max_size=3000))
def test_any_bytes_after_a_right_beginning_are_read_to_their_end(whole: Path, tmp_path: Path, junk: bytes) -> None:
    entries, damage = _read(_written(tmp_path, whole.read_bytes()[:8] + junk))
    assert not entries
    assert damage


def _written(folder: Path, data: bytes | bytearray) -> Path:
    path = folder / "damaged.mcap"
    path.write_bytes(data)
    return path


def _read(path: Path) -> tuple[list[Entry], list[Damage]]:
    found = list(read_entries(path))
    entries = [item for item in found if isinstance(item, Entry)]
    return entries, [item for item in found if isinstance(item, Damage)]


@pytest.mark.parametrize("name", ["fake heads", "nested heads", "hidden chunks"])
def test_a_search_reads_a_file_a_few_times_however_often_it_is_led_astray(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = BOMBS[name](tmp_path / "a.mcap")
    size = path.stat().st_size
    good = chunk_with_an_event()
    with path.open("ab") as file:
        file.write(good)
    counted: list[int] = []

    class Counting(BufferedReader):
        def read(self, count: int | None = -1, /) -> bytes:
            found = super().read(count)
            counted.append(len(found))
            return found

    monkeypatch.setattr(chunks, "open_regular", lambda path: Counting(FileIO(path)))
    entries, damage = _read(path)
    assert sum(counted) < 20 * size
    assert len(counted) < size
    assert damage
    assert entries[-1].topic == "/events", "the good chunk behind the others is found"
