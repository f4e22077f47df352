"""`station record` without a test, as it is run: as lines of JSON, on a pipe, on a terminal of 80 columns."""

from __future__ import annotations

import asyncio
import ctypes
import os
import re
import select
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

from recordings.reader import open_recording
from station.bench.simulation import clock_port, practice_settings
from station.config import StationConfig, load_config, parse_config
from station.journal import Setup, read_journal, write_setup
from station.messages.bench_messages import CueCode, RefusalCode
from station.messages.session_messages import CommandCode
from station.session.controller import SessionController
from station.terminal import run
from station.terminal.events import (
    CueChanged,
    NextTrial,
    SessionEvent,
    TrialSkipped,
    VerdictGiven,
    Waiting,
    WarningRaised,
)
from tests.station.child_process import STOP, press
from tests.station.command import Ran, assert_refused
from tests.station.console.served import write_config
from tests.station.session.benched import ThreadedBench, ThreadedWorker, simulated_bench
from tests.station.terminal.practice import PATIENCE_S, Headless, lead
from tests.station.wearer import CYCLES, wearer_config
from tests.timeout import scaled_timeout

PRACTICE = ("--config", "station.toml", "--session", "monday", "--simulated", "--speed", "3", "--subject", "P01")

SHOWN = 80 * 9001  # characters of the largest buffer of a console with 80 columns
CREATE_NO_WINDOW = 0x0800_0000  # a console of its own, which no window shows
SPEED = 30.0
SETUP = Setup("P01", "ab", (), 1, has_bounce=False, conditions=("unsuited",))


@pytest.fixture
def bench(tmp_path: Path) -> Path:
    return practice_folder(tmp_path)


def practice_folder(folder: Path, hold_s: float = 7.0) -> Path:
    """With a configuration that leaves the captures to a person at the (simulated) mocap system."""
    path = write_config(folder, hold_s=hold_s, swing_s=5.0)
    path.write_text(path.read_text().replace('control = "start"', 'control = "none"'))
    return folder


@pytest.mark.slow
def test_a_service_reads_lines_and_a_stop_ends_its_trial_cleanly(tmp_path: Path) -> None:
    bench = practice_folder(tmp_path, hold_s=600.0)
    with Headless(bench, *PRACTICE) as session:
        opened = session.until("session_opened")
        assert opened["is_simulated"] and opened["trials"] == 2
        assert session.until("next_trial")["order"] == "Don the hand cuff, rope slack"
        session.until("state_changed", state="recording")
        status = session.until("status", state="recording")
        assert status["force_n"] is not None and status["lost_samples"] == 0
        session.send("jump")
        answer = session.until("answer")
        assert answer["is_refused"] and answer["code"] == "command.unknown"
        press(STOP, session.child.pid)
        ended = session.until("trial_ended")
        assert ended["accepted"] and ended["codes"] == ["operator_stop"]
        closed = session.until("session_closed")
        assert not closed["is_complete"] and f"--session {Path('simulated/monday')} --simulated`" in closed["sentence"]
        assert session.child.wait(scaled_timeout(PATIENCE_S)) == 0
    assert open_recording(bench / "simulated" / "monday" / ended["file"]).complete
    assert read_journal(bench / "simulated" / "monday").verdicts == {}, "the next operator decides"


@pytest.mark.slow
def test_a_terminal_reads_keys_and_no_line_is_wider_than_it(bench: Path) -> None:
    if sys.platform == "win32":
        ran = subprocess.run(  # noqa: S603  (our own words)
            [sys.executable, "-m", __name__, bench],
            creationflags=CREATE_NO_WINDOW,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
            timeout=4 * scaled_timeout(PATIENCE_S),
        )
        assert ran.returncode == 0, ran.stderr
    else:
        lead_by_keys(bench)


