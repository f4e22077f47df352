"""A recovery keeps all that can be read, adds nothing, harms nothing and says what is missing."""

import os
import subprocess
import sys
from bisect import bisect_right
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.records import Chunk
from mcap.records import Message as McapMessage
from mcap.stream_reader import StreamReader, breakup_chunk

from recordings.errors import RecordingCode, RecordingError
from recordings.reader import open_recording
from recordings.recovery import RecoveryReport, recover, recovered_path
from tests.recordings.trials import chunk_ends, chunk_starts, items_of, record, trial
from tests.refusals import raises_refusal

Message = tuple[str, int, bytes]
"""Topic, time and bytes, as the mcap package reads them."""


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(tmp_path_factory.mktemp("whole") / "a.mcap", list(trial(1.0)))


def test_a_whole_file_is_copied_byte_for_byte_with_progress_in_bytes_of_the_source(whole: Path, tmp_path: Path) -> None:
    report = recover(whole, tmp_path / "b.mcap")
    assert report.lossless
    assert report.sentences() == ()
    assert report.output.read_bytes() == whole.read_bytes()
    bytes_read: list[int] = []
    recover(whole, tmp_path / "b.mcap", bytes_read.append)
    assert bytes_read == sorted(bytes_read) and len(bytes_read) == len(chunk_ends(whole))
    assert bytes_read[-1] == whole.stat().st_size


def test_a_file_cut_in_its_index_loses_nothing(whole: Path, tmp_path: Path) -> None:
    cut = _cut(whole, tmp_path, chunk_ends(whole)[-1] + 10)
    report = recover(cut)
    assert report.output == tmp_path / "cut.recovered.mcap" == recovered_path(cut)
    assert report.lossless
    assert report.output.read_bytes() == whole.read_bytes()


@pytest.mark.parametrize(
    ("seconds", "cuts"), [(3.7, 20), *(pytest.param(*case, marks=pytest.mark.slow) for case in ((3.7, 40), (60.0, 2)))]
)
def test_every_cut_keeps_exactly_the_whole_chunks(tmp_path: Path, seconds: float, cuts: int) -> None:
    """The long file has hundreds of chunks, the short one is cut at many places, in both cases at different ones."""
    victim = Victim(whole_file(tmp_path, seconds), tmp_path)
    for size in np.random.default_rng(cuts).integers(0, len(victim.data) + 1, cuts).tolist():
        victim.ensure_cut_is_recovered(size)
    assert len(victim.kept) > cuts / 2


def test_a_cut_around_any_record_keeps_exactly_the_whole_chunks(tmp_path: Path) -> None:
    victim = Victim(whole_file(tmp_path, 0.3), tmp_path)
    for boundary in record_boundaries(victim.data):
        for size in {max(0, boundary - 1), boundary, min(boundary + 1, len(victim.data))}:
            victim.ensure_cut_is_recovered(size)
    assert max(victim.kept) == len(victim.messages)


def test_a_flipped_bit_costs_no_more_than_its_chunk(tmp_path: Path) -> None:
    victim = Victim(whole_file(tmp_path, 3.7), tmp_path)
    for bit in np.random.default_rng(5).integers(0, 8 * len(victim.data), 20).tolist():
        victim.ensure_flip_is_recovered(bit)
    assert min(victim.kept) < len(victim.messages)


def test_what_is_missing_is_listed_exactly(whole: Path, tmp_path: Path) -> None:
    ends = chunk_ends(whole)
    damaged = bytearray(whole.read_bytes()[: ends[6]])
    damaged[ends[3] - 3] ^= 1  # this chunk holds markers, the first mark, and force
    path = tmp_path / "damaged.mcap"
    path.write_bytes(damaged)
    report = recover(path)
    assert not report.lossless
    sentences = "\n".join(report.sentences())
    assert "the record here is damaged" in sentences
    assert "the file ends before its index" in sentences
    assert "there is no outcome: the recording was cut" in sentences
    for gap in report.contents.gaps:
        assert gap.cause == "file_damage"
        assert f"{gap.stream} lost samples {gap.first_missing} to {gap.first_missing + gap.count - 1}" in sentences
    assert {gap.stream for gap in report.contents.gaps} == {"/force", "/markers"}
    assert "/force holds 5 of 6 messages" in sentences
    kept = report.contents.streams["/force"]
    last_s = kept.last_sample_number / 1000
    expected = f"/force keeps {kept.samples} samples, the last is number {kept.last_sample_number} at {last_s:.3f} s"
    assert expected in sentences


