"""Replacement of a file that another program has open. On Linux the rule of Windows is imitated."""

import errno
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from subprocess import PIPE
from typing import TextIO

import filelock
import pytest

from documents import regular_file
from documents.regular_file import REPLACE_PAUSE_S, REPLACE_TIMEOUT_S, locked, replace_file, replaced
from tests.links import symlink
from tests.windows_files import behave_as_windows


class Wall:
    """Clock of the retries; the file is closed while the given pause is slept."""

    def __init__(self, held: TextIO, closes_at: int) -> None:
        self._held, self._closes_at = held, closes_at
        self.pauses = 0

    def perf_counter(self) -> float:
        return self.pauses * REPLACE_PAUSE_S

    def sleep(self, seconds: float) -> None:
        assert seconds == REPLACE_PAUSE_S
        self.pauses += 1
        if self.pauses == self._closes_at:
            self._held.close()


@pytest.mark.parametrize("held", ["draft", "cuffs.json"])
@pytest.mark.parametrize("closes_at", [1, 5, 10_000])
def test_an_open_file_is_replaced_once_closed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, held: str, closes_at: int
) -> None:
    draft, path = tmp_path / "draft", tmp_path / "cuffs.json"
    draft.write_text("new")
    path.write_text("old")
    if sys.platform != "win32":
        behave_as_windows(monkeypatch, tmp_path)
        monkeypatch.setattr(regular_file.sys, "platform", "win32")
    with (tmp_path / held).open() as holder:
        wall = Wall(holder, closes_at)
        monkeypatch.setattr(regular_file, "time", wall)
        if closes_at * REPLACE_PAUSE_S < REPLACE_TIMEOUT_S:
            replace_file(draft, path)
            assert wall.pauses == closes_at
        else:
            with pytest.raises(PermissionError, match="another program") as caught:
                replace_file(draft, path)
            assert caught.value.filename == str(path)
            assert REPLACE_TIMEOUT_S < wall.perf_counter() <= REPLACE_TIMEOUT_S + 2 * REPLACE_PAUSE_S
            assert draft.read_text() == "new" and path.read_text() == "old"


def test_of_two_files_that_are_replaced_together_the_one_that_failed_is_named(tmp_path: Path) -> None:
    numbers, page = tmp_path / "report.json", tmp_path / "report.html"
    with pytest.raises(OSError, match="full") as failed, replaced(numbers), replaced(page):
        raise OSError(errno.ENOSPC, "the disk is full")
    assert failed.value.filename == str(page)


def test_the_draft_of_a_killed_process_is_removed_and_that_of_a_living_one_is_not(tmp_path: Path) -> None:
    path = tmp_path / "cuffs.json"
    draft = f"from documents.regular_file import *\nwith replaced(Path({str(path)!r})) as draft:"
    draft += "\n draft.write_text('half'); print(draft, flush=True); input()"
    (tmp_path / ".draft-not-locked-yet").mkdir()
    with subprocess.Popen([sys.executable, "-c", draft], stdin=PIPE, stdout=PIPE, text=True) as process:  # noqa: S603
        living = Path(process.stdout.readline().strip())
        with replaced(path) as own, replaced(tmp_path / "other.json") as second:
            own.write_text("new")
            second.write_text("new")
        assert living.read_text() == "half"
        process.kill()
    assert living.exists() and path.read_text() == "new"
    with replaced(path) as own:
        own.write_text("newer")
    assert sorted(found.name for found in tmp_path.iterdir()) == ["cuffs.json", "other.json"]


@pytest.mark.skipif(sys.platform == "win32", reason="an open file is replaced there only after it is closed")
def test_elsewhere_an_open_file_is_replaced_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    draft, path = tmp_path / "draft", tmp_path / "cuffs.json"
    draft.write_text("new")
    path.write_text("old")
    with path.open() as holder:
        replace_file(draft, path)
        assert (path.read_text(), holder.read()) == ("new", "old")
    refusals: list[Path] = []

    def refuse(_: Path, target: Path) -> None:
        refusals.append(target)
        raise PermissionError

    monkeypatch.setattr(Path, "replace", refuse)
    with pytest.raises(PermissionError):
        replace_file(draft, path)
    assert refusals == [path]


def test_a_lock_that_is_held_times_out(tmp_path: Path) -> None:
    with locked(tmp_path / "a.lock", wait_s=0), pytest.raises(TimeoutError, match=r"a\.lock"):
        locked(tmp_path / "a.lock", wait_s=0).__enter__()
    with locked(tmp_path / "a.lock", wait_s=0):
        assert (tmp_path / "a.lock").exists()


def test_a_file_system_without_locks_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_: filelock.FileLock) -> None:
        raise NotImplementedError("FileSystem does not appear to support flock")

    monkeypatch.setattr(filelock.FileLock, "_acquire", refuse)
    with pytest.raises(OSError, match="locks"):
        locked(tmp_path / "a.lock", wait_s=0).__enter__()


@pytest.mark.parametrize("link", [symlink, Path.hardlink_to])
def test_a_lock_that_is_a_link_does_not_truncate_its_target(tmp_path: Path, link: Callable[[Path, Path], None]) -> None:
    other = tmp_path / "letter.txt"
    other.write_text("kept")
    link(tmp_path / "lock", other)
    with pytest.raises(OSError, match="expected"), locked(tmp_path / "lock", 1.0):
        pass
    assert other.read_text() == "kept"
