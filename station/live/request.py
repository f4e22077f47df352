"""What the recorder asks of the live process: the first message."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pydantic import TypeAdapter

from station.protocol import TrialSpec


@dataclass(frozen=True)
class LiveRequest:
    """config as in station.toml; before_utc_ns: only trials that began earlier give the body of the wearer."""

    config: dict[str, Any]
    folder: str
    spec: TrialSpec
    before_utc_ns: int


REQUEST = TypeAdapter(LiveRequest)
