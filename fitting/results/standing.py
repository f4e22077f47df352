"""Comparison of files and figures with what was recorded when they were written."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Standing(StrEnum):
    """Comparison of a file with the hash recorded when it was written, or of a figure with the fit."""

    AS_RECORDED = "as recorded"
    CHANGED = "changed since"
    MISSING = "missing"
    ADDED = "added since"
    BY_HAND = "given by hand"
    UNRECORDED = "no hash recorded"

    @property
    def is_break(self) -> bool:
        """Whether this breaks the chain of hashes from the report to the recordings."""
        return self in (Standing.CHANGED, Standing.MISSING, Standing.ADDED)


@dataclass(frozen=True)
class CheckedFile:
    """An input file of a result, and its comparison with the hash recorded for it."""

    sha256: str
    standing: Standing
