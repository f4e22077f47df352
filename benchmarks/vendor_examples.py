"""Run the vendors' example programs, unchanged, with the simulated devices.

    python -m benchmarks.vendor_examples FOLDER [FOLDER …]

FOLDER is the folder `examples` of NI's nidaqmx-python or of Qualisys's Python SDK, in the version that you use. Every
program in it that imports nidaqmx or qtm_rt runs in a separate process and empty folder, with its calls redirected to a
simulated bench (vendor_program.py). A program passes if it ends without an error, or if it runs without end and has
printed something: 1 and Enter are typed after 3 s, and it is ended after 20 s. The last line of a failed program is
shown. Most of these use what a USB-6008 does not have, or what the simulators do not imitate.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from drivers.simulators.bench import Bench
from drivers.simulators.settings import settings_from_dict

ENTER_AFTER_S = 3.0
ENDED_AFTER_S = 20.0
DISCOVERY_PORT = 22226  # the only port that qtm_rt uses
IMPORTS = {name: re.compile(rf"^\s*(import|from) {name}", re.MULTILINE) for name in ("nidaqmx", "qtm_rt")}
ERROR = re.compile(r"[\w.]*(Error|Exception|Exit|error)\b.*: ")


@dataclass(frozen=True)
class Ran:
    """End of a program. last_line is that of its output or of its error."""

    has_passed: bool
    last_line: str


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="+", type=Path, metavar="FOLDER")
    folders = parser.parse_args(arguments).folders
    passed = count = 0
    for folder in folders:
        for program, package in programs(folder):
            ran = run(program, package)
            count, passed = count + 1, passed + ran.has_passed
            verdict = "passed" if ran.has_passed else "failed"
            print(f"{verdict}  {program.relative_to(folder)}  {ran.last_line}", flush=True)
    print(f"{passed} of {count} passed")
    return 0 if count else 2


def programs(folder: Path) -> Iterator[tuple[Path, str]]:
    """Every program below the folder that imports a vendor's package, with the package's name."""
    for path in sorted(folder.rglob("*.py")):
        text = path.read_text(encoding="utf-8-sig", errors="replace")
        package = next((name for name, imports in IMPORTS.items() if imports.search(text)), None)
        if package is not None:
            yield path, package


def run(program: Path, package: str, enter_after_s: float = ENTER_AFTER_S, ended_after_s: float = ENDED_AFTER_S) -> Ran:
    """Run one program with a simulated bench: the operator starts a capture, unless the program takes control."""
    text = program.read_text(encoding="utf-8-sig", errors="replace")
    ports = {"ni": None, "discovery": DISCOVERY_PORT} if package == "qtm_rt" else {"qtm": None}
    has_person = "TakeControl" not in text and "take_control" not in text
    settings: dict[str, Any] = {
        "operator": {"capture": "auto" if has_person else "remote", "delay_s": 0.5},
        "mocap": {"has_preview": True},
        "ports": {"serial": None, "clock": None, **ports},
    }
    with tempfile.TemporaryDirectory() as folder, Bench(settings_from_dict(settings), speed=1.0) as bench:
        if package == "qtm_rt":
            return _run_at(bench.ports["qtm"], program, package, folder, enter_after_s, ended_after_s)
        trigger = threading.Timer(enter_after_s / 2, bench.world.start_capture)  # the sync line is wired to PFI 0
        trigger.start()
        try:
            return _run_at(bench.ports["ni"], program, package, folder, enter_after_s, ended_after_s)
        finally:
            trigger.cancel()
            trigger.join()


def _run_at(port: int, program: Path, package: str, folder: str, enter_after_s: float, ended_after_s: float) -> Ran:
    command = [sys.executable, "-u", "-m", "benchmarks.vendor_program", package, str(port), str(program.resolve())]
    root = str(Path(__file__).parents[1])
    environment = {**os.environ, "PYTHONPATH": root, "MPLBACKEND": "agg", "PYTHONIOENCODING": "utf-8"}
    with tempfile.TemporaryFile() as output:
        child = subprocess.Popen(  # noqa: S603  (the user's own folder)
            command, cwd=folder, env=environment, stdin=subprocess.PIPE, stdout=output, stderr=subprocess.STDOUT
        )
        code = _end_of(child, enter_after_s, ended_after_s)
        output.seek(0)
        lines = [line.strip() for line in output.read().decode("utf-8", "replace").splitlines() if line.strip()]
    raised = [line for line in lines if ERROR.match(line)]
    last = (raised if raised and code != 0 else lines or ["printed nothing"])[-1]
    if code is None:
        return Ran(bool(lines) and not any(line.startswith("Traceback") for line in lines), f"(goes on) {last}")
    return Ran(code == 0, last)


def _end_of(child: subprocess.Popen[bytes], enter_after_s: float, ended_after_s: float) -> int | None:
    """Exit code of the program; None if it was ended. Types 1 and Enter once."""
    with ExitStack() as ending:
        if child.stdin is not None:
            ending.callback(_close, child.stdin)
        with suppress(subprocess.TimeoutExpired):
            return child.wait(enter_after_s)
        if child.stdin is not None:
            with suppress(OSError):
                child.stdin.write(b"1\n")
                child.stdin.flush()
        with suppress(subprocess.TimeoutExpired):
            return child.wait(ended_after_s - enter_after_s)
        child.kill()
        child.wait()
    return None


def _close(pipe: IO[bytes]) -> None:
    with suppress(OSError):  # the program has ended without reading its input
        pipe.close()


if __name__ == "__main__":
    sys.exit(main())
