"""A recording that is cut and damaged again and again, and what a recovery must make of it each time."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, field
from pathlib import Path

from mcap.reader import make_reader
from mcap.records import Chunk
from mcap.records import Message as McapMessage
from mcap.stream_reader import StreamReader, breakup_chunk

from recordings.errors import RecordingError
from recordings.recovery import RecoveryReport, recover
from tests.recordings.trials import chunk_ends, chunk_starts, record, trial

Message = tuple[str, int, bytes]
"""Topic, time and bytes, as the mcap package reads them."""


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
        self._seen: dict[int, bytes] = {}  # by number of whole chunks, what a recovery made of them
        self._spoilt, self._output = self.folder / "spoilt.mcap", self.folder / "spoilt.recovered.mcap"

    def ensure_cut_is_recovered(self, size: int) -> None:
        """Exactly the whole chunks are kept; the same bytes for the same chunks, and checked in full the first time."""
        chunks = bisect_right(self.ends, size)
        report = self._recovered(self.data[:size])
        if report is None:
            assert chunks == 0
            return
        recovered = report.output.read_bytes()
        if chunks not in self._seen:
            self._seen[chunks] = recovered
            assert _messages(report.output) == self.messages[: sum(self.counts[:chunks])]
            assert recover(self._spoilt) == report
            assert report.output.read_bytes() == recovered
            assert report.lossless == (chunks == len(self.ends))
        assert recovered == self._seen[chunks]
        self.kept.append(sum(self.counts[:chunks]))

    def ensure_flip_is_recovered(self, bit: int) -> None:
        """All is kept but the chunk with the flipped bit, and nothing is kept that was not there."""
        spoilt = bytearray(self.data)
        spoilt[bit // 8] ^= 1 << bit % 8
        hit = [i for i, (a, b) in enumerate(zip(self.starts, self.ends, strict=True)) if a <= bit // 8 < b]
        report = self._recovered(bytes(spoilt))
        assert report is not None
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
