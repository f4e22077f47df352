"""Recordings made by the first version of the format open, to the last bit, for as long as there is this project."""

from hashlib import sha256
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from recordings.contents import read_contents
from recordings.reader import open_recording
from recordings.recovery import recover
from recordings.samples import Event, Loss
from tests.recordings.golden import make_format_1, make_format_1_body
from tests.recordings.trials import items_of

FORMAT_1, BODY = (Path(__file__).parent / "golden" / f"{name}.mcap" for name in ("format_1", "format_1_body"))


@pytest.mark.parametrize(
    ("path", "digest", "made_by", "causes"),
    [
        (FORMAT_1, "c592fad0f8dd332e7ebb91a3f98f3a15ab07ada7b89cd1597a41dace8f7630de", make_format_1, ["skipped"]),
        (BODY, "5ad37ca9ca939c9163ea6b051b892ae86ef8a1bfef908e8968d75cf9a1507268", make_format_1_body, []),
    ],
    ids=["a cuff", "a body"],
)
def test_format_1_opens_whole_with_the_items_that_the_code_of_today_writes(
    tmp_path: Path, path: Path, digest: str, made_by: ModuleType, causes: list[str]
) -> None:
    assert sha256(path.read_bytes()).hexdigest() == digest, "the file is the one that was made"
    recording = open_recording(path)
    assert (recording.complete, recording.manifest, recording.streams) == (True, made_by.MANIFEST, made_by.STREAMS)
    assert recording.outcome.sentence == "the mocap capture ended"
    assert [gap.cause for gap in read_contents(path).gaps] == causes
    made_by.write_golden(tmp_path / "today.mcap")
    assert items_of(open_recording(tmp_path / "today.mcap")) == items_of(recording)


def test_format_1_gives_its_samples_events_and_losses() -> None:
    recording = open_recording(FORMAT_1)
    assert recording.outcome.samples == {"/force": 1000, "/sync": 1000, "/markers": 98}
    force, sync, markers = (recording.load(name) for name in ("/force", "/sync", "/markers"))
    assert force.sample_numbers.tolist() == list(range(1000))
    assert force.device_time_ns.tolist() == [n * 1_000_000 for n in range(1000)]
    assert force.host_time_ns[250] == 1_795_000_000_000_000_000 + 299_000_000 + 4_000_000
    assert force.values[250, 0] == force.values.max() == -force.values.min() == 205 * 20 / 4096
    assert np.flatnonzero(np.diff(sync.values[:, 0]) == 5.0).tolist() == [249]
    assert markers.sample_numbers.tolist() == [n for n in range(100) if n not in (51, 52)]
    seen = ~np.isnan(markers.values[:, 3, 0])
    assert np.flatnonzero(~seen).tolist() == [20, 21, 22, 23, 24]
    for column in range(4):
        assert set(markers.values[seen, column, 0]) == {100.0 * column}, "under their labels, also in another order"
    assert set(markers.values[seen, :, 3].ravel()) == {0.5}
    items = list(recording.items())
    assert [item.kind for item in items if isinstance(item, Event)] == ["armed"]
    assert [(item.first_missing, item.count) for item in items if isinstance(item, Loss)] == [(51, 2)]


def test_format_1_can_be_recovered_when_it_is_cut(tmp_path: Path) -> None:
    (tmp_path / "cut.mcap").write_bytes(FORMAT_1.read_bytes()[:-100])
    report = recover(tmp_path / "cut.mcap")
    assert report.lossless
    assert items_of(open_recording(report.output)) == items_of(open_recording(FORMAT_1))


def test_emg_has_a_column_per_channel_and_both_clocks() -> None:
    recording = open_recording(BODY)
    assert recording.manifest.subject == make_format_1_body.MANIFEST.body
    emg, pulse, clock, analog = (recording.load(name) for name in ("/emg", "/emg_sync", "/emg_clock", "/analog"))
    assert emg.values.shape == (400, 2)
    assert emg.values[399].tolist() == [99.75, -199.5]
    assert np.flatnonzero(np.diff(pulse.values[:, 0])).tolist() == [199]
    ahead_ns = make_format_1_body.AMPLIFIER_AHEAD_NS
    assert int(clock.host_time_ns[0] - clock.device_time_ns[0]) == make_format_1_body.START_NS - ahead_ns
    assert analog.values[[0, -1], 0].tolist() == [-2.5, 2.5]
