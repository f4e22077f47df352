from __future__ import annotations

import os
import sys
import threading
from pathlib import Path

import pytest

from recordings import writer
from recordings.writer import BackgroundSync, sync_folder
from tests.timeout import scaled_timeout


def test_beginning_returns_while_the_disk_is_busy_and_finishing_waits_for_it() -> None:
    release, done = threading.Event(), list[int]()

    def sync() -> None:
        assert release.wait(scaled_timeout(20))
        done.append(1)

    disk = BackgroundSync(sync)
    disk.begin()
    assert disk.is_busy and not done
    release.set()
    disk.finish()
    assert not disk.is_busy and len(done) == 2


def test_what_one_failed_with_stays() -> None:
    answers = [OSError("Input/output error"), None]

    def sync() -> None:
        answer = answers.pop(0)
        if answer is not None:
            raise answer

    disk = BackgroundSync(sync, start=lambda work: work())
    disk.begin()
    disk.finish()
    assert str(disk.failure) == "Input/output error"


def test_a_folder_that_cannot_be_synced_is_no_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []

    def refuse(file: int) -> None:
        asked.append(file)
        raise OSError(22, "Invalid argument")

    monkeypatch.setattr(os, "fsync", refuse)
    sync_folder(tmp_path)
    sync_folder(tmp_path / "missing")
    assert len(asked) == (sys.platform != "win32"), "Windows opens no folder"
    for opened in asked:
        with pytest.raises(OSError, match="Bad file descriptor"):
            os.fstat(opened)


@pytest.mark.parametrize("begun", [True, False], ids=["hangs before the end", "hangs at the end"])
def test_a_disk_that_hangs_does_not_hold_up_the_end_for_ever(monkeypatch: pytest.MonkeyPatch, begun: bool) -> None:
    monkeypatch.setattr(writer, "LONGEST_FINISH_S", 0.01)
    disk = BackgroundSync(lambda: None, start=lambda _: None)
    if begun:
        disk.begin()
    disk.finish()
    assert not disk.is_busy
    assert isinstance(disk.failure, TimeoutError) and disk.failure.strerror == "the disk does not answer"
