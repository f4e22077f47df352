from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import filelock
import pytest

from documents.regular_file import locked
from tests.links import symlink


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