def lead_by_keys(bench: Path) -> None:
    """Record a trial on a terminal of 80 columns, mark it, ask for another and end."""
    command = (sys.executable, "-c", "from station.cli import main; main()", "record", *PRACTICE)
    with (on_this_console if sys.platform == "win32" else on_a_terminal)(bench, *command) as screen:
        screen.until("REC")
        screen.press("m")
        screen.until("mark 1")
        screen.press("rthe rope hung\x7fng\r")
        screen.until("To be redone")
        screen.press("e")
        screen.until("trials kept")
        screen.read_to_end()
        assert screen.child.wait(scaled_timeout(PATIENCE_S)) == 0
        assert max(len(line) for line in screen.lines()) <= 80
    assert list(read_journal(bench / "simulated" / "monday").redone.values()) == ["the rope hunng"]


@contextmanager
def on_a_terminal(folder: Path, *command: str) -> Iterator[Screen]:
    import fcntl
    import pty
    import struct
    import termios

    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
    child = subprocess.Popen(  # noqa: S603  (our own words)
        command,
        stdin=theirs,
        stdout=theirs,
        stderr=theirs,
        cwd=folder,
        env={name: value for name, value in os.environ.items() if not name.startswith("PYTEST")} | {"TERM": "xterm"},
        start_new_session=True,
        preexec_fn=_take_the_terminal,  # noqa: PLW1509  (no threads between fork and exec here)
    )
    os.close(theirs)
    try:
        yield Screen(ours, child)
    finally:
        child.kill()
        child.wait()
        os.close(ours)


def _take_the_terminal() -> None:
    import fcntl
    import termios

    fcntl.ioctl(0, termios.TIOCSCTTY, 0)


class Screen:
    """What a program wrote to a terminal."""

    def __init__(self, descriptor: int, child: subprocess.Popen[bytes]) -> None:
        self._descriptor, self._text, self.child = descriptor, "", child

    def press(self, keys: str) -> None:
        os.write(self._descriptor, keys.encode())

    def until(self, words: str) -> None:
        """Read on until these words have come. A console of Windows moves the cursor instead of writing a space."""
        seen, end_s = len(self._text), time.perf_counter() + scaled_timeout(PATIENCE_S)
        while words.replace(" ", "") not in "".join("".join(self.lines(seen)).split()):
            self._read(end_s, words)

    def read_to_end(self) -> None:
        """A program whose terminal is full does not end."""
        end_s = time.perf_counter() + scaled_timeout(PATIENCE_S)
        with suppress(OSError):  # EIO: no program has the terminal open
            while True:
                self._read(end_s, "end")

    def _read(self, end_s: float, words: str) -> None:
        ready, _, _ = select.select([self._descriptor], [], [], max(0.0, end_s - time.perf_counter()))
        if not ready:
            raise AssertionError(f"no {words!r} in {self._text[-2000:]}")
        self._text += os.read(self._descriptor, 65536).decode(errors="replace")

    def lines(self, first: int = 0) -> list[str]:
        """Without the sequences that move the cursor and set colours."""
        return re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", self._text[first:]).replace("\r", "\n").split("\n")


@contextmanager
def on_this_console(folder: Path, *command: str) -> Iterator[Screen]:
    """On Windows, a program on the console of this process."""
    with open("CONIN$", "rb", 0) as keys, open("CONOUT$", "wb", 0) as text:  # noqa: PTH123  (no files)
        child = subprocess.Popen(command, stdin=keys, stdout=text, stderr=text, cwd=folder)  # noqa: S603  (our own words)
        try:
            yield ConsoleScreen(child, keys.fileno(), text.fileno())
        finally:
            child.kill()
            child.wait()


