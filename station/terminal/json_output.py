"""A session as lines of JSON, one event per line: {"event": "verdict", …}; for a service or a program."""

from __future__ import annotations

import json
import math
from contextlib import suppress
from dataclasses import asdict
from typing import Any, TextIO

from station.session.live_trial import LiveTrial
from station.terminal.events import Event


class JsonOutput:
    def __init__(self, out: TextIO) -> None:
        self._out = out

    def show_event(self, event: Event) -> None:
        line = json.dumps({"event": event.event, **_finite(asdict(event))}, ensure_ascii=False, allow_nan=False)
        with suppress(OSError, ValueError):  # the reader has ended; the session continues and its journal has it
            print(line, file=self._out, flush=True)

    def show_trial(self, live: LiveTrial | None) -> None:
        """The status is an event, once a second."""


def _finite(value: Any) -> Any:
    """Replace the open end of an interval by null, because JSON has no infinity."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: _finite(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(inner) for inner in value]
    return value
