from __future__ import annotations

import shutil
from pathlib import Path
from types import SimpleNamespace

import pytest

from recordings.samples import Stream
from station.bench.session_folder import RESERVE_BYTES, USUAL_TRIAL_S, DiskMonitor, bytes_free, bytes_needed
from station.clock import ManualClock
from station.config import parse_config
from station.messages.codes import TrialCode

FORCE = Stream("/force", "V", ("force",), 1000.0, "NI Dev1")
MARKERS = Stream("/markers", "mm", tuple("abcde"), 100.0, "QTM")
CUFF = {"anchor_markers": ["a", "b", "c"], "cuff_markers": ["d"], "site": "arm"}
CONFIG = parse_config({"cuffs": {"one": CUFF, "two": CUFF}, "protocol": {"repeats": 3}}, "test")


def recording(folder: Path) -> Path:
    path = folder / "a.mcap"
    path.touch()
    return path


def test_the_monitor_notices_that_the_recording_is_no_longer_in_its_place(tmp_path: Path) -> None:
    path = recording(tmp_path)
    monitor = DiskMonitor(path, ManualClock())
    path.unlink()
    message = monitor.poll()
    assert message is not None and message.code is TrialCode.RECORDING_MOVED


def test_the_plan_needs_all_of_its_trials_and_the_reserve(tmp_path: Path) -> None:
    a_second = 1000 * 8 + 100 * 5 * 16
    expected = RESERVE_BYTES + 1.1 * 12 * USUAL_TRIAL_S * a_second
    assert bytes_needed([FORCE, MARKERS], CONFIG, tmp_path, None) == pytest.approx(expected)


def test_recorded_trials_need_no_space_and_one_trial_always_does(tmp_path: Path) -> None:
    def needed() -> float:
        return bytes_needed([FORCE], CONFIG, tmp_path, 10.0) - RESERVE_BYTES

    one = 1.1 * 10.0 * 1000 * 8
    for done in range(14):
        assert needed() == pytest.approx(one * max(1, 12 - done))
        (tmp_path / f"{done}.mcap").touch()


def test_the_free_space_of_a_missing_folder_is_that_of_its_parent(tmp_path: Path) -> None:
    assert bytes_free(tmp_path / "not" / "yet") == pytest.approx(shutil.disk_usage(tmp_path).free, rel=0.1)


def test_the_monitor_polls_once_a_second_and_warns_below_the_reserve(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    looks: list[Path] = []
    free = RESERVE_BYTES

    def usage(path: Path) -> SimpleNamespace:
        looks.append(path)
        return SimpleNamespace(free=free)

    monkeypatch.setattr(shutil, "disk_usage", usage)
    clock = ManualClock()
    watch = DiskMonitor(recording(tmp_path), clock)
    for _ in range(30):
        assert watch.poll() is None
        clock.advance(0.1)
    assert len(looks) == 3
    free = RESERVE_BYTES - 1e6
    clock.advance(1.0)
    warning = watch.poll()
    assert warning is not None and warning.figures["free_mb"] == 49.0


def test_a_disk_without_an_answer_has_no_warning(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def usage(path: Path) -> SimpleNamespace:
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(shutil, "disk_usage", usage)
    assert DiskMonitor(recording(tmp_path), ManualClock()).poll() is None
