"""Rerun's viewer, started so that it listens on this machine only and tells nobody of it."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time

from station.errors import StationError

WAIT_S = 20.0


class ViewerError(StationError):
    """The viewer did not start; one sentence."""


def start_viewer() -> str:
    """Starts a viewer in a process of its own, which outlives this one, and returns the address it listens at."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    child = subprocess.Popen(  # noqa: S603  (our own words)
        [sys.executable, "-m", "rerun", "--bind", "127.0.0.1", "--port", str(port), "--memory-limit", "1GB"],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "RERUN_ANALYTICS_ENABLED": "false", "DO_NOT_TRACK": "1"},
    )
    until = time.monotonic() + WAIT_S
    while time.monotonic() < until and child.poll() is None:
        with socket.socket() as tried:
            tried.settimeout(1.0)
            if tried.connect_ex(("127.0.0.1", port)) == 0:
                return f"rerun+http://127.0.0.1:{port}/proxy"
        time.sleep(0.1)
    raise ViewerError(
        "Rerun's viewer did not start; it needs a display: write a file with --rrd and open it where there is one"
    )
