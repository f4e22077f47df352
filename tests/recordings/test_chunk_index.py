"""The index of the chunks costs next to no memory while a file is written, and is the package's own in the file."""

from __future__ import annotations

import gc
from pathlib import Path

import pytest
from mcap.records import ChunkIndex

from recordings import recovery, writer
from recordings.recovery import recover
from recordings.writer import RecordingWriter
from tests.recordings.trials import ACCEPTED, MANIFEST, STREAMS, WallClock, scalars, trial


def written(path: Path) -> Path:
    """Always in the same chunks: no thread decides when the next sync is due."""
    wall = WallClock()
    one = RecordingWriter(path, MANIFEST, STREAMS, clock=wall, sync=lambda _: None, background=lambda work: work())
    for item in trial(20.0):
        wall.now += 0.05
        one.write(item)
    one.close(ACCEPTED)
    return path


def test_the_file_is_what_the_package_would_have_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ours = written(tmp_path / "ours.mcap")
    ours_recovered = recover(ours, tmp_path / "ours_recovered.mcap").output
    for module in (writer, recovery):
        monkeypatch.setattr(module, "keep_index_encoded", lambda _: None)
    theirs = written(tmp_path / "theirs.mcap")
    theirs_recovered = recover(theirs, tmp_path / "theirs_recovered.mcap").output
    assert ours.read_bytes() == theirs.read_bytes()
    assert ours_recovered.read_bytes() == theirs_recovered.read_bytes()


def test_no_object_is_kept_for_a_chunk(tmp_path: Path) -> None:
    wall, path = WallClock(), tmp_path / "a.mcap"
    long_one = RecordingWriter(path, MANIFEST, STREAMS, clock=wall, sync=lambda _: None)
    gc.collect()  # what other tests have left
    before = path.stat().st_size
    for i in range(200):
        wall.now += 0.2
        long_one.write(scalars("/force", i * 10, 10))
    assert path.stat().st_size > before + 200 * 100, "each block is a chunk of its own"
    assert not [each for each in gc.get_objects() if type(each) is ChunkIndex]
    long_one.close(ACCEPTED)
