"""Processor time in which the library and the commands start, and of the first use on a machine.

    python -m benchmarks.start [--before CHECKOUT] [--first-use] [--wheel WHEEL] [--repeats 5]

--before: a checkout of an earlier version, which runs in turn with this one; --first-use: `station rmr` with nothing
compiled, in one process, because the others compile until the command ends; --wheel: the same with an installed wheel
(python -m solver.kernel_wheel dist). Prints the least of the repeats and, with --before, the ratio. First use is
measured once, and then with what it has compiled.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

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
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--before", type=Path, help="a checkout of an earlier version")
    parser.add_argument("--first-use", action="store_true")
    parser.add_argument("--wheel", type=Path)
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    trees = [tree for tree in (options.before, ROOT) if tree is not None]
    for name, command in STARTS.items():
        seconds = [[_seconds(tree, command) for tree in trees] for _ in range(options.repeats)]
        _print(name, [min(of_tree) for of_tree in zip(*seconds, strict=True)])
    if options.first_use:
        first, later = zip(*(_first_use(tree) for tree in trees), strict=True)
        _print("station rmr, first use", first)
        _print("station rmr, later", later)
    if options.wheel is not None:
        with tempfile.TemporaryDirectory() as installed:
            pip = (sys.executable, "-m", "pip", "install", "--no-deps", "--quiet", "--target", installed)
            subprocess.run([*pip, str(options.wheel)], check=True)  # noqa: S603
            first_s, later_s = _first_use(Path(installed))
        _print("the same, wheel, first use", [first_s])
        _print("the same, wheel, later", [later_s])


def _print(name: str, seconds: Sequence[float]) -> None:
    *before, now = seconds
    ratio = f"   before {before[0]:6.2f} s, {before[0] / now:.1f} times" if before else ""
    print(f"{name:28}{now:6.2f} s{ratio}", flush=True)


def _first_use(tree: Path) -> tuple[float, float]:
    """Seconds of `station rmr` with nothing compiled, and again with what that has compiled."""
    with tempfile.TemporaryDirectory() as folder:
        command = ("-c", ALONE, "rmr", "--output", f"{folder}/rmr.csv")
        first, later = (_seconds(tree, command, NUMBA_CACHE_DIR=f"{folder}/compiled") for _ in range(2))
    return first, later


def _seconds(tree: Path, arguments: Sequence[str], **environment: str) -> float:
    """Processor seconds of a process of this version, and of those that it has waited for."""
    before = os.times()
    ran = subprocess.run(  # noqa: S603
        [sys.executable, *arguments],
        cwd=tree,
        env={**os.environ, "PYTHONPATH": str(tree), **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    after = os.times()
    if ran.returncode not in (0, LOSSY):
        raise SystemExit(f"{arguments} ended with {ran.returncode}: {ran.stderr}")
    return after.children_user + after.children_system - before.children_user - before.children_system


if __name__ == "__main__":
    main()
