"""A console without a recorder: its trials consist of one line of telemetry, the first argument, and end when stopped.

The page shows that line at once and on any computer.
"""

import json
import sys
from collections.abc import Iterator
from queue import SimpleQueue
from typing import Any

from station.cli import main
from station.session import trial_runner
from tests.station.console.served import be_patient


class ShownTrial:
    """In place of the child process that records a trial."""

    def __init__(self, *_: object, **__: object) -> None:
        self._commands: SimpleQueue[dict[str, Any]] = SimpleQueue()

    def send(self, command: dict[str, Any]) -> None:
        self._commands.put(command)

    def __iter__(self) -> Iterator[dict[str, Any]]:
        yield TELEMETRY
        while "stop" not in self._commands.get():
            pass
        yield {"refused": "the shown trial ends", "code": "shown"}

    def ensure_ended(self, _timeout_s: float) -> int:
        return 0


if __name__ == "__main__":
    TELEMETRY = json.loads(sys.argv.pop(1))
    trial_runner.Child = ShownTrial  # type: ignore[misc,assignment]
    be_patient()
    main()
