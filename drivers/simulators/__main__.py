"""The simulated bench in a separate process, controlled by lines of JSON.

The first line on standard input is the settings (settings.py), with "speed", "seed" and "faults" (a list, faults.py)
beside them; the answer has "ports", "labels", "trial" and "truth". With speed null, the default, the world advances as
far as the attached stations have processed its data (control.py). Every further line is a request (requests.py) or
{"quit": true}, and is answered by one line. The process also ends when its standard input does.

An answer {"error": "…", "code": "…"} is a sentence and its code (errors.py); the bench continues, unless the settings
could not be used (exit code 2).
"""

from __future__ import annotations

import json
import signal
import sys
import threading
from collections.abc import Callable
from dataclasses import asdict
from queue import SimpleQueue
from typing import Any

from drivers.simulators.bench import Bench
from drivers.simulators.errors import SimulatorCode, SimulatorError, refusal
from drivers.simulators.faults import fault_from_dict
from drivers.simulators.requests import answer, speed_from
from drivers.simulators.settings import settings_from_dict
from drivers.simulators.world_clock import ClockStopped


def main() -> int:
    # Ctrl-C in a terminal reaches the whole group; the parent decides, and our standard input ends with it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    requests = _Requests()
    try:
        options = requests.next() or {}
        speed, seed = speed_from(options.pop("speed", None)), int(options.pop("seed", 0))
        plan = [fault_from_dict(entry) for entry in options.pop("faults", [])]
        bench = Bench(settings_from_dict(options), speed, seed, plan)
        with bench:
            world = bench.world
            _answer(ports=bench.ports, labels=world.labels, trial=asdict(world.trial), truth=world.truth())
            requests.when_ended(bench.clock.stop)
            _serve(bench, requests)
    except (ValueError, TypeError, OSError, RuntimeError) as error:
        _answer(**refusal(error))
        return 2
    return 0


class _Requests:
    """The lines of standard input, read by a thread of their own so that its end is noticed at once."""

    def __init__(self) -> None:
        self._ended = threading.Event()
        self._lines: SimpleQueue[str] = SimpleQueue()
        threading.Thread(target=self._read, name="requests", daemon=True).start()

    def when_ended(self, act: Callable[[], None]) -> None:
        """Call act, in a separate thread, when the input ends."""

        def wait() -> None:
            self._ended.wait()
            act()

        threading.Thread(target=wait, name="end of requests", daemon=True).start()

    def next(self) -> dict[str, Any] | None:
        """The next request, None at the end of input. Raises SimulatorError for a line that is not a JSON object."""
        line = self._lines.get()
        if not line:
            return None
        try:
            request = json.loads(line)
        except json.JSONDecodeError:
            request = None
        if not isinstance(request, dict):
            raise SimulatorError(
                f"expected a JSON object on one line, found {line.strip()!r}", SimulatorCode.WRONG_REQUEST
            )
        return request

    def _read(self) -> None:
        for line in sys.stdin:
            self._lines.put(line)
        self._ended.set()
        self._lines.put("")


def _serve(bench: Bench, requests: _Requests) -> None:
    while True:
        try:
            request = requests.next()
            if request is None:
                return
            _answer(**answer(bench, request))
            if "quit" in request:
                return
        except (ValueError, ClockStopped) as error:
            _answer(**refusal(error))


def _answer(**content: Any) -> None:
    print(json.dumps(content), flush=True)


if __name__ == "__main__":
    sys.exit(main())
