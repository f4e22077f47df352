"""Whatever goes wrong during a trial, its file accounts for every sample that a device numbered."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from drivers.simulators.simulated_bench import Bench
from recordings.contents import contents_of
from recordings.reader import open_recording
from recordings.samples import Event, Samples
from station.bench.bench_clock import BenchClock
from station.bench.trial_recorder import TrialRecorder, TrialResult
from station.config import parse_config
from station.files.info import show_contents
from station.messages.codes import TrialCode
from station.protocol import TrialSpec

ANCHOR = ["anchor_1", "anchor_2", "anchor_3", "anchor_4"]
FAULTS = [
    {"device": "ni", "fault": "overrun", "at_s": 3.0},
    {"device": "qtm", "fault": "skip_frames", "at_s": 4.0, "for_s": 0.3},
    {"device": "qtm", "fault": "no_more_data", "at_s": 6.0, "for_s": 0.5},
    {"device": "ni", "fault": "unplug", "at_s": 9.0, "for_s": 4.0},
    {"device": "qtm", "fault": "restart", "at_s": 16.0, "for_s": 4.0},
    {"device": "ni", "fault": "transfer_aborted", "at_s": 24.0, "for_s": 2.0},
    {"device": "qtm", "fault": "half_packet", "at_s": 30.0},
]


def test_every_lost_sample_is_counted_under_many_faults(
    simulated_bench: Callable[..., Bench], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bench = simulated_bench(faults=FAULTS, protocol={"static": {"hold_s": 3.5}})
    result = recorded(bench, tmp_path)
    assert result.path is not None
    contents = contents_of(result.path)
    causes = {(gap.stream, gap.cause) for gap in contents.gaps}
    assert causes >= {("/force", "overrun"), ("/force", "disconnected"), ("/markers", "skipped")}
    assert not {cause for _, cause in causes} & {"unexplained", "numbers_went_back", "file_damage"}
    for name, stream in contents.streams.items():
        numbered = stream.last_sample_number - stream.first_sample_number + 1
        assert stream.samples + contents.lost(name) == numbered
    assert result.lost_samples == sum(contents.lost(name) for name in contents.streams)
    capsys.readouterr()
    assert show_contents(result.path, as_json=True) == 3
    found = json.loads(capsys.readouterr().out)
    assert {"connection_lost", "connection_restored", "no_more_data"} <= {event["kind"] for event in found["events"]}


@pytest.mark.parametrize(
    ("fault", "missing", "rate_hz"),
    [
        ({"device": "ni", "fault": "unplug"}, ("/force", "/sync"), 1000.0),
        ({"device": "qtm", "fault": "restart"}, ("/markers",), 100.0),
    ],
    ids=lambda value: str(value) if isinstance(value, tuple) else "",
)
def test_the_samples_of_a_lost_device_are_counted_up_to_the_end_of_the_trial(
    simulated_bench: Callable[..., Bench],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    fault: dict[str, Any],
    missing: tuple[str, ...],
    rate_hz: float,
) -> None:
    bench = simulated_bench(faults=[{**fault, "at_s": 6.0, "for_s": 1e6}], protocol={"static": {"hold_s": 60.0}})
    result = recorded(bench, tmp_path)
    assert result.path is not None and not result.accepted
    assert [message.code for message in result.messages] == [TrialCode.DEVICE_LOST]
    contents = contents_of(result.path)
    items = list(open_recording(result.path).items())
    end_ns = next(item.host_time_ns for item in items if isinstance(item, Event) and item.kind == "device_lost")
    for stream in missing:
        last_ns = max(item.host_time_ns for item in items if isinstance(item, Samples) and item.stream == stream)
        assert (end_ns - last_ns) * 1e-9 > 10.0
        assert contents.lost(stream) == pytest.approx((end_ns - last_ns) * 1e-9 * rate_hz, rel=0.05)
    assert result.lost_samples == sum(contents.lost(stream) for stream in missing)
    assert show_contents(result.path, as_json=True) == 3
    found = {gap["stream"]: gap["count"] for gap in json.loads(capsys.readouterr().out)["gaps"]}
    assert found == {stream: contents.lost(stream) for stream in missing}


def recorded(bench: Bench, folder: Path) -> TrialResult:
    config = parse_config(
        {
            "daq": {"grpc_target": f"127.0.0.1:{bench.ports['ni']}"},
            "mocap": {"port": bench.ports["qtm"]},
            "cuffs": {"waist": {"anchor_markers": ANCHOR, "cuff_markers": ["cuff_1"]}},
        },
        "test",
    )
    with BenchClock(bench.ports["clock"]) as clock:
        return TrialRecorder(config, clock).record(folder, TrialSpec("waist", "static", 1))
