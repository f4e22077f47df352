"""The simulated bench in a process of its own, spoken to in lines of JSON.

The first line on standard input is the settings (settings.py), with "speed", "seed" and "faults" (a list, faults.py)
beside them; the answer tells "ports", "labels", "trial" and "truth". Each further line is one request, answered by one:

    {"trial": {"cuff": "hand", "test": "static"}}   sets that trial up, for this and the following captures
    {"trial": {"cuff": null, "test": "bounce"}}     the weight on its spring, where the settings have one
    {"don": "hand"}                                 dons the cuff anew
    {"pause_s": 60}                                 answers when so many seconds of the world have passed
    {"fault": {"device": "ni", "fault": "unplug"}}  goes wrong now, or at_s from now (faults.py)
    {"truth": true}                                 parameters by cuff, and what each has slipped since it was donned
    {"quit": true}                                  ends; so does the end of standard input

An answer {"error": "…"} is a sentence; the bench goes on, unless the settings could not be used (exit code 2).
"""

from __future__ import annotations

import json
import signal
import sys
import threading
from dataclasses import asdict
from queue import SimpleQueue
from typing import Any

from drivers.simulators.bench import Bench
from drivers.simulators.faults import fault_from_dict
from drivers.simulators.settings import settings_from_dict


def main() -> int:
    # Ctrl-C in a terminal reaches the whole group; the parent decides, and our standard input ends with it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    requests = _Requests()
    try:
        options = requests.next() or {}
        speed, seed = float(options.pop("speed", 1.0)), int(options.pop("seed", 0))
        plan = [fault_from_dict(entry) for entry in options.pop("faults", [])]
        bench = Bench(settings_from_dict(options), speed, seed, plan)
        with bench:
            world = bench.world
            _answer(ports=bench.ports, labels=world.labels, trial=asdict(world.trial), truth=world.truth())
            _serve(bench, requests)
    except (ValueError, TypeError, OSError, RuntimeError) as error:
        _answer(error=str(error))
        return 2
    return 0


class _Requests:
    """The lines of standard input, read by a thread of their own so that its end is noticed at once."""

    def __init__(self) -> None:
        self.ended = threading.Event()
        self._lines: SimpleQueue[str] = SimpleQueue()
        threading.Thread(target=self._read, name="requests", daemon=True).start()

    def next(self) -> dict[str, Any] | None:
        """The next request, None at the end of input. Raises ValueError where a line is no JSON object."""
        line = self._lines.get()
        if not line:
            return None
        try:
            request = json.loads(line)
        except json.JSONDecodeError:
            request = None
        if not isinstance(request, dict):
            raise ValueError(f"expected a JSON object on one line, found {line.strip()!r}")
        return request

    def _read(self) -> None:
        for line in sys.stdin:
            self._lines.put(line)
        self.ended.set()
        self._lines.put("")


def _serve(bench: Bench, requests: _Requests) -> None:
    while True:
        try:
            request = requests.next()
            if request is None:
                return
            _answer(**_obeyed(bench, request, requests.ended))
            if "quit" in request:
                return
        except ValueError as error:
            _answer(error=str(error))


def _obeyed(bench: Bench, request: dict[str, Any], ended: threading.Event) -> dict[str, Any]:
    """The answer to one request. Raises ValueError where it is not understood."""
    match request:
        case {"trial": {"cuff": str() | None as cuff, "test": "static" | "dynamic" | "bounce" as test}}:
            return {"trial": asdict(bench.world.select_trial(cuff, test))}
        case {"don": str(cuff)}:
            return {"trial": asdict(bench.world.don(cuff))}
        case {"pause_s": int() | float() as seconds}:
            ended.wait(seconds / bench.world.speed)
            return {"pause_s": seconds}
        case {"fault": dict(fault)}:
            return {"fault": bench.world.faults.inject(fault_from_dict(fault))}
        case {"truth": True}:
            return {"truth": bench.world.truth()}
        case {"quit": True}:
            return {"quit": True}
        case _:
            raise ValueError(f"no request is {json.dumps(request)}; known are trial, don, fault, pause_s, truth, quit")


def _answer(**content: Any) -> None:
    print(json.dumps(content), flush=True)


if __name__ == "__main__":
    sys.exit(main())
