"""Read session.jsonl and assessment.json of stations without "format"; their keys mean the same as in format 1."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def upgrade(plain: Mapping[str, Any]) -> dict[str, Any]:
    """The document, or the line, as format 1. One that has a format is returned unchanged, for the schema to check."""
    return dict(plain) if "format" in plain else {**plain, "format": 1}
