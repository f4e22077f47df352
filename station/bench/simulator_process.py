"""The process of the simulated bench, started by SimulatedBench.

The first message is the settings; the answer has "ports", "labels", "trial" and "truth". Every further one is a request
(drivers/simulators/requests.py). The process ends with "quit" or with its parent, also during a long request.
"""

from __future__ import annotations

import threading
from contextlib import suppress
from queue import SimpleQueue
from typing import Any

from drivers.simulators.bench import Bench, bench_from_options, describe_bench
from drivers.simulators.errors import refusal
from drivers.simulators.requests import answer_or_refusal
from station.child import ProcessLink


def main(parent: ProcessLink) -> int:
    options = parent.receive()
    if options is None:
        return 0
    try:
        with bench_from_options(options) as bench:
            parent.send(describe_bench(bench))
            requests: SimpleQueue[dict[str, Any] | None] = SimpleQueue()
            threading.Thread(target=_receive, args=(parent, bench, requests), name="requests", daemon=True).start()
            for request in iter(requests.get, None):
                parent.send(answer_or_refusal(bench, request))
    except (ValueError, TypeError, OSError, RuntimeError) as error:
        with suppress(OSError):  # the parent has ended
            parent.send(refusal(error))
        return 2
    return 0


def _receive(parent: ProcessLink, bench: Bench, requests: SimpleQueue[dict[str, Any] | None]) -> None:
    for request in parent:
        if "quit" in request:
            break
        requests.put(request)
    bench.clock.stop()  # no request waits for it any longer
    requests.put(None)
