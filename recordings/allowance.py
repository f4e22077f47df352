"""Limits on the cost of reading a file, per byte of the file, so that a few kilobytes cannot unpack to gigabytes.

Recorded files are far below them: samples take twice the size of the file, and a message takes about 100 bytes.
"""

from __future__ import annotations

from typing import NoReturn

from recordings.errors import RecordingCode, RecordingError

UNPACKED, UNPACKED_PER_BYTE = 64 * 2**20, 50
"""Bytes that the chunks of a file may unpack to: a constant, plus this for every byte of the file."""
RECORDS, BYTES_PER_RECORD = 20_000, 8
"""Records that the chunks may hold: a constant, plus one for every BYTES_PER_RECORD of the file."""
SEARCHED_AGAIN = 4
"""Bytes that searches after damage may read again, as a multiple of the size of the file."""


class Excess(RecordingError):
    """The file exceeds the limits for its size."""

    general_code = RecordingCode.TOO_LARGE


class Allowance:
    """Remaining allowance while a file of `size` bytes is read."""

    def __init__(self, size: int) -> None:
        self._size = size
        self._unpacked = self._most_unpacked = UNPACKED + UNPACKED_PER_BYTE * size
        self._searched_again = SEARCHED_AGAIN * size
        self.records = self._most_records = RECORDS + size // BYTES_PER_RECORD

    def unpack(self, count: int) -> None:
        """Raises Excess where these bytes are too many."""
        self._unpacked -= count
        if self._unpacked < 0:
            self._exceed(f"unpacks to more than {self._most_unpacked} bytes")

    def hold(self, records: int) -> None:
        """Raises Excess where these records are too many."""
        self.records -= records
        if self.records < 0:
            self._exceed(f"holds more than {self._most_records} records")

    def search_again(self, start: int, end: int) -> int:
        """Where to continue a search after `start` to `end` held nothing: at `start`, while it may be read again."""
        self._searched_again -= max(0, end - start)
        return start if self._searched_again >= 0 else max(start, end)

    def _exceed(self, what: str) -> NoReturn:
        raise Excess(f"{what} in a file of {self._size} bytes")
