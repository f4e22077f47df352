"""Hashes inside a result. They show which parts were changed later, and which figures were entered by hand.

A hash is the SHA-256 of the JSON with sorted keys and numbers as doubles, so that reformatting a file does not change
it. It detects changes; it does not prevent a person from computing the hashes again (docs/security.md).
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

SEAL, REST = "seal", "rest"


class Standing(StrEnum):
    """Comparison of a file or figure with the hash recorded when it was written."""

    AS_RECORDED = "as recorded"
    CHANGED = "changed since"
    MISSING = "missing"
    BY_HAND = "given by hand"
    UNRECORDED = "no hash recorded"

    @property
    def is_break(self) -> bool:
        """Whether this breaks the chain of hashes from the report to the recordings."""
        return self in (Standing.CHANGED, Standing.MISSING)


@dataclass(frozen=True)
class CheckedFile:
    """An input file of a result, and its comparison with the hash recorded for it."""

    sha256: str
    standing: Standing


def seal_cuff(cuff: Mapping[str, Any], figures: Mapping[str, str]) -> dict[str, str]:
    """A hash for each figure of a cuff in cuffs.json, and one for the rest. figures: name → key."""
    rest = {key: value for key, value in cuff.items() if key not in figures.values()}
    return {**{name: digest(cuff.get(key)) for name, key in figures.items()}, REST: digest(rest)}


def check_cuff(name: str, cuff: Mapping[str, Any], seals: Any, figures: Mapping[str, str]) -> tuple[Standing, set[str]]:
    """Comparison of a cuff with its seal, and the names of the figures that are not those of the fit.

    seals are the hashes of the file, None if it has none: written by hand, or by an older station.
    """
    given = {figure for figure, key in figures.items() if has_value(cuff.get(key))}
    expected = seals.get(name) if isinstance(seals, Mapping) else None
    if not isinstance(expected, Mapping):
        if not cuff.get("sources"):
            return Standing.BY_HAND, given
        return (Standing.UNRECORDED if seals is None else Standing.CHANGED), set()
    found = seal_cuff(cuff, figures)
    differing = {part for part in found if found[part] != expected.get(part)}
    if differing - given:  # also a figure that was removed
        return Standing.CHANGED, differing & given
    return (Standing.BY_HAND if differing else Standing.AS_RECORDED), differing


def has_value(entry: Any) -> bool:
    """Whether a figure in cuffs.json has a value, as a number or as an object."""
    return (entry.get("value") if isinstance(entry, Mapping) else entry) is not None


def digest(value: Any) -> str:
    """SHA-256 of a JSON value."""
    plain = json.loads(json.dumps(value), parse_int=float)
    text = json.dumps(plain, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()
