"""Rules of Windows, imitated on other systems: open files, names, path lengths, Ctrl-Break."""

import ast
import os
import runpy
import signal
import subprocess
import sys
from pathlib import Path, PureWindowsPath

import pytest

import station.bench.trial_recorder
from drivers.qualisys_settings import CaptureNote
from recordings.reader import open_recording
from recordings.recovery import recover
from station import child, end_signals
from station.bench.trial_recorder import TrialRefused
from station.checksums import Checksums, is_below, write_whole
from station.config import ConfigError, parse_config
from station.journal import Setup, read_journal, write_setup, write_verdict
from station.messages.bench_messages import RefusalCode
from station.messages.setup_messages import ConfigCode
from station.protocol import windows_name_fault
from tests.refusals import raises_refusal
from tests.station.bench.test_trial_recorder import SPEC, Rig
from tests.windows_files import behave_as_windows

ROOT = Path(__file__).parents[2]
PACKAGES = ("station", "drivers", "recordings", "fitting", "solver", "documents")
POSIX_MODULES = {"fcntl", "termios", "tty", "pty", "pwd", "grp", "resource", "posix", "readline", "syslog", "crypt"}
POSIX_CALLS = {
    "fork", "forkpty", "getpgrp", "getpgid", "tcgetpgrp", "setsid", "setpgrp", "killpg", "nice", "getuid", "geteuid",
    "mkfifo", "statvfs", "getloadavg", "sched_getaffinity", "O_DIRECTORY", "O_NOFOLLOW", "O_NONBLOCK", "SIGHUP",
    "SIGKILL", "SIGTTIN", "SIGUSR1", "SIGUSR2", "SIGCONT", "SIGSTOP", "SIGPIPE", "pthread_kill", "setitimer",
    "pread", "pwrite", "posix_fallocate", "fchmod", "chown", "AF_UNIX", "SO_REUSEPORT", "add_signal_handler",
    "getpwuid", "WNOHANG", "waitpid", "sync", "register_at_fork",
}  # fmt: skip
COARSE_CLOCKS = {"monotonic", "monotonic_ns"}
"""They advance in steps of 16 ms on Windows before Python 3.13, perf_counter does not."""
OWNERS = ("os", "signal", "socket", "select", "loop", "time")
GUARDED = {
    "station/__main__.py": {"resource"},
    "station/terminal/commands.py": {"termios", "tty", "getpgrp", "tcgetpgrp"},
    "station/live/process.py": {"nice"},
    "station/session/worker.py": {"nice"},
    "station/bench/simulation.py": {"SIGTTIN"},
    "station/assessment/compiling_process.py": {"nice"},
}
"""Names that only POSIX has, by file; docs/windows.md describes the guards."""


