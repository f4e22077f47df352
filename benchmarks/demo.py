"""Times of the stages of `station demo`, idle and beside busy loops, and whether both runs give the same bytes.

    python -m benchmarks.demo [--loops 16] [--cold]

Each demo runs in a separate process and folder, first without and then beside the loops. Prints wall seconds by stage,
processor time, exit code, and whether the samples of the recordings, the cuffs and the figures of the report are equal.
--cold compiles the solver in each run, as the first run on a machine does.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from benchmarks.under_load import busy_loops
from tests.house.sameness import differences

AT_MOST_S = 3 * 3600.0
STATION = "from station.cli import main; main()"
STAGE = re.compile(r"^(?P<stage>[a-z, ]+): \d+ of \d+ in (?P<took>.+)$", re.MULTILINE)


@dataclass(frozen=True)
class DemoRun:
    """Wall seconds of every stage, total wall and processor seconds, exit code."""

    stages: dict[str, str]
    wall_s: float
    processor_s: float
    exit_code: int


def main(arguments: Sequence[str]) -> int:
    """Print the table; returns 0 if both runs ended with a complete report and the same bytes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--loops", type=int, default=16)
    parser.add_argument("--cold", action="store_true")
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as name, ExitStack() as stack:
        idle, busy = Path(name) / "session-idle", Path(name) / "session-busy"
        runs = [_measure(idle, is_cold=options.cold)]
        stack.enter_context(busy_loops(options.loops, AT_MOST_S))
        runs.append(_measure(busy, is_cold=options.cold))
        differing = differences(idle, busy)
    print(_table(runs, options.loops))
    print("the same samples, cuffs and report" if not differing else f"different: {', '.join(differing)}")
    return 0 if not differing and not any(run.exit_code for run in runs) else 1


def _measure(folder: Path, *, is_cold: bool) -> DemoRun:
    with tempfile.TemporaryDirectory() as cache:
        environment = {**os.environ, "NUMBA_CACHE_DIR": cache} if is_cold else None
        began_s, before = time.monotonic(), os.times()
        command = [sys.executable, "-c", STATION, "demo", "--output", str(folder)]
        ran = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)  # noqa: S603
        wall_s, after = time.monotonic() - began_s, os.times()
    spent_s = after.children_user + after.children_system - before.children_user - before.children_system
    stages = {match["stage"]: match["took"] for match in STAGE.finditer(ran.stderr)}
    if ran.returncode:
        print(json.dumps({"exit": ran.returncode, "stderr": ran.stderr[-2000:]}), file=sys.stderr)
    return DemoRun(stages, wall_s, spent_s, ran.returncode)


def _table(runs: Sequence[DemoRun], loops: int) -> str:
    names = list(dict.fromkeys(stage for run in runs for stage in run.stages))
    rows = [[name, *(run.stages.get(name, "–") for run in runs)] for name in names]
    rows += [["in all", *(f"{run.wall_s:.1f} s" for run in runs)]]
    rows += [["processor", *(f"{run.processor_s:.1f} s" for run in runs)]]
    rows += [["exit code", *(str(run.exit_code) for run in runs)]]
    head = f"| stage | the machine as it is | beside {loops} busy loops |\n|---|---:|---:|"
    return "\n".join([head, *(f"| {' | '.join(row)} |" for row in rows)])


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
