"""Codes of reasons why a folder of recordings is not assessed on its wearer."""

from __future__ import annotations

from enum import StrEnum


class SubjectCode(StrEnum):
    """What is wrong with subject.toml, or missing in its folder."""

    UNREADABLE = "subject.unreadable"
    INVALID_KEY = "subject.invalid_key"
    NO_MASS = "subject.no_mass"
    UNKNOWN_MARKERS = "subject.unknown_markers"
    NO_MOTION = "subject.no_motion"
    UNKNOWN_CUFF = "subject.unknown_cuff"
