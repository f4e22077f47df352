"""Signals that end a verb."""

from __future__ import annotations

import signal

NAMES = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")
"""SIGHUP: the terminal was closed. SIGBREAK: Ctrl-Break on Windows; a closed window ends its processes there."""


def end_signals() -> tuple[signal.Signals, ...]:
    """The signals that this system has."""
    return tuple(getattr(signal, name) for name in NAMES if hasattr(signal, name))
