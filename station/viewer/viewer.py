"""Start Rerun's viewer so that it listens on 127.0.0.1 only, without analytics."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time

from station.errors import StationError
from station.messages.message import Message
from station.messages.sweep_codes import SweepCode

WAIT_S = 20.0


class ViewerError(StationError):
    """The viewer did not start."""


def start_viewer() -> str:
    """Start a viewer in a separate process, which outlives this one. Returns its address."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    child = subprocess.Popen(  # noqa: S603  (constant arguments)
        [sys.executable, "-m", "rerun", "--bind", "127.0.0.1", "--port", str(port), "--memory-limit", "1GB"],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "RERUN_ANALYTICS_ENABLED": "false", "DO_NOT_TRACK": "1"},
    )
    until = time.perf_counter() + WAIT_S
    while time.perf_counter() < until and child.poll() is None:
        with socket.socket() as tried:
            tried.settimeout(1.0)
            if tried.connect_ex(("127.0.0.1", port)) == 0:
                return f"rerun+http://127.0.0.1:{port}/proxy"
        time.sleep(0.1)
    raise ViewerError(Message(SweepCode.NO_VIEWER))
