"""A process that compiles the solver's kernels, started by CompilationAhead, which may end it at any time.

It sends {"ready": 3, "kernels": 12} before and after each kernel. It imports little before it compiles.
"""

from __future__ import annotations

import os

from solver.compile_ahead import compile_ahead
from station.child import ProcessLink, exit_at_once, exit_with_parent

NICENESS = 2
"""The parent has priority, but finally waits for this process: with 5 on a busy machine, for minutes."""


def main(parent: ProcessLink, begin_with: str = "") -> None:
    if hasattr(os, "nice"):
        os.nice(NICENESS)
    exit_with_parent(parent)  # at any time: what is on disk is whole, since numba renames its files into place

    def report(ready: int, total: int) -> None:
        from solver.compiled import keeps_code

        if not keeps_code():
            exit_at_once(1)  # no other process would have the kernels
        parent.send({"ready": ready, "kernels": total})

    compile_ahead(report, begin_with)
    exit_at_once(0)
