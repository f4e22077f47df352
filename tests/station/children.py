"""Children of tests: the first argument of main() names their behaviour."""

import sys
from threading import Event, Thread
from typing import Any

from station.child import Child, ProcessLink, exit_at_once


def main(parent: ProcessLink, behaviour: str, *arguments: str) -> int:
    return int(BEHAVIOURS[behaviour](parent, *arguments) or 0)


def start(behaviour: str, *arguments: str, **options: Any) -> Child:
    return Child("tests.station.children", behaviour, *arguments, **options)


def crash(_: ProcessLink) -> int:
    """End before anything is received."""
    return 3


def freeze(parent: ProcessLink) -> None:
    """Send one message and receive nothing, for ever."""
    parent.send({"is_frozen": True})
    Event().wait()


def echo(parent: ProcessLink) -> int:
    """Send every message back, and end with the parent."""
    while (data := parent.receive_bytes()) is not None:
        parent.send_bytes(data)
    return 4


def load_library(parent: ProcessLink) -> None:
    """Load a library that queries the standard handles while another thread receives."""
    Thread(target=parent.receive_bytes, daemon=True).start()
    import scipy.linalg

    parent.send({"norm": float(scipy.linalg.norm([3.0, 4.0])), "stdin": sys.stdin.read()})
    exit_at_once(5)


def relay(grandparent: ProcessLink, module: str, *arguments: str) -> None:
    """Start a child of its own, and pass messages on to it and its answers back."""
    child = Child(module, *arguments)
    for message in grandparent:
        child.send(message)
        grandparent.send(child.receive() or {"has_ended": True})


def report_kernels(parent: ProcessLink, *numbers: str) -> int:
    """Report how many kernels of 8 are ready; the last number is the exit code."""
    for ready in numbers[:-1]:
        parent.send({"ready": int(ready), "kernels": 8})
    return int(numbers[-1])


BEHAVIOURS: dict[str, Any] = {
    behaviour.__name__: behaviour for behaviour in (crash, freeze, echo, load_library, relay, report_kernels)
}