class ConsoleScreen(Screen):
    """What a console of Windows shows. Its keys are pressed as its window presses them."""

    def __init__(self, child: subprocess.Popen[bytes], keys: int, text: int) -> None:
        import msvcrt

        super().__init__(-1, child)
        self._kernel: Any = ctypes.WinDLL("kernel32")  # type: ignore[attr-defined, unused-ignore]
        get_handle: Any = msvcrt.get_osfhandle  # type: ignore[attr-defined, unused-ignore]
        self._keys, self._shown = (ctypes.c_void_p(get_handle(number)) for number in (keys, text))

    def press(self, keys: str) -> None:
        for key in keys:
            record = KeyEvent(type=1, is_down=1, count=1, character=key)
            assert self._kernel.WriteConsoleInputW(self._keys, ctypes.byref(record), 1, ctypes.byref(ctypes.c_ulong()))

    def until(self, words: str) -> None:
        end_s = time.perf_counter() + scaled_timeout(PATIENCE_S)
        while words not in (shown := "\n".join(self.lines())):
            assert time.perf_counter() < end_s, f"no {words!r} in {shown}"
            time.sleep(0.2)

    def read_to_end(self) -> None:
        """A console takes all that is written."""

    def lines(self, first: int = 0) -> list[str]:
        shown = ctypes.create_unicode_buffer(SHOWN)
        read = ctypes.byref(ctypes.c_ulong())
        assert self._kernel.ReadConsoleOutputCharacterW(self._shown, shown, SHOWN, 0, read)
        return [shown[start : start + 80] for start in range(first, SHOWN, 80)]


class KeyEvent(ctypes.Structure):
    """INPUT_RECORD of a key, of Windows' header wincon.h."""

    _fields_ = (
        ("type", ctypes.c_ushort),
        ("is_down", ctypes.c_int),
        ("count", ctypes.c_ushort),
        ("key_code", ctypes.c_ushort),
        ("scan_code", ctypes.c_ushort),
        ("character", ctypes.c_wchar),
        ("state", ctypes.c_ulong),
    )


def test_a_new_session_needs_a_subject_and_an_old_one_its_own_plan(station: Callable[..., Ran], tmp_path: Path) -> None:
    path = write_config(tmp_path)
    ran = station("record", "--config", path, "--session", tmp_path / "monday", "--headless")
    assert ran.code == 2 and "--subject" in ran.err
    assert not (tmp_path / "monday").exists()
    write_setup(tmp_path / "monday", Setup("P01", "", ("hand",), 1, has_bounce=False, number="monday"))
    ran = station("record", "--config", path, "--session", tmp_path / "monday", "--headless", "--repeats", 5)
    assert ran.code == 1 and "was planned with 1 repeat of hand" in ran.err


def test_a_plan_that_names_a_cuff_twice_is_wrong_usage(station: Callable[..., Ran], tmp_path: Path) -> None:
    options = ("--session", tmp_path / "monday", "--subject", "P01", "--cuffs", "hand,hand")
    ran = station("record", "--config", write_config(tmp_path), *options)
    assert_refused(ran, 2, CommandCode.REPEATED_CUFF)
    assert not (tmp_path / "monday").exists()


def test_a_session_on_simulated_devices_elsewhere_than_below_simulated_is_refused_before_it_begins(
    station: Callable[..., Ran], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run, "is_served_by_simulator", lambda _: True)
    config = write_config(tmp_path)
    ran = station("record", "--config", config, "--session", tmp_path / "monday", "--subject", "P01")
    assert_refused(ran, 1, RefusalCode.SIMULATED_DEVICES)
    assert not (tmp_path / "monday").exists()


@pytest.mark.parametrize("options", [("--cuff", "hand"), ("--duration", "3"), ("--repeat", "2")])
def test_an_option_of_one_trial_needs_a_test(
    station: Callable[..., Ran], tmp_path: Path, options: tuple[str, ...]
) -> None:
    ran = station("record", "--config", write_config(tmp_path), "--session", tmp_path / "monday", *options)
    assert ran.code == 2 and "--test" in ran.err


# Console and terminal run the same session in turn, and each resumes it where the other was killed.


