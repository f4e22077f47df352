"""The first recording with EMG, the wearer's markers and further analog inputs opens to the last bit."""

from __future__ import annotations

from hashlib import sha256
from pathlib import Path

import numpy as np

from recordings.contents import contents_of
from recordings.reader import open_recording
from tests.recordings.golden import make_format_1_body as golden
from tests.recordings.trials import items_of

FILE = Path(__file__).parent / "golden" / "format_1_body.mcap"


def test_the_golden_file_is_the_one_that_was_made() -> None:
    assert sha256(FILE.read_bytes()).hexdigest() == "5ad37ca9ca939c9163ea6b051b892ae86ef8a1bfef908e8968d75cf9a1507268"


def test_it_opens_whole_with_body_condition_and_amplifier() -> None:
    recording = open_recording(FILE)
    assert recording.complete
    assert recording.manifest == golden.MANIFEST
    assert recording.manifest.subject == golden.MANIFEST.body
    assert recording.streams == golden.STREAMS
    assert not contents_of(FILE).gaps


def test_emg_has_a_column_per_channel_and_both_clocks() -> None:
    recording = open_recording(FILE)
    emg, pulse, clock = (recording.load(name) for name in ("/emg", "/emg_sync", "/emg_clock"))
    assert emg.values.shape == (400, 2)
    assert emg.values[399].tolist() == [99.75, -199.5]
    assert np.flatnonzero(np.diff(pulse.values[:, 0])).tolist() == [199]
    assert int(clock.host_time_ns[0] - clock.device_time_ns[0]) == golden.START_NS - golden.AMPLIFIER_AHEAD_NS
    assert recording.load("/analog").values[[0, -1], 0].tolist() == [-2.5, 2.5]


def test_the_code_of_today_writes_the_same_items(tmp_path: Path) -> None:
    golden.write_golden(tmp_path / "today.mcap")
    assert items_of(open_recording(tmp_path / "today.mcap")) == items_of(open_recording(FILE))
