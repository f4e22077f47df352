"""What a lab does with a station, in processes of its own on simulated devices; the same on Linux and Windows.

The folder's name has a space and letters outside ASCII, and the configuration has a byte order mark and CRLF.
"""

import json
import os
import shutil
import subprocess
import sys
import threading
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest

from fitting.cuffs.cuffs_file import read_cuffs
from recordings.contents import read_contents
from station.journal import read_journal
from station.messages.bench_messages import TrialCode
from tests.house.sources import ROOT
from tests.made_once import made_once
from tests.station.console.served import ServedConsole, write_config
from tests.station.terminal.practice import Headless
from tests.timeout import scaled_timeout

SESSION = Path("simulated", "monday")
PLAN = ("--config", "station.toml", "--simulated", "--speed", "30", "--subject", "P01")
KILLS, LIVE_KILLS = (20, 10) if sys.platform == "win32" else (4, 4)
WEARER = """
[body]
markers = ["ij", "px", "c7", "t8", "ac", "aa", "ts", "ai", "gu", "EpL", "EpM"]
arm = ["ac", "EpL"]
trunk = ["c7", "t8"]
cycles = 3
pose_s = 120.0
conditions = ["unsuited"]

[live]
enabled = true
"""
PATIENCE_S = 600.0
pytestmark = pytest.mark.slow


def lab_folder(parent: Path, *, has_wearer: bool = False) -> Path:
    folder = parent / "Prüfstand für Møller 測定"
    folder.mkdir()
    path = write_config(folder, hold_s=4.0, swing_s=5.0)
    text = path.read_text(encoding="utf-8").replace('control = "start"', 'control = "none"')
    if has_wearer:
        text = text.partition("[cuffs.hand]")[0] + WEARER
    path.write_bytes(b"\xef\xbb\xbf" + text.replace("\n", "\r\n").encode())
    return folder


