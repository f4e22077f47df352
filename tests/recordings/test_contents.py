"""What `station info` says of a recording."""

import json
from pathlib import Path

import numpy as np
import pytest

from recordings.contents import read_contents
from recordings.errors import RecordingCode
from recordings.samples import Item, Loss, Samples
from tests.recordings.trials import MANIFEST, START_NS, chunk_ends, frames, record, scalars, skipped, trial
from tests.refusals import raises_refusal


def test_a_whole_recording_is_summed_up(tmp_path: Path) -> None:
    contents = read_contents(record(tmp_path / "a.mcap", list(trial(1.0))))
    assert contents.complete
    assert contents.gaps == ()
    assert contents.manifest == MANIFEST
    assert contents.topics["/force"].messages == 10
    assert contents.topics["/force"].first_ns == START_NS + 99_000_000 + 3_000_000
    assert contents.topics["/force"].last_ns == START_NS + 999_000_000 + 3_000_000
    force, markers = contents.streams["/force"], contents.streams["/markers"]
    assert (force.samples, force.first_sample_number, force.last_sample_number) == (1000, 0, 999)
    assert (force.unit, force.nominal_rate_hz) == ("V", 1000.0)
    assert force.rate_hz == pytest.approx(1000.0)
    assert force.occluded == {}
    assert markers.rate_hz == pytest.approx(100.0)


def test_the_json_has_the_keys_that_others_rely_on(tmp_path: Path) -> None:
    plain = json.loads(read_contents(record(tmp_path / "a.mcap", [*trial(0.2), skipped(20, 3)])).to_json())
    assert set(plain["topics"]["/force"]) == {"messages", "first_ns", "last_ns"}
    assert plain["complete"] is True
    assert [(gap["stream"], gap["cause"], gap["count"]) for gap in plain["gaps"]] == [("/markers", "skipped", 3)]
    assert plain["manifest"]["cuff"]["name"] == "hand"
    assert plain["outcome"]["accepted"] is True
    assert set(plain["topics"]) <= {*plain["outcome"]["messages"], "/outcome"}


def test_the_rate_is_that_of_the_samples_that_came(tmp_path: Path) -> None:
    slow = scalars("/force", 0, 101)
    stretched = Samples("/force", slow.sample_numbers, slow.device_time_ns * 2, slow.host_time_ns, slow.values)
    assert read_contents(record(tmp_path / "a.mcap", [stretched])).streams["/force"].rate_hz == pytest.approx(500.0)
    assert read_contents(record(tmp_path / "b.mcap", [scalars("/force", 0, 1)])).streams["/force"].rate_hz is None


def test_occlusion_is_counted_by_marker(tmp_path: Path) -> None:
    first, second = frames(0, 4), frames(4, 4)
    values = np.ones((8, 4, 4), np.float32)
    values[[1, 5, 6], 2] = np.nan
    values[:, 3] = np.nan
    blocks = [
        Samples("/markers", block.sample_numbers, block.device_time_ns, 0, part)
        for block, part in ((first, values[:4]), (second, values[4:]))
    ]
    occluded = read_contents(record(tmp_path / "a.mcap", blocks)).streams["/markers"].occluded
    assert occluded == {"anchor_1": 0.0, "anchor_2": 0.0, "anchor_3": 3 / 8, "cuff_1": 1.0}


def test_a_jump_that_the_ledger_knows_has_its_cause_and_is_listed_once(tmp_path: Path) -> None:
    for i, items in enumerate(([skipped(5, 3), frames(8, 5)], [frames(8, 5), skipped(5, 3)])):
        contents = read_contents(record(tmp_path / f"{i}.mcap", [frames(0, 5), *items]))
        assert [(gap.cause, gap.first_missing, gap.count) for gap in contents.gaps] == [("skipped", 5, 3)]
        assert contents.complete


def _numbered(*numbers: int) -> Samples:
    block = scalars("/force", 0, len(numbers))
    return Samples("/force", np.array(numbers, np.uint64), block.device_time_ns, block.host_time_ns, block.values)


@pytest.mark.parametrize(
    ("items", "gaps"),
    [
        ([scalars("/force", 0, 10), scalars("/force", 25, 10)], [("unexplained", 10, 15, 9_000_000)]),
        ([_numbered(0, 1, 4, 5, 9)], [("unexplained", 2, 2, 1_000_000), ("unexplained", 6, 3, 3_000_000)]),
        ([scalars("/force", 50, 10), scalars("/force", 0, 10)], [("numbers_went_back", 60, 0, 59_000_000)]),
        (
            [scalars("/force", 0, 10), Loss("/force", "silent", 0, 3000, 9_000_000, START_NS)],
            [("silent", 0, 3000, 9_000_000)],
        ),
    ],
    ids=["between blocks", "within a block", "a device that counts anew", "a loss without a jump"],
)
def test_a_jump_without_a_noted_loss_is_unexplained_and_a_loss_without_a_jump_is_listed(
    tmp_path: Path, items: list[Item], gaps: list[tuple[str, int, int, int]]
) -> None:
    found = read_contents(record(tmp_path / "a.mcap", items)).gaps
    assert [gap.stream for gap in found] == ["/force"] * len(gaps)
    assert [(gap.cause, gap.first_missing, gap.count, gap.last_device_time_ns) for gap in found] == gaps


def test_a_cut_recording_is_incomplete_with_the_reason(tmp_path: Path) -> None:
    path = record(tmp_path / "a.mcap", list(trial(1.0)))
    path.write_bytes(path.read_bytes()[: chunk_ends(path)[4] + 3])
    contents = read_contents(path)
    assert not contents.complete
    assert contents.outcome is None
    assert contents.gaps == ()
    assert contents.missing[-1] == "there is no outcome: the recording was cut, and what came after is unknown"


def test_a_file_with_nothing_in_it_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").touch()
    with raises_refusal(RecordingCode.EMPTY):
        read_contents(tmp_path / "a.mcap")
