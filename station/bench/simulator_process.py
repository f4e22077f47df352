"""The process of the simulated bench, started by SimulatedBench.

The first message is the settings; the answer has "ports", "labels", "trial" and "truth". Every further one is a request
(drivers/simulators/requests.py). The process ends with "quit" or with its parent, also during a long request. With the
argument "outlives" it stays for a trial that is still recorded then, whose hands finish it without a console.
"""

from __future__ import annotations

import threading
import time
from contextlib import suppress
from queue import SimpleQueue
from typing import Any

from drivers.simulators.errors import refusal
from drivers.simulators.requests import answer_or_refusal
from drivers.simulators.simulated_bench import Bench, bench_from_options, describe_bench
from station.child import ProcessLink

LAST_STEP = 1_000_000
"""A step beyond every trial: the hands then follow their own times."""
POLL_S, LEFT_ALONE_S = 0.2, 5.0
"""Wall seconds; a bench without any station for LEFT_ALONE_S ends. A recorder needs less to begin."""


def main(parent: ProcessLink, *arguments: str) -> int:
    options = parent.receive()
    if options is None:
        return 0
    outlives = "outlives" in arguments
    try:
        with bench_from_options(options) as bench:
            parent.send(describe_bench(bench))
            requests: SimpleQueue[dict[str, Any] | None] = SimpleQueue()
            receiving = (parent, bench, requests, outlives)
            threading.Thread(target=_receive, args=receiving, name="requests", daemon=True).start()
            for request in iter(requests.get, None):
                with suppress(OSError):  # the parent has ended
                    parent.send(answer_or_refusal(bench, request))
            if outlives:
                _finish_alone(bench)
    except (ValueError, TypeError, OSError, RuntimeError) as error:
        with suppress(OSError):  # the parent has ended
            parent.send(refusal(error))
        return 2
    return 0


def _receive(
    parent: ProcessLink,
    bench: Bench,
    requests: SimpleQueue[dict[str, Any] | None],
    outlives: bool,  # noqa: FBT001
) -> None:
    is_asked = False
    for request in parent:
        is_asked = "quit" in request
        if is_asked:
            break
        requests.put(request)
    if not outlives or (is_asked and not bench.clock.has_stations):
        bench.clock.stop()  # no request waits for it any longer
    requests.put(None)


def _finish_alone(bench: Bench) -> None:
    """Return when no station has been attached for LEFT_ALONE_S, or the world has ended."""
    last_s = time.perf_counter()
    while not bench.clock.has_ended and time.perf_counter() - last_s < LEFT_ALONE_S:
        bench.world.follow(LAST_STEP)
        if bench.clock.has_stations:
            last_s = time.perf_counter()
        time.sleep(POLL_S)
