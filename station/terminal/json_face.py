"""A session as lines of JSON, one event a line: {"event": "verdict", …}; for a service or a program."""

from __future__ import annotations

import json
import math
from contextlib import suppress
from dataclasses import asdict
from typing import Any, TextIO

from station.session.live import Live
from station.terminal.events import Event


class JsonFace:
    def __init__(self, out: TextIO) -> None:
        self._out = out

    def tell(self, event: Event) -> None:
        line = json.dumps({"event": event.event, **_finite(asdict(event))}, ensure_ascii=False, allow_nan=False)
        with suppress(OSError, ValueError):  # nobody reads any more; the session goes on and its journal has it
            print(line, file=self._out, flush=True)

    def show(self, live: Live | None) -> None:
        """The status comes as an event, once a second."""


def _finite(value: Any) -> Any:
    """JSON has no word for an open end of an interval: null."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: _finite(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(inner) for inner in value]
    return value