def test_a_stream_of_which_nothing_is_left_has_no_last_sample(whole: Path, tmp_path: Path) -> None:
    sentences = recover(_cut(whole, tmp_path, chunk_ends(whole)[0])).sentences()  # manifest and streams
    assert {"/force keeps no sample", "/markers keeps no sample"} <= set(sentences)


def test_recovering_again_changes_nothing(whole: Path, tmp_path: Path) -> None:
    cut = _cut(whole, tmp_path, whole.stat().st_size // 2)
    first = recover(cut)
    data = first.output.read_bytes()
    assert recover(cut) == first and not open_recording(first.output).complete
    assert first.output.read_bytes() == data
    assert recover(first.output, tmp_path / "twice.mcap").output.read_bytes() == data
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cut.mcap", "cut.recovered.mcap", "twice.mcap"]


def test_two_that_recover_one_file_at_once_do_not_spoil_it(whole: Path, tmp_path: Path) -> None:
    cut = _cut(whole, tmp_path, chunk_ends(whole)[-1] + 10)
    code = f"from pathlib import Path; from recordings.recovery import recover; recover(Path({str(cut)!r}))"
    others: list[int] = []

    def meanwhile(_done: int) -> None:
        if not others:
            others.append(subprocess.run([sys.executable, "-c", code], check=True).returncode)  # noqa: S603

    report = recover(cut, progress=meanwhile)
    assert others == [0]
    assert report.lossless and report.output.read_bytes() == whole.read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cut.mcap", "cut.recovered.mcap"]


def test_a_damaged_first_chunk_costs_neither_manifest_nor_samples(whole: Path, tmp_path: Path) -> None:
    damaged = bytearray(whole.read_bytes())
    damaged[chunk_ends(whole)[0] - 3] ^= 1
    path = tmp_path / "damaged.mcap"
    path.write_bytes(damaged)
    report = recover(path)
    assert items_of(open_recording(report.output)) == items_of(open_recording(whole))
    assert open_recording(report.output).manifest == open_recording(whole).manifest


def test_without_any_manifest_the_samples_are_kept_all_the_same(whole: Path, tmp_path: Path) -> None:
    ends = chunk_ends(whole)
    damaged = bytearray(whole.read_bytes()[: ends[-3]])
    damaged[ends[0] - 3] ^= 1
    path = tmp_path / "damaged.mcap"
    path.write_bytes(damaged)
    with raises_refusal(RecordingCode.MANIFEST_LOST):
        open_recording(path)
    report = recover(path)
    assert report.contents.manifest is None
    assert report.contents.streams["/force"].samples > 0


def test_a_different_file_of_the_same_name_is_left_alone(whole: Path, tmp_path: Path) -> None:
    cut = _cut(whole, tmp_path, whole.stat().st_size // 2)
    (tmp_path / "b.mcap").write_bytes(b"precious")
    with raises_refusal(RecordingCode.OUTPUT_EXISTS):
        recover(cut, tmp_path / "b.mcap")
    assert (tmp_path / "b.mcap").read_bytes() == b"precious"
    with raises_refusal(RecordingCode.OUTPUT_EXISTS):
        recover(cut, cut)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["b.mcap", "cut.mcap"]


def test_a_different_file_of_the_same_size_and_time_is_left_alone(whole: Path, tmp_path: Path) -> None:
    other = tmp_path / "b.mcap"
    different = bytes([255 - whole.read_bytes()[0]]) + whole.read_bytes()[1:]
    other.write_bytes(different)

    def give_it_the_time_of_the_copy(_: int) -> None:
        (part,) = tmp_path.glob(".draft-*/b.mcap")
        os.utime(other, ns=(part.stat().st_mtime_ns,) * 2)

    with raises_refusal(RecordingCode.OUTPUT_EXISTS):
        recover(whole, other, give_it_the_time_of_the_copy)
    assert other.read_bytes() == different


def test_a_file_with_nothing_to_keep_leaves_no_output(tmp_path: Path, whole: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_text("time,force\n", encoding="utf-8")
    with raises_refusal(RecordingCode.NOT_MCAP):
        recover(path)
    assert list(tmp_path.iterdir()) == [path]
    with raises_refusal(RecordingCode.NOT_WRITABLE):
        recover(whole, tmp_path / "no_such_folder" / "b.mcap")


def _cut(whole: Path, folder: Path, size: int) -> Path:
    path = folder / "cut.mcap"
    path.write_bytes(whole.read_bytes()[:size])
    return path


def whole_file(folder: Path, seconds: float) -> Path:
    return record(folder / f"whole-{seconds:g}.mcap", list(trial(seconds)))


@dataclass
class Victim:
    """One whole recording; every spoilt copy takes the place of the one before."""

    whole: Path
    folder: Path
    kept: list[int] = field(default_factory=list)  # by copy, messages that were recovered

    def __post_init__(self) -> None:
        self.data = self.whole.read_bytes()
        self.ends = chunk_ends(self.whole)
        self.starts = chunk_starts(self.whole)
        self.messages = _messages(self.whole)
        self.counts = _messages_by_chunk(self.whole)
        self._seen: dict[int, tuple[bytes, list[Any]]] = {}  # by number of whole chunks, a recovery and its items
        self._spoilt, self._output = self.folder / "spoilt.mcap", self.folder / "spoilt.recovered.mcap"

    def ensure_cut_is_recovered(self, size: int) -> None:
        """Exactly the whole chunks are kept, as the reader finds them in the cut file itself.

        Recoveries of the same chunks have the same bytes: the other checks of these are made once.
        """
        chunks = bisect_right(self.ends, size)
        report = self._recovered(self.data[:size])
        if report is None:
            assert chunks == 0
            return
        recovered = report.output.read_bytes()
        if chunks not in self._seen:
            self._seen[chunks] = recovered, items_of(open_recording(report.output))
            messages = self.messages[: sum(self.counts[:chunks])]
            assert _messages(report.output) == messages
            assert len(messages) == sum(topic.messages for topic in report.contents.topics.values())
            with report.output.open("rb") as file:
                summary = make_reader(file, validate_crcs=True).get_summary()
                assert summary.statistics.message_count == len(messages)
                file.seek(0)
                assert len(list(StreamReader(file, validate_crcs=True).records)) > len(messages)
            assert recover(self._spoilt) == report
            assert report.output.read_bytes() == recovered
            assert report.lossless == (chunks == len(self.ends))
        assert (recovered, items_of(open_recording(self._spoilt))) == self._seen[chunks]
        self.kept.append(sum(self.counts[:chunks]))

    def ensure_flip_is_recovered(self, bit: int) -> None:
        """All is kept but the chunk with the flipped bit, and nothing is kept that was not there."""
        spoilt = bytearray(self.data)
        spoilt[bit // 8] ^= 1 << bit % 8
        hit = [i for i, (a, b) in enumerate(zip(self.starts, self.ends, strict=True)) if a <= bit // 8 < b]
        report = self._recovered(bytes(spoilt))
        messages = _messages(report.output)
        assert messages in (self.messages, *(self._without(chunk) for chunk in hit))
        assert messages == self.messages or (not report.lossless and report.sentences())
        self.kept.append(len(messages))

    def _recovered(self, spoilt: bytes) -> RecoveryReport | None:
        """None where there was nothing to keep, and a sentence said so."""
        self._output.unlink(missing_ok=True)
        self._spoilt.write_bytes(spoilt)
        try:
            report = recover(self._spoilt)
        except RecordingError as error:
            assert "\n" not in str(error)
            assert not self._output.exists()
            return None
        assert self._spoilt.read_bytes() == spoilt
        return report

    def _without(self, chunk: int) -> list[Message]:
        first = sum(self.counts[:chunk])
        return self.messages[:first] + self.messages[first + self.counts[chunk] :]


def record_boundaries(data: bytes) -> list[int]:
    """Where the records of an MCAP file begin: an opcode, a length of eight bytes, and as many bytes."""
    boundaries, place = [0], 8
    while place < len(data) - 8:
        boundaries.append(place)
        place += 9 + int.from_bytes(data[place + 1 : place + 9], "little")
    return [*boundaries, place, len(data)]


def _messages(path: Path) -> list[Message]:
    """In file order, by the index, with every CRC checked."""
    with path.open("rb") as file:
        read = make_reader(file, validate_crcs=True).iter_messages(log_time_order=False)
        return [(channel.topic, message.log_time, message.data) for _, channel, message in read]


def _messages_by_chunk(path: Path) -> list[int]:
    with path.open("rb") as file:
        chunks = [one for one in StreamReader(file, emit_chunks=True).records if isinstance(one, Chunk)]
    return [sum(isinstance(one, McapMessage) for one in breakup_chunk(chunk)) for chunk in chunks]
