"""A recording made by the first version of the format opens, to the last bit, for as long as there is this project."""

from __future__ import annotations

from hashlib import sha256
from pathlib import Path

import numpy as np

from recordings.contents import contents_of
from recordings.reader import open_recording
from recordings.recovery import recover
from recordings.samples import Event, Loss
from tests.recordings.golden.make_format_1 import MANIFEST, STREAMS, write_golden
from tests.recordings.trials import items_of

FORMAT_1 = Path(__file__).parent / "golden" / "format_1.mcap"


def test_the_golden_file_is_the_one_that_was_made() -> None:
    assert sha256(FORMAT_1.read_bytes()).hexdigest() == (
        "c592fad0f8dd332e7ebb91a3f98f3a15ab07ada7b89cd1597a41dace8f7630de"
    )


def test_format_1_opens_whole() -> None:
    recording = open_recording(FORMAT_1)
    assert recording.complete
    assert recording.manifest == MANIFEST
    assert recording.streams == STREAMS
    assert recording.outcome is not None
    assert recording.outcome.sentence == "the mocap capture ended"
    assert recording.outcome.samples == {"/force": 1000, "/sync": 1000, "/markers": 98}


def test_format_1_gives_its_scalars() -> None:
    recording = open_recording(FORMAT_1)
    force, sync = recording.load("/force"), recording.load("/sync")
    assert force.sample_numbers.tolist() == list(range(1000))
    assert force.device_time_ns.tolist() == [n * 1_000_000 for n in range(1000)]
    assert force.host_time_ns[250] == 1_795_000_000_000_000_000 + 299_000_000 + 4_000_000
    assert force.values[250, 0] == 205 * 20 / 4096
    assert force.values.max() == -force.values.min() == 205 * 20 / 4096
    assert np.flatnonzero(np.diff(sync.values[:, 0]) == 5.0).tolist() == [249]


def test_format_1_gives_its_markers_under_their_labels() -> None:
    markers = open_recording(FORMAT_1).load("/markers")
    assert markers.stream == STREAMS[2]
    assert markers.sample_numbers.tolist() == [n for n in range(100) if n not in (51, 52)]
    seen = ~np.isnan(markers.values[:, 3, 0])
    assert np.flatnonzero(~seen).tolist() == [20, 21, 22, 23, 24]
    for column in range(4):
        assert set(markers.values[seen, column, 0]) == {100.0 * column}
    assert set(markers.values[seen, :, 3].ravel()) == {0.5}


def test_format_1_gives_its_events_and_losses() -> None:
    items = list(open_recording(FORMAT_1).items())
    assert [item.kind for item in items if isinstance(item, Event)] == ["armed"]
    assert [(item.first_missing, item.count) for item in items if isinstance(item, Loss)] == [(51, 2)]
    assert [gap.cause for gap in contents_of(FORMAT_1).gaps] == ["skipped"]


def test_format_1_can_be_recovered_when_it_is_cut(tmp_path: Path) -> None:
    (tmp_path / "cut.mcap").write_bytes(FORMAT_1.read_bytes()[:-100])
    report = recover(tmp_path / "cut.mcap")
    assert report.lossless
    assert items_of(open_recording(report.output)) == items_of(open_recording(FORMAT_1))


def test_the_code_of_today_writes_the_same_items(tmp_path: Path) -> None:
    write_golden(tmp_path / "today.mcap")
    assert items_of(open_recording(tmp_path / "today.mcap")) == items_of(open_recording(FORMAT_1))
