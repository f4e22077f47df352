"""The file of live results: the golden one opens with every later version, and a newer one is refused."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from recordings import live_result
from recordings.errors import RecordingCode, RecordingError
from recordings.live_result import LiveResultWriter, read_live_result, recover_live_result
from tests.recordings.golden.make_format_1_live import EVENT, FRAMES, MANIFEST, OUTCOME, PATH


def test_the_golden_file_is_read_as_it_was_written() -> None:
    result = read_live_result(PATH)
    assert (result.manifest, result.outcome, result.events) == (MANIFEST, OUTCOME, (EVENT,))
    assert result.is_complete
    for read, written in zip(result.frames, FRAMES, strict=True):
        np.testing.assert_array_equal(read.values, written.values)
        nothing = np.zeros(0)
        assert vars(read) | {"values": nothing.size} == vars(written) | {"values": nothing.size}
    assert result.values.shape == (10, 3)


def test_a_newer_format_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_result, "FORMAT_VERSION", 2)
    LiveResultWriter(tmp_path / "a.live.mcap", MANIFEST).close(OUTCOME, 0)
    monkeypatch.setattr(live_result, "FORMAT_VERSION", 1)
    with pytest.raises(RecordingError) as refused:
        read_live_result(tmp_path / "a.live.mcap")
    assert refused.value.code == RecordingCode.LATER_FORMAT


def test_a_result_is_never_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "a.live.mcap"
    LiveResultWriter(path, MANIFEST).close(OUTCOME, 0)
    before = path.read_bytes()
    with pytest.raises(FileExistsError):
        LiveResultWriter(path, MANIFEST)
    with pytest.raises(RecordingError) as refused:
        recover_live_result(PATH, path)
    assert refused.value.code == RecordingCode.OUTPUT_EXISTS
    assert path.read_bytes() == before


def test_frames_are_in_the_file_a_second_after_they_were_written(tmp_path: Path) -> None:
    """What a kill of the process costs, by a clock by hand."""
    now = [0.0]
    writer = LiveResultWriter(tmp_path / "a.live.mcap", MANIFEST, clock=lambda: now[0])
    for frame in FRAMES[:5]:
        writer.write(frame, 0)
    now[0] = live_result.FLUSH_AFTER_S
    writer.write(FRAMES[5], 0)
    writer.write(FRAMES[6], 0)
    result = read_live_result(tmp_path / "a.live.mcap")
    assert [frame.frame for frame in result.frames] == [1, 2, 3, 4, 5, 6]
    assert result.outcome is None and not result.is_complete
    writer.discard()


def test_every_field_of_a_frame_has_a_place_in_the_file() -> None:
    declared = live_result.LIVE_SCHEMAS["cuffstation.LiveFrame"]
    assert all(f" {field.name} = " in declared for field in dataclasses.fields(live_result.LiveFrame))
