"""Time-outs of tests: a bound on failing tests, not an expectation, so that they scale with the load of the machine."""

import os

import psutil

SLOWEST = 4.0  # a machine may be so much slower than an idle one of ours, whatever its load average says


def scaled_timeout(seconds: float) -> float:
    """The time-out in seconds for a test, or a wait in one, that is given `seconds` on an idle machine.

    The scheduler divides the cores among the processes that want to run, whose number the load average is. Ask when the
    wait begins, not when the module is imported: the load comes and goes. A core may be slow, or shared with other
    machines, which no load average shows; a long time-out costs a passing test nothing.
    """
    try:
        load_per_core = psutil.getloadavg()[0] / count_cores()
    except RuntimeError:  # Windows without performance counters, and Wine
        load_per_core = 1.0
    return seconds * max(SLOWEST, load_per_core)


def count_cores() -> int:
    """The cores that this process may use: fewer than the machine has where it is pinned."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
