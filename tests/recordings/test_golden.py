"""Recordings made by the first version of the format open, to the last bit, for as long as there is this project."""

from __future__ import annotations

from hashlib import sha256
from pathlib import Path

import numpy as np

from recordings.contents import read_contents
from recordings.reader import open_recording
from recordings.recovery import recover
from recordings.samples import Event, Loss
from tests.recordings.golden import make_format_1_body as of_body
from tests.recordings.golden.make_format_1 import MANIFEST, STREAMS, write_golden
from tests.recordings.trials import items_of

FORMAT_1 = Path(__file__).parent / "golden" / "format_1.mcap"
BODY = Path(__file__).parent / "golden" / "format_1_body.mcap"


def test_the_golden_file_is_the_one_that_was_made() -> None:
    assert sha256(FORMAT_1.read_bytes()).hexdigest() == (
        "c592fad0f8dd332e7ebb91a3f98f3a15ab07ada7b89cd1597a41dace8f7630de"
    )


def test_format_1_opens_whole() -> None:
    recording = open_recording(FORMAT_1)
    assert recording.complete
    assert recording.manifest == MANIFEST
    assert recording.streams == STREAMS
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
    assert [gap.cause for gap in read_contents(FORMAT_1).gaps] == ["skipped"]


def test_format_1_can_be_recovered_when_it_is_cut(tmp_path: Path) -> None:
    (tmp_path / "cut.mcap").write_bytes(FORMAT_1.read_bytes()[:-100])
    report = recover(tmp_path / "cut.mcap")
    assert report.lossless
    assert items_of(open_recording(report.output)) == items_of(open_recording(FORMAT_1))


def test_the_code_of_today_writes_the_same_items(tmp_path: Path) -> None:
    write_golden(tmp_path / "today.mcap")
    assert items_of(open_recording(tmp_path / "today.mcap")) == items_of(open_recording(FORMAT_1))


def test_the_golden_file_of_a_body_is_the_one_that_was_made() -> None:
    assert sha256(BODY.read_bytes()).hexdigest() == "5ad37ca9ca939c9163ea6b051b892ae86ef8a1bfef908e8968d75cf9a1507268"


def test_format_1_opens_whole_with_body_condition_and_amplifier() -> None:
    recording = open_recording(BODY)
    assert recording.complete
    assert recording.manifest == of_body.MANIFEST
    assert recording.manifest.subject == of_body.MANIFEST.body
    assert recording.streams == of_body.STREAMS
    assert not read_contents(BODY).gaps


def test_emg_has_a_column_per_channel_and_both_clocks() -> None:
    recording = open_recording(BODY)
    emg, pulse, clock = (recording.load(name) for name in ("/emg", "/emg_sync", "/emg_clock"))
    assert emg.values.shape == (400, 2)
    assert emg.values[399].tolist() == [99.75, -199.5]
    assert np.flatnonzero(np.diff(pulse.values[:, 0])).tolist() == [199]
    assert int(clock.host_time_ns[0] - clock.device_time_ns[0]) == of_body.START_NS - of_body.AMPLIFIER_AHEAD_NS
    assert recording.load("/analog").values[[0, -1], 0].tolist() == [-2.5, 2.5]


def test_the_code_of_today_writes_the_same_items_of_a_body(tmp_path: Path) -> None:
    of_body.write_golden(tmp_path / "today.mcap")
    assert items_of(open_recording(tmp_path / "today.mcap")) == items_of(open_recording(BODY))