def record_plan(parent: Path) -> Path:
    """A folder with a whole session, recorded as docs/terminal.md starts it: by the shell, which opens the file."""
    parent.mkdir()
    folder = lab_folder(parent)
    words = [sys.executable, "-m", "station", "record", "--headless", *PLAN, "--session", str(SESSION)]
    ran = subprocess.run(  # noqa: S602  (our own words)
        f"{subprocess.list2cmdline(words)} >> monday.jsonl",
        shell=True,
        cwd=folder,
        stdin=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        check=False,
        timeout=scaled_timeout(PATIENCE_S),
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    assert ran.returncode == 0, ran.stderr
    return folder


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the folder, which the tests of a module may change: an idle process takes tests of another one."""
    recorded = made_once(tmp_path_factory, "lab", record_plan)
    return Path(shutil.copytree(recorded, tmp_path_factory.mktemp("lab_copy") / recorded.name))


def station(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run a command in a folder, with pipes as standard streams."""
    return subprocess.run(  # noqa: S603  (our own words)
        [sys.executable, "-m", "station", *arguments],
        cwd=folder,
        input="",
        capture_output=True,
        encoding="utf-8",
        check=False,
        timeout=scaled_timeout(PATIENCE_S),
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )


def test_a_task_without_standard_input_records_the_plan_into_a_file(lab: Path) -> None:
    events = [json.loads(line) for line in (lab / "monday.jsonl").read_text(encoding="utf-8").splitlines()]
    assert events[-1]["event"] == "session_closed" and events[-1]["is_complete"]
    recordings = list((lab / SESSION).glob("*.mcap"))
    assert len(recordings) == 2 and all(read_contents(path).complete for path in recordings)


@pytest.mark.parametrize(("verb", "name"), [("fit", "cuffs.json"), ("report", "report.html")])
def test_a_result_that_another_program_holds_open_is_kept_and_replaced_once_it_is_closed(
    lab: Path, verb: str, name: str
) -> None:
    path = lab / SESSION / name
    if sys.platform == "win32":  # elsewhere a file that is open can be replaced
        before = path.read_bytes()
        with held(path):
            ran = station(lab, verb, str(SESSION))
        assert ran.returncode == 1 and ran.stderr.count(name) == 1 and "Traceback" not in ran.stderr, ran.stderr
        assert path.read_bytes() == before
    with held(path, until_drafted=True):
        ran = station(lab, verb, str(SESSION))
    assert ran.returncode == 0, ran.stderr
    assert not list(path.parent.glob(".draft*"))


def test_texts_of_a_session_with_the_line_ends_of_windows_are_read_and_reported_as_changed(lab: Path) -> None:
    before = read_cuffs(lab / SESSION / "cuffs.json")["hand"].stiffness
    for path in (lab / SESSION).iterdir():
        if path.suffix in {".json", ".jsonl"}:
            path.write_bytes(path.read_bytes().replace(b"\r\n", b"\n").replace(b"\n", b"\r\n"))
    for verb in ("report", "fit"):
        ran = station(lab, verb, str(SESSION))
        assert ran.returncode == 3 and "changed since" in ran.stderr, ran.stderr
    assert read_cuffs(lab / SESSION / "cuffs.json")["hand"].stiffness == before


def test_a_path_of_more_than_260_characters_is_refused_on_windows_before_anything_is_recorded(lab: Path) -> None:
    deep = Path("simulated", *["x" * 60] * 4)
    if sys.platform == "win32":
        ran = station(lab, "record", "--headless", *PLAN, "--session", str(deep))
        assert ran.returncode == 1 and "refused.path_too_long" in ran.stdout, ran.stdout
    else:
        with Headless(lab, *PLAN, "--session", str(deep)) as terminal:
            assert terminal.until("trial_ended")["accepted"]
        assert all(read_contents(path).complete for path in (lab / deep).glob("*.mcap"))


def test_the_page_is_served_without_a_bench(lab: Path) -> None:
    with ServedConsole(lab / "station.toml", "--simulated") as console:
        assert b"<html" in urllib.request.urlopen(console.address).read().lower()  # noqa: S310  (our own page)


@pytest.mark.timeout(1200)
def test_a_session_survives_kills_of_its_recorder_and_terminal_at_random_moments(tmp_path: Path) -> None:
    """The station recovers the file of a killed recorder. The recorder of a killed terminal records its trial to the
    end, because the simulated bench outlives the terminal, too."""
    folder, random = lab_folder(tmp_path), np.random.default_rng(25)
    for number, wait_s in enumerate(random.permutation(np.arange(KILLS) + random.uniform(size=KILLS)) * 0.3 / KILLS):
        with Headless(folder, *PLAN, "--session", str(SESSION)) as terminal:
            until_recording(terminal)
            threading.Event().wait(wait_s)
            program = psutil.Process(terminal.child.pid)
            recorders = children_that_run("station.session.trial_daemon", program)
            if number % 2 == 0:
                for recorder in recorders:  # none if the trial has just ended
                    recorder.kill()
            program.kill()
            psutil.wait_procs(recorders)
    with Headless(folder, *PLAN, "--session", str(SESSION)) as terminal:
        until_recording(terminal)
        assert terminal.until("trial_ended")["accepted"]
    recorded = read_journal(folder / SESSION).recorded
    killed = [one for one in recorded if TrialCode.RECORDER_KILLED in {message.code for message in one.codes}]
    assert killed and len(recorded) > KILLS / 2
    for one in recorded:
        assert read_contents(folder / SESSION / one.file).complete == (one not in killed)


def test_motions_are_recorded_whole_although_their_live_process_is_killed_at_random_moments(tmp_path: Path) -> None:
    folder, random, killed = lab_folder(tmp_path, has_wearer=True), np.random.default_rng(29), 0
    with Headless(folder, *PLAN, "--session", str(SESSION)) as terminal:
        for _ in range(LIVE_KILLS):
            until_recording(terminal)
            threading.Event().wait(random.uniform(0.0, 0.5))
            for child in children_that_run("station.live.process", psutil.Process(terminal.child.pid)):
                child.kill()
                killed += 1
            assert terminal.until("trial_ended")["accepted"]
            terminal.send("redo again\r")  # on a pipe of Windows, lines end in CRLF
    assert killed > LIVE_KILLS / 2, "a trial may end before"
    journal = read_journal(folder / SESSION)
    assert {verdict.reason for verdict in journal.verdicts.values()} == {"again"}
    recorded = journal.recorded
    assert len(recorded) >= LIVE_KILLS and {one.test for one in recorded} <= {"pose", "motion"}
    for one in recorded:
        contents = read_contents(folder / SESSION / one.file)
        assert one.accepted and contents.complete and not contents.gaps


def children_that_run(module: str, program: psutil.Process) -> list[psutil.Process]:
    """On Windows, the python.exe of a virtual environment is a parent of the program. One may end meanwhile."""
    found = []
    for child in program.children(recursive=True):
        with suppress(psutil.NoSuchProcess):  # of which ZombieProcess is one
            if module in child.cmdline():
                found.append(child)
    return found


def until_recording(terminal: Headless) -> None:
    """Reject the recording of the killed recorder, and read on to the next trial."""

    def decide(event: dict[str, Any]) -> None:
        if event["event"] == "waiting" and event["what"] == "decision":
            terminal.send("redo killed")

    terminal.until("state_changed", state="recording", on_event=decide)


@contextmanager
def held(path: Path, *, until_drafted: bool = False) -> Iterator[None]:
    """Hold a file open, on Windows without sharing; until_drafted: until half a second after a draft of it exists."""
    is_over = threading.Event()
    release = _open_alone(path)

    def watch() -> None:
        while not is_over.wait(0.05):
            if until_drafted and any(path.parent.glob(".draft*")):
                is_over.wait(0.5)
                break
        release()

    thread = threading.Thread(target=watch)
    thread.start()
    try:
        yield
    finally:
        is_over.set()
        thread.join()


def _open_alone(path: Path) -> Callable[[], object]:
    if sys.platform != "win32":
        return path.open("rb").close
    import _winapi

    generic_read, share_nothing, open_existing = 0x8000_0000, 0, 3
    handle = _winapi.CreateFile(str(path), generic_read, share_nothing, 0, open_existing, 0, 0)
    return lambda: _winapi.CloseHandle(handle)
