"""Errors of a recording.

RecordingError      the file cannot be read or made; one sentence says who, expected, found, what to do
├── WriteFailed     the disk took no more; names the last sample that is safely in the file
├── DamagedFile     so much of the file is damaged that it cannot be opened
└── ForeignFile     a file of another program is not what it should be
"""

from __future__ import annotations

from enum import StrEnum


class RecordingCode(StrEnum):
    """Stable codes of errors, for programs. The code of a class stands for any reason that has no code of its own."""

    FAILED = "recording_failed"
    UNREADABLE = "recording_failed.unreadable"
    EMPTY = "recording_failed.empty"
    NOT_MCAP = "recording_failed.not_mcap"
    OTHER_PROGRAM = "recording_failed.other_program"
    CUT = "recording_failed.cut"
    TOO_LARGE = "recording_failed.too_large"
    LATER_FORMAT = "recording_failed.later_format"
    MANIFEST = "recording_failed.wrong_manifest"
    NO_STREAM = "recording_failed.no_such_stream"
    WRONG_BLOCK = "recording_failed.wrong_block"
    WRONG_MESSAGE = "recording_failed.wrong_message"
    MESSAGE_NOT_KEPT = "recording_failed.message_not_kept"
    LABELS_LOST = "recording_failed.labels_lost"
    UNKNOWN_STREAM = "recording_failed.unknown_stream"
    EXISTS = "recording_failed.exists"
    OUTPUT_EXISTS = "recording_failed.output_exists"
    NOT_CREATABLE = "recording_failed.not_creatable"
    NOT_WRITABLE = "recording_failed.not_writable"
    NOT_DELETABLE = "recording_failed.not_deletable"

    WRITE_FAILED = "write_failed"
    CLOSED = "write_failed.closed"
    MOVED = "write_failed.file_moved"

    DAMAGED = "recording_damaged"
    MANIFEST_LOST = "recording_damaged.manifest_lost"

    FOREIGN = "foreign_file_unusable"
    FOREIGN_UNREADABLE = "foreign_file_unusable.unreadable"
    FOREIGN_EMPTY = "foreign_file_unusable.empty"
    FOREIGN_WRONG_TYPE = "foreign_file_unusable.wrong_file_type"
    FOREIGN_DAMAGED = "foreign_file_unusable.damaged"
    FOREIGN_CUT = "foreign_file_unusable.cut"
    FOREIGN_CONTRADICTORY = "foreign_file_unusable.contradictory"
    FOREIGN_NO_HEADER = "foreign_file_unusable.no_header"
    FOREIGN_TITLES = "foreign_file_unusable.wrong_titles"
    FOREIGN_NO_ROWS = "foreign_file_unusable.no_rows"
    FOREIGN_TOO_SHORT = "foreign_file_unusable.too_short"
    FOREIGN_NO_MARKERS = "foreign_file_unusable.no_markers"
    FOREIGN_NO_CHANNEL = "foreign_file_unusable.no_channel"
    FOREIGN_MISSING_COLUMN = "foreign_file_unusable.missing_column"
    FOREIGN_REPEATED_NAME = "foreign_file_unusable.repeated_name"
    FOREIGN_NO_RATE = "foreign_file_unusable.no_rate"
    FOREIGN_UNIT = "foreign_file_unusable.unknown_unit"
    FOREIGN_NOT_A_NUMBER = "foreign_file_unusable.not_a_number"
    FOREIGN_TIME_NOT_RISING = "foreign_file_unusable.time_not_rising"
    FOREIGN_MISSING_FRAME = "foreign_file_unusable.missing_frame"
    FOREIGN_NO_MOTION = "foreign_file_unusable.no_motion"


class RecordingError(Exception):
    """One sentence for the operator, a second may say what to do; code is for programs."""

    exit_code = 1
    general_code = RecordingCode.FAILED

    def __init__(self, sentence: str, code: RecordingCode | None = None) -> None:
        super().__init__(sentence)
        self.code = code or self.general_code


class WriteFailed(RecordingError):
    """The first failed write of a recording; every later call on its writer raises it again."""

    general_code = RecordingCode.WRITE_FAILED


class DamagedFile(RecordingError):
    """A recording whose manifest, or every message, is lost to damage."""

    general_code = RecordingCode.DAMAGED


class ForeignFile(RecordingError):
    """A file of another program that cannot be read: names the file, its line where there is one, and the fault."""

    general_code = RecordingCode.FOREIGN
