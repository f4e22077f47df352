from __future__ import annotations

from pathlib import Path

import filelock
import pytest

from station.file_lock import locked


def test_a_second_one_is_told_that_another_holds_it(tmp_path: Path) -> None:
    with locked(tmp_path / "a.lock", wait_s=0), pytest.raises(TimeoutError, match=r"another process holds .*a\.lock"):
        locked(tmp_path / "a.lock", wait_s=0).__enter__()
    with locked(tmp_path / "a.lock", wait_s=0):
        assert (tmp_path / "a.lock").exists()


def test_a_file_system_without_locks_is_an_error_in_words(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_: filelock.FileLock) -> None:
        raise NotImplementedError("FileSystem does not appear to support flock")

    monkeypatch.setattr(filelock.FileLock, "_acquire", refuse)
    with pytest.raises(OSError, match="its file system has no locks"):
        locked(tmp_path / "a.lock", wait_s=0).__enter__()


@pytest.mark.parametrize("link", ["symlink_to", "hardlink_to"])
def test_a_lock_that_is_a_link_empties_no_other_file(tmp_path: Path, link: str) -> None:
    other = tmp_path / "letter.txt"
    other.write_text("kept")
    getattr(tmp_path / "lock", link)(other)
    with pytest.raises(OSError, match="expected"), locked(tmp_path / "lock", 1.0):
        pass
    assert other.read_text() == "kept"
