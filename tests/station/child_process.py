"""End a child process of a test and close its pipes."""

from __future__ import annotations

import subprocess


def end_process(child: subprocess.Popen[bytes]) -> None:
    """Kill it if it still runs."""
    if child.poll() is None:
        child.kill()
    child.wait()
    for pipe in (child.stdin, child.stdout, child.stderr):
        if pipe is not None:
            pipe.close()
