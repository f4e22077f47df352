"""Codes of messages on the validation with measured joint forces."""

from __future__ import annotations

from enum import StrEnum


class ValidationCode(StrEnum):
    """Reason why a folder is not validated, and the verdict."""

    NOT_A_FOLDER = "validation.not_a_folder"
    NO_LIFT = "validation.no_lift"
    FILES_MISSING = "validation.files_missing"
    NO_BODY_WEIGHT = "validation.no_body_weight"
    DIFFERENT_FORCES = "validation.different_forces"
    NOT_COVERED = "validation.not_covered"
    TIMES_DIFFER = "validation.times_differ"
    WITHIN_LIMITS = "validation.within_limits"
    BEYOND_LIMITS = "validation.beyond_limits"
    NOTHING_PUBLISHED = "validation.nothing_published"
    LIFT_LEFT_OUT = "validation.lift_left_out"
    PARTLY_PUBLISHED = "validation.partly_published"
    UNSOLVED = "validation.unsolved_frames"
    START_NOT_MARKED = "validation.start_not_marked"
    PUBLISHED_MISSING = "validation.published_missing"
    PUBLISHED_UNUSED = "validation.published_unused"
    LOW_CORRELATION = "validation.low_correlation"