@pytest.fixture
def windows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the rules of Windows; on Windows, any."""
    if sys.platform != "win32":
        if not Path("/proc/self/fd").is_dir():
            pytest.skip("the imitation reads the open files from /proc")
        behave_as_windows(monkeypatch, tmp_path)
    return tmp_path


@pytest.mark.skipif(sys.platform == "win32", reason="tests the imitation")
def test_the_file_system_of_these_tests_refuses_what_windows_refuses(windows: Path) -> None:
    path = windows / "a.txt"
    with path.open("w"):
        for refused in (path.unlink, lambda: path.replace(windows / "b.txt"), lambda: path.rename(windows / "b.txt")):
            with pytest.raises(PermissionError):
                refused()
    with pytest.raises(PermissionError):
        os.open(windows, os.O_RDONLY)
    for name in ("nul", "COM1.mcap", "a:b", "end."):
        with pytest.raises(OSError, match="Windows"):
            (windows / name).open("w")
    path.unlink()


def test_a_trial_is_recorded_read_recovered_and_one_without_an_edge_leaves_nothing(windows: Path) -> None:
    result = Rig().recorder().record(windows, SPEC)
    assert result.accepted and result.path is not None
    assert open_recording(result.path).complete
    cut = windows / "cut.mcap"
    cut.write_bytes(result.path.read_bytes()[:-2000])
    assert open_recording(recover(cut).output).complete
    assert Rig(delay_s=100.0).recorder().record(windows, SPEC).path is None
    names = ["cuff-hand_test-static_run-1.mcap", "cut.mcap", "cut.recovered.mcap"]
    assert sorted(path.name for path in windows.glob("*.mcap")) == names


def test_decisions_drafts_and_notes_are_written_and_a_file_that_is_open_elsewhere_is_named(windows: Path) -> None:
    write_setup(windows, Setup("P01", "", ("hand",), 1))
    write_verdict(windows, "a.mcap", "accept", "")
    assert read_journal(windows).verdicts["a.mcap"].choice == "accept"
    report = windows / "report.html"
    write_whole(report, "first")
    with report.open(), pytest.raises(PermissionError, match=r"report\.html"):
        write_whole(report, "second")
    assert report.read_text() == "first" and not list(windows.glob(".draft*"))
    note = CaptureNote(windows / ".capture", lambda: 0)
    note.write()
    note.erase()
    assert not (windows / ".capture").exists()


@pytest.mark.parametrize("name", ["aux", "NUL.mcap", "lpt9.x.mcap", "a?b", "a:b", "trailing.", "trailing ", "tab\t"])
def test_a_name_that_windows_does_not_allow_has_a_fault(name: str) -> None:
    assert windows_name_fault(name)


@pytest.mark.parametrize("name", ["x?{test}_{cuff}_{run}", "con.{test}_{cuff}_{run}", "{test}_{cuff}_{run}."])
def test_a_configuration_with_names_that_windows_does_not_allow_is_refused_on_every_system(name: str) -> None:
    with raises_refusal(ConfigCode.WRONG_VALUE, kind=ConfigError) as caught:
        parse_config({"session": {"file_name": name}}, "test")
    assert "session.file_name" in caught.value.cause.figures["reason"]


def test_two_cuffs_that_differ_in_case_only_are_refused() -> None:
    cuff = {"site": "arm", "anchor_markers": ["a", "b", "c"], "cuff_markers": ["d"]}
    with raises_refusal(ConfigCode.WRONG_VALUE, kind=ConfigError):
        parse_config({"cuffs": {"Hand": cuff, "hand": cuff}}, "test")


def test_a_path_that_is_too_long_for_windows_is_refused_before_anything_is_recorded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(station.bench.trial_recorder.sys, "platform", "win32")
    with raises_refusal(RefusalCode.PATH_TOO_LONG, kind=TrialRefused):
        Rig().recorder().record(tmp_path / ("x" * 120) / ("y" * 120), SPEC)


def test_ctrl_break_has_the_effect_of_ctrl_c(monkeypatch: pytest.MonkeyPatch) -> None:
    """Windows has SIGBREAK and no SIGHUP."""
    if sys.platform != "win32":
        monkeypatch.setattr(signal, "SIGBREAK", signal.SIGUSR1, raising=False)
        monkeypatch.delattr(signal, "SIGHUP")
    assert end_signals.end_signals() == (signal.SIGINT, signal.SIGTERM, signal.SIGBREAK)


def test_a_recorder_is_not_in_the_window_or_group_of_its_console(monkeypatch: pytest.MonkeyPatch) -> None:
    if sys.platform != "win32":
        assert child.DETACHED == {"start_new_session": True}
    monkeypatch.setattr(sys, "platform", "win32")
    flags = runpy.run_path(child.__file__)["DETACHED"]
    assert flags == {"creationflags": 0x08000000 | 0x00000200}, "the values that subprocess has on Windows"


def test_every_code_page_gets_utf_8_and_an_unpaired_surrogate_is_escaped() -> None:
    program = (
        "import importlib, io, sys, station.cli\n"
        "sys.platform = 'win32'\n"
        "importlib.reload(station.cli)\n"
        "for encoding in sys.argv[1:]:\n"
        "    written = io.BytesIO()\n"
        "    sys.stdout = io.TextIOWrapper(written, encoding=encoding)\n"
        "    station.cli._ready_streams()\n"
        "    print('ẋ \\ud800', flush=True)\n"
        "    sys.__stdout__.buffer.write(written.getvalue())"
    )
    command = [sys.executable, "-c", program, "cp437", "cp1252", "cp65001", "utf-16-le"]
    own = {**os.environ, "PYTHONPATH": str(ROOT)}
    ran = subprocess.run(command, capture_output=True, check=True, cwd=ROOT, env=own)  # noqa: S603  (our own words)
    assert ran.stdout.split() == ["ẋ".encode(), b"\\ud800"] * 4


@pytest.mark.parametrize("name", ["..\\b", "a\\..\\..\\b", "C:\\b", "C:b", "\\b", "/b", "../b", ""])
def test_a_listed_name_that_leads_out_of_its_folder_on_windows_is_malformed(
    monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.setattr("station.checksums.PurePath", PureWindowsPath)
    assert not is_below(name)
    assert is_below("exports/a.mcap")


def test_a_list_of_hashes_with_a_name_that_windows_does_not_have_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "SHA256SUMS").write_bytes(b"0" * 64 + b"  a\xff.mcap\n" + b"1" * 64 + b"  b.mcap\n")
    monkeypatch.setattr(os, "fsdecode", lambda name: name.decode(errors="surrogatepass"))
    assert Checksums(tmp_path).sums == {"a\udcff.mcap": "0" * 64, "b.mcap": "1" * 64}


def test_every_call_that_only_posix_has_is_listed_and_guarded_and_no_clock_is_coarse() -> None:
    found: dict[str, set[str]] = {}
    for package in PACKAGES:
        for path in (ROOT / package).rglob("*.py"):
            names = _posix_names(path)
            if names:
                found[path.relative_to(ROOT).as_posix()] = names
    assert found == GUARDED
    page = (ROOT / "docs" / "windows.md").read_text(encoding="utf-8")
    assert all(file in page for file in GUARDED)


def _posix_names(path: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names} & POSIX_MODULES
        elif isinstance(node, ast.ImportFrom):
            names |= {node.module or ""} & POSIX_MODULES
        elif isinstance(node, ast.Attribute) and node.attr in POSIX_CALLS | COARSE_CLOCKS:
            names |= {node.attr} if ast.unparse(node.value) in OWNERS else set()
    return names
