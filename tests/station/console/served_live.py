"""The live page alone in a process of its own, as `serve_live` serves it."""

from __future__ import annotations

import os
import socket
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from station.child import Child


@contextmanager
def served_live_page(folder: Path) -> Iterator[str]:
    """The address of the page with the values of this folder."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    child = Child(
        "station.console.server",
        str(folder),
        str(port),
        stdout=subprocess.PIPE,
        text=True,
        env={name: value for name, value in os.environ.items() if not name.startswith("PYTEST")},
    )
    assert child.process.stdout is not None
    try:
        address = child.process.stdout.readline().strip()
        assert address == f"http://127.0.0.1:{port}/"
        yield address
    finally:
        child.ensure_ended()
        child.process.stdout.close()
