"""The same seed gives the same samples, figures and report on any machine: idle, busy, or with a single core."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from benchmarks.under_load import busy_loops
from recordings.reader import open_recording
from recordings.samples import Event, Loss, Samples
from tests.timeout import scaled_timeout

ROOT = Path(__file__).parents[2]
LOOPS = 4
PATIENCE_S = 200.0
DATES = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d(:\d\d)?(\.\d+)?(\+\d\d:\d\d|Z)?")
HASHES = re.compile(r"\b[0-9a-f]{12,64}\b")


def made(folder: Path, *options: str, loops: int = 0) -> Path:
    """The folder, with the session of one cuff in it."""
    with busy_loops(loops, PATIENCE_S):
        command = [sys.executable, "-m", "tests.house.one_cuff", str(folder), *options]
        subprocess.run(command, check=True, cwd=ROOT, timeout=scaled_timeout(PATIENCE_S))  # noqa: S603
    return folder


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made(tmp_path_factory.mktemp("plain"))


def items_of(path: Path) -> list[Any]:
    """Everything in a recording; times of arrival count from its first sample, for they carry the date."""
    items = list(open_recording(path).items())
    begun_ns = next(item.host_time_ns for item in items if isinstance(item, Samples))
    plain: list[Any] = []
    for item in items:
        if isinstance(item, Samples):
            arrays = (item.sample_numbers, item.device_time_ns, item.values)
            plain.append((item.stream, item.host_time_ns - begun_ns, *(array.tobytes() for array in arrays)))
        elif isinstance(item, Loss):
            plain.append((item.stream, item.cause, item.first_missing, item.count))
        elif isinstance(item, Event):
            plain.append((item.kind, item.host_time_ns - begun_ns))
    return plain


def without_dates_and_hashes(value: Any) -> Any:
    if isinstance(value, dict):
        kept = {key: inner for key, inner in value.items() if key not in ("sha256", "sources", "recorded_utc")}
        return {key: without_dates_and_hashes(inner) for key, inner in kept.items()}
    return [without_dates_and_hashes(inner) for inner in value] if isinstance(value, list) else value


def assert_same(one: Path, other: Path) -> None:
    names = sorted(path.name for path in one.glob("*.mcap"))
    assert names == sorted(path.name for path in other.glob("*.mcap")) and len(names) == 3
    for name in names:
        assert items_of(one / name) == items_of(other / name), name
    cuffs = [json.loads((folder / "cuffs.json").read_text(encoding="utf-8")) for folder in (one, other)]
    assert without_dates_and_hashes(cuffs[0]) == without_dates_and_hashes(cuffs[1])
    pages = [(folder / "report.html").read_text(encoding="utf-8").replace(str(folder), "") for folder in (one, other)]
    pages = [page.replace(folder.name, "") for page, folder in zip(pages, (one, other), strict=True)]
    assert HASHES.sub("", DATES.sub("", pages[0])) == HASHES.sub("", DATES.sub("", pages[1]))


def test_busy_loops_beside_it_change_nothing(plain: Path, tmp_path: Path) -> None:
    assert_same(plain, made(tmp_path, loops=LOOPS))


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="this system does not pin a process to a core")
def test_a_single_core_changes_nothing(plain: Path, tmp_path: Path) -> None:
    assert_same(plain, made(tmp_path, "--pinned"))
