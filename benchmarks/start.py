"""Processor time in which the library and the commands start, and of the first use on a machine, with nothing compiled.

    python -m benchmarks.start [--before FOLDER] [--first-use] [--repeats 5]

--before: a checkout of an earlier version, or a folder into which a wheel is installed (`pip install --no-deps --target
FOLDER dist/*.whl`), which runs in turn with this version; the ratios are printed. The least of the repeats counts; the
first use is measured once, in one process, because the others compile until the command ends, and then once more.
"""

import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from benchmarks.command_line import parse_options
from station.exit_code import LOSSY

ROOT = Path(__file__).parents[1]
RECORDING = ROOT / "tests/recordings/golden/format_1.mcap"
STATION = "from station.__main__ import main; main()"
ALONE = f"import station.assessment.compilation as c; c.CompilationAhead.ensure_started = lambda _: None; {STATION}"
STARTS: dict[str, tuple[str, ...]] = {
    "import cuffstation": ("-c", "import cuffstation"),
    "station --help": ("-c", STATION, "--help"),
    "station info RECORDING": ("-c", STATION, "info", str(RECORDING)),
    "station rmr --help": ("-c", STATION, "rmr", "--help"),
    "process of a trial": ("-c", "import station.session.trial_daemon"),
    "process of live values": ("-c", "import station.live.process"),
    "demo": ("-c", "import station.demo"),
}


def main() -> None:
    options = parse_options(__doc__, before=Path, first_use=False, repeats=5)
    trees = [tree for tree in (options.before, ROOT) if tree is not None]
    for name, command in STARTS.items():
        seconds = [[_seconds(tree, command) for tree in trees] for _ in range(options.repeats)]
        _print(name, [min(of_tree) for of_tree in zip(*seconds, strict=True)])
    if options.first_use:
        first, later = zip(*map(_first_use, trees), strict=True)
        _print("station rmr, first use", first)
        _print("station rmr, later", later)


def _print(name: str, seconds: Sequence[float]) -> None:
    *before, now = seconds
    print(f"{name:28}{now:6.2f} s", *(f"  before {each:6.2f} s, ratio={each / now:.1f}" for each in before), flush=True)


def _first_use(tree: Path) -> tuple[float, float]:
    """Seconds of `station rmr` with nothing compiled, and again with what that has compiled."""
    with tempfile.TemporaryDirectory() as folder:
        command = ("-c", ALONE, "rmr", "--output", f"{folder}/rmr.csv")
        first, later = (_seconds(tree, command, NUMBA_CACHE_DIR=f"{folder}/compiled") for _ in range(2))
    return first, later


def _seconds(tree: Path, arguments: Sequence[str], **environment: str) -> float:
    """Processor seconds of a process of this version, and of those that it has waited for."""
    before, environment = os.times(), {**os.environ, "PYTHONPATH": str(tree), **environment}
    command = [sys.executable, *arguments]
    ran = subprocess.run(command, cwd=tree, env=environment, capture_output=True, text=True, check=False)  # noqa: S603
    after = os.times()
    if ran.returncode not in (0, LOSSY):
        raise SystemExit(f"{arguments} ended with {ran.returncode}: {ran.stderr}")
    return after.children_user + after.children_system - before.children_user - before.children_system


if __name__ == "__main__":
    main()
