"""Conditions that start and end one trial."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

POST_ROLL_S = 0.5
"""Station seconds recorded after the end of the capture, so that the falling edge of the sync line is in the file."""


@dataclass(frozen=True)
class TrialRules:
    """Times are station seconds; duration_s None: until the capture ends."""

    start: Literal["sync_edge", "pfi0"]
    threshold_v: float
    timeout_s: float
    duration_s: float | None
    post_roll_s: float = POST_ROLL_S
