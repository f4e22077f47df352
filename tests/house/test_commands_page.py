"""Every command of docs/commands.md, then of the README, is run in its order, in a folder with station.toml."""

import json
import multiprocessing
import os
import re
import shlex
import shutil
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from importlib.util import find_spec
from pathlib import Path

import pytest

from station.cli import main
from station.messages.live_messages import LiveCode
from tests.station.study.synthetic_sessions import write_sessions
from tests.timeout import scaled_timeout

ROOT = Path(__file__).parents[2]
DONE, FAILED, LOSSY = 0, 1, 3
SPEED = ("--speed", "12")
QUICKER = {
    "simulate": SPEED,
    "record": SPEED,
    "replay": SPEED,
    "assess": ("--people", "0"),
    "optimise": ("--draws", "0"),
    "sweep": ("--workers", "1"),
}
"""Documented options that spare the time of whoever waits for the tests."""
SHORTER = {
    "pause_s = 60": "pause_s = 5",
    "# hold_s = 7.0": "hold_s = 4.0",
    "# swing_s = 20.0": "swing_s = 12.0",
    "1.53, 1.53, 1.53, 1.53, 1.53": "1.53, 1.53, 1.53",
}
"""Lines of station.toml, likewise."""
NEEDS_DEVICES = ("simulate", "check", "record", "live")
STARTED_ANEW = (*NEEDS_DEVICES, "serve", "info", "sweep")
"""Verbs that run as a user starts them; the others in forks of a process that has imported what they import."""
IMPORTED = (
    __name__,
    *("numba", "pandas", "matplotlib.pyplot", "scipy.signal", "scipy.stats"),
    *("station.assessment.assess", "station.assessment.optimum", "station.report.verification"),
    *("station.files.export_trial", "station.files.import_trial", "station.study.study_page"),
)
FORKS = multiprocessing.get_context("spawn" if sys.platform == "win32" else "forkserver")
PLAN = """
every = 100
[vary]
cuffs = "simulated/monday/cuffs.json"
cuff = "hand"
condition = "rigid"
"""
STUDY = re.findall(r"^```toml\n(.*?)^```", (ROOT / "docs" / "study.md").read_text(encoding="utf-8"), re.M | re.S)[0]
STATIC = "simulated/monday/cuff-hand_test-static_run-1.mcap"

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1500)]


def examples() -> list[list[str]]:
    """The arguments of every indented line that begins with `station`, without its comment; a repeated line once.

    The README assesses and reports another session with the same words, and `record` has done both for that session.
    """
    pages = (ROOT / "docs" / "commands.md", ROOT / "README.md")
    lines = [line for page in pages for line in page.read_text(encoding="utf-8").splitlines()]
    commands = (tuple(shlex.split(line, comments=True)[1:]) for line in lines if line.startswith("    station "))
    done: dict[tuple[str, ...], list[str]] = {}
    for command in commands:
        is_result = command[0] in ("assess", "report")
        key = tuple(word.replace("tuesday", "monday") for word in command) if is_result else command
        done.setdefault(key, list(command))
    return list(done.values())


