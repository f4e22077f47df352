"""What can go wrong with a recording.

RecordingError      the file cannot be read or made; one sentence says who, expected, found, what to do
├── WriteFailed     the disk took no more; names the last sample that is safely in the file
├── DamagedFile     so much of the file is damaged that it cannot be opened
└── ForeignFile     a file of another program is not what it should be
"""

from __future__ import annotations


class RecordingError(Exception):
    """One sentence for the operator; a second may say what to do."""

    exit_code = 1


class WriteFailed(RecordingError):
    """The first failed write of a recording; every later call on its writer raises it again."""


class DamagedFile(RecordingError):
    """A recording whose manifest, or every message, is lost to damage."""


class ForeignFile(RecordingError):
    """A file of another program that cannot be read: names the file, its line where there is one, and the fault."""
