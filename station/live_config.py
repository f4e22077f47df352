"""Section [live] of station.toml: muscles and suit while the wearer moves. Off by default."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from documents.validation import Positive


class LiveSection(BaseModel):
    """What is solved live in pose and motion trials, and where it goes besides the views."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    enabled: bool = False
    lag_s: float = Field(default=0.15, ge=0, le=0.2)  # of the smoother: more lag, more accurate (docs/live.md)
    highest_rate_hz: Positive = 100.0  # frames per second that are solved; cameras that send more are decimated
    model: str = ""  # .osim; without it the wearer's body from the session's earlier trials, or the bundled one
    suit: Path | None = None  # suit.toml; without it the bundled suit
    cuffs: Path | None = None  # without it cuffs.json of the session; without both only rigid cuffs
    arm_cuff: str = ""  # that is worn; without it that of subject.toml, else the only one fitted
    other_cuff: str = ""  # a further scenario
    rest_length_m: Positive | None = None  # without it that of subject.toml, or the suit's reference
    rest_lengths_m: tuple[Positive, ...] = Field(default=(), max_length=4)  # further scenarios, for the best length
    writes_file: bool = True  # live/TRIAL.live.mcap in the session's folder
    outlet: str = ""  # a Lab Streaming Layer outlet: "loopback", a network interface such as "eth0", or "any"
    outlet_name: Annotated[str, Field(min_length=1)] = "cuffstation live"

    def without_cuffs(self) -> LiveSection:
        """The same with rigid cuffs only."""
        return self.model_copy(update={"cuffs": None, "arm_cuff": "", "other_cuff": ""})