class Desk:
    """A folder to work in, with the project's configuration at ports that are free."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._command = shutil.which("station", path=str(ROOT / ".venv" / "bin")) or shutil.which("station")
        text = (ROOT / "station.toml").read_text(encoding="utf-8")
        for line, shorter in SHORTER.items():
            assert line in text
            text = text.replace(line, shorter)
        ports = free_ports(3)
        (folder / "station.toml").write_text(
            text.replace("31763", str(ports[0])).replace("22223", str(ports[1]))
            + f"\n[simulation.ports]\nclock = {ports[2]}\n\n[simulation.bounce]\nbounce_s = 12.0\n",
            encoding="utf-8",
        )

    def run(self, words: list[str]) -> str:
        ran = self._ended(words)
        assert ran.returncode in (DONE, LOSSY), f"station {shlex.join(words)}: {ran.stdout}\n{ran.stderr}"
        return ran.stdout

    def run_refused(self, words: list[str], code: str) -> None:
        ran = self._ended(words)
        assert ran.returncode == FAILED and code in ran.stderr, f"station {shlex.join(words)}: {ran.stderr}"

    def _ended(self, words: list[str]) -> subprocess.CompletedProcess[str]:
        if words[0] not in STARTED_ANEW:
            return self._forked(words)
        return subprocess.run(  # noqa: S603  (commands of the page)
            self._words(words), check=False, cwd=self.folder, capture_output=True, text=True, env=plain_environment()
        )

    def _forked(self, words: list[str]) -> subprocess.CompletedProcess[str]:
        arguments = self._words(words)
        fork = FORKS.Process(target=run_verb, args=(arguments, self.folder), daemon=True)
        fork.start()
        fork.join()
        printed = [(self.folder / name).read_text(encoding="utf-8") for name in ("stdout", "stderr")]
        return subprocess.CompletedProcess(arguments, fork.exitcode, *printed)

    @contextmanager
    def running(self, words: list[str], until: str) -> Iterator[subprocess.Popen[str]]:
        """One that serves until it is ended; yields it when it has said that it does."""
        child = subprocess.Popen(  # noqa: S603  (commands of the page)
            self._words(words),
            cwd=self.folder,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env=plain_environment(),
        )
        try:
            wait_for(child, until)
            yield child
        finally:
            child.terminate()
            child.communicate(timeout=scaled_timeout(60))

    def provide(self, words: list[str]) -> None:
        """What an example takes from elsewhere, made of the session's own recordings."""
        if "import" in words:
            for kind, theirs, ours in (("csv", "_force.csv", "daq.csv"), ("tsv", "_markers.tsv", "trial.tsv")):
                self.run(["export", STATIC, "--to", kind, "--output", "made"])
                (self.folder / "made" / f"{Path(STATIC).stem}{theirs}").rename(self.folder / ours)
        elif "sweep" in words:
            (self.folder / "plan.toml").write_text(PLAN)
        elif "plan" in words:
            (self.folder / "study.toml").write_text(STUDY, encoding="utf-8")
        elif "catalogue" in words:
            write_sessions(self.folder / "sessions", volunteers=4)

    def _words(self, words: list[str]) -> list[str]:
        assert self._command is not None, "the station command is not installed"
        # A check listens for as long as a person takes to start a capture: the first devices run at the wall's speed.
        return [self._command, *words, *(() if "bounce" in words else QUICKER.get(words[0], ()))]


def run_verb(arguments: list[str], folder: Path) -> None:
    """Run the command line in this process, in the folder; what it prints is written to stdout and stderr there."""
    environment = plain_environment()
    os.environ.clear()
    os.environ.update(environment)
    os.chdir(folder)
    for number, name in enumerate(("stdout", "stderr"), start=1):
        os.dup2(os.open(name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), number)
    sys.argv = arguments
    main()


def wait_for(child: subprocess.Popen[str], words: str) -> None:
    """Until it says these words."""
    assert child.stdout is not None
    said = ""
    while words not in said:
        line = child.stdout.readline()
        assert line, said
        said += line


def hang(simulator: subprocess.Popen[str], mass_kg: str) -> None:
    """What the page says to type in the simulator's terminal."""
    assert simulator.stdin is not None
    simulator.stdin.write(f"hang {mass_kg}\n")
    simulator.stdin.flush()
    wait_for(simulator, "kg on the load cell")


def free_ports(count: int) -> list[int]:
    taken = [socket.socket() for _ in range(count)]
    try:
        for each in taken:
            each.bind(("127.0.0.1", 0))
        return [each.getsockname()[1] for each in taken]
    finally:
        for each in taken:
            each.close()


def plain_environment() -> dict[str, str]:
    """No browser opens, no window is drawn, and the command runs as outside of a test."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST")}
    return {**kept, "BROWSER": "true", "MPLBACKEND": "agg"}


def test_every_command_of_the_page_runs_in_its_order(tmp_path: Path) -> None:
    desk = Desk(tmp_path)
    assert all(map(find_spec, IMPORTED)), "the process of the forks would not tell"
    FORKS.set_forkserver_preload([*IMPORTED])
    with ExitStack() as devices:
        for words in examples():
            if words[0] not in NEEDS_DEVICES:
                devices.close()  # simulated devices run in real time, and take processor time from the others
            if words[0] == "simulate":
                devices.close()
                simulator = devices.enter_context(desk.running(words, until="stop with Ctrl-C"))
            elif words[0] == "serve":
                with desk.running([*words, "--port", str(free_ports(1)[0])], until="http://127.0.0.1:"):
                    pass
            elif words[0] == "live":
                desk.run_refused(words, LiveCode.UNREACHABLE)  # no trial runs now
            else:
                if words[0] == "check":
                    hang(simulator, words[-1] if "--known-mass" in words else "0")
                desk.provide(words)
                shown = desk.run(words)
                assert words != ["check"] or "│ ok │ force at rest" in shown, shown
    monday = tmp_path / "simulated" / "monday"
    assert (monday / "report.html").is_file() and (monday.with_name("tuesday") / "report.html").is_file()
    assert "calibration" in json.loads((monday / "cuffs.json").read_text()), "the bounce is used"
    assert {words[0] for words in examples()} >= {"simulate", "record", "fit", "assess", "report"}
