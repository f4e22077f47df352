"""What ends a verb from outside."""

from __future__ import annotations

import signal

NAMES = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")
"""The third: its terminal was closed. Windows has the last in its place: Ctrl-Break, or the window's cross."""


def end_signals() -> tuple[signal.Signals, ...]:
    """Those of this system."""
    return tuple(getattr(signal, name) for name in NAMES if hasattr(signal, name))