@pytest.mark.slow
def test_terminal_and_console_resume_each_other_s_session_during_a_trial_and_before_a_decision(tmp_path: Path) -> None:
    """The terminal is killed while it records; its recorder goes on, and the console keeps that trial and records the
    next. It is closed before it decides, and the terminal does."""
    with simulated_bench(tmp_path / "bench", speed=SPEED, hold_s=40.0) as (bench, _):  # 10 s of the wall
        ports = bench.ready["ports"]
        path = write_config(tmp_path, swing_s=5.0, ni=ports["ni"], qtm=ports["qtm"])
        with path.open("a") as file:
            file.write(f"\n[simulation.ports]\nclock = {ports['clock']}\n")
        options = ("--config", "station.toml", "--session", "simulated/monday", "--speed", str(SPEED))
        bench.request({"trial": {"cuff": "hand", "test": "static"}})
        with Headless(tmp_path, *options, "--subject", "P01") as terminal:
            assert terminal.until("session_opened")["trials"] == 2
            terminal.until("waiting", what="start")
            terminal.send("arm")
            terminal.until("state_changed", state="recording")
            terminal.child.kill()
        asyncio.run(_go_on_at_the_console(path, tmp_path / "simulated" / "monday", bench))
        with Headless(tmp_path, *options) as terminal:
            assert terminal.until("session_opened")["done"] == 1
            verdict = terminal.until("verdict")
            assert {"damping_n_s_per_m"} <= {figure["quantity"] for figure in verdict["figures"]}
            terminal.until("decided")
            terminal.until("summing_up")
            terminal.send("end")
            assert terminal.until("session_closed")["done"] == 2
            assert terminal.child.wait(scaled_timeout(PATIENCE_S)) == 0
    journal = read_journal(tmp_path / "simulated" / "monday")
    assert [(one.test, one.accepted) for one in journal.recorded] == [("static", True), ("dynamic", True)]
    assert [verdict.choice for verdict in journal.verdicts.values()] == ["accept", "accept"]


async def _go_on_at_the_console(path: Path, folder: Path, bench: object) -> None:
    config = load_config(path)
    controller = SessionController(config, SPEED, None, clock_port(config))
    controller.reviewer._worker = ThreadedWorker()
    try:
        controller.session.resume(folder)
        async with asyncio.timeout(scaled_timeout(PATIENCE_S)):
            while controller.session.judgement is None:  # as the page's heartbeat: the recorder's trial is waited for
                await controller.reviewer.process_recordings()
                await asyncio.sleep(0.2)
            controller.reviewer.decide("accept", "")
            bench.request({"trial": {"cuff": "hand", "test": "dynamic"}})  # type: ignore[attr-defined]
            await controller.runner.arm()
            while controller.runner.live is not None:
                await asyncio.sleep(0.05)
    finally:
        controller.close()
    assert controller.session.plan is not None and controller.session.plan.undecided is not None, (
        controller.session.message
    )


# Trials of the simulated wearer, guided, judged and kept without a page.


def wearer_practice() -> StationConfig:
    data = wearer_config().model_dump(mode="json")
    data["mocap"]["control"] = "start"
    return parse_config(data, "test")


@pytest.mark.slow
def test_the_pose_is_skipped_and_the_motion_recorded_judged_and_kept(tmp_path: Path) -> None:
    config, folder = wearer_practice(), tmp_path / "simulated" / "session"
    commands = iter(("skip", "arm"))

    def answer(event: SessionEvent) -> str | None:
        return next(commands) if isinstance(event, Waiting) else None

    with ThreadedBench(practice_settings(config), None, 3) as bench:
        output = lead(bench, bench.configure(config), folder, answer, SETUP)
    assert [(trial.test, trial.condition) for trial in output.of(NextTrial)] == [("pose", None), ("motion", "unsuited")]
    assert [skipped.test for skipped in output.of(TrialSkipped)] == ["pose"]
    cues = {cue.code for cue in output.of(CueChanged)}
    # A busy computer may poll past a phase of a fast simulation; tests of the guide itself check the sequence of cues.
    assert cues and cues <= {CueCode.RAISE_ARM, CueCode.LOWER_ARM, CueCode.MOTION_DONE}
    (verdict,) = output.of(VerdictGiven)
    assert (verdict.title, verdict.advice) == ("motion, without the suit", "accept")
    assert {row.quantity: row.this for row in verdict.rows}["cycles"] == f"{CYCLES} of {CYCLES}"
    (warning,) = output.of(WarningRaised)
    assert warning.code == "not_summed_up" and "no recording of a cuff" in warning.sentence
    assert [trial.condition for trial in read_journal(folder).recorded] == ["unsuited"]


if __name__ == "__main__":
    lead_by_keys(Path(sys.argv[1]))
