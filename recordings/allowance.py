"""What reading a file may cost: so much for each of its bytes, that no few kilobytes unpack to gigabytes.

A recorder's own files are far below: their samples take twice the file's size, and a message a hundred of its bytes.
"""

from __future__ import annotations

from typing import NoReturn

from recordings.errors import RecordingError

UNPACKED, UNPACKED_PER_BYTE = 64 * 2**20, 50
"""Bytes that the chunks of a file may unpack to, and besides for each of its own."""
RECORDS, BYTES_PER_RECORD = 20_000, 8
"""Records that they may hold, and one more for so many bytes of the file."""
SEARCHED_AGAIN = 4
"""Times a file's size: bytes that a search after damage may go over once more."""


class Excess(RecordingError):
    """The file costs more than its size allows."""


class Allowance:
    """What is left for one reading of a file of `size` bytes."""

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
        """Where to search on when start to end was read in vain: at its start, as long as that may be gone over."""
        self._searched_again -= max(0, end - start)
        return start if self._searched_again >= 0 else max(start, end)

    def _exceed(self, what: str) -> NoReturn:
        raise Excess(f"{what} in a file of {self._size} bytes")
