"""What can go wrong with a recording.

RecordingError      the file cannot be read or made; one sentence says who, expected, found, what to do
└── WriteFailed     the disk took no more; names the last sample that is safely in the file
"""

from __future__ import annotations


class RecordingError(Exception):
    """One sentence for the operator; a second may say what to do."""


class WriteFailed(RecordingError):
    """The first failed write of a recording; every later call on its writer raises it again."""
