"""The recorder's end of the pipe: a live process that crashes, freezes or never starts does not touch a recording."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from documents.message import Message
from drivers.simulators.settings import settings_from_dict
from drivers.simulators.simulated_bench import Bench
from recordings.contents import read_contents
from recordings.samples import Samples, Stream
from station.bench.bench_clock import BenchClock
from station.bench.simulation import simulator_settings
from station.bench.trial_recorder import TrialRecorder
from station.bench.view import Snapshot, TrialState
from station.child import Child
from station.clock import ManualClock
from station.config import StationConfig, parse_config
from station.live import tap as tap_module
from station.live.tap import BACKLOG, LiveRequest, LiveTap, live_views
from station.messages.bench_messages import TrialCode
from station.protocol import TrialSpec
from tests.station.children import start
from tests.station.live.trials import TIGHT
from tests.station.wearer import wearer_config

POSE = TrialSpec(None, "pose", 1)
REQUEST = LiveRequest(StationConfig(), Path(), POSE, 0)


def frame(number: int) -> Samples:
    values = np.zeros((1, 400, 4), np.float32)
    return Samples("/markers", np.array([number], np.uint64), np.array([number], np.int64), number, values)


def crashes() -> Child:
    return start("crash")


def cannot_start() -> Child:
    raise FileNotFoundError("no-such-program")


@pytest.mark.parametrize("command", [crashes, cannot_start])
def test_a_recording_outlives_the_live_process(
    command: Callable[[], Child], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    config = wearer_config()
    with Bench(settings_from_dict(simulator_settings(config)), speed=None, seed=5) as bench:
        data = config.model_dump(mode="json")
        data["daq"]["grpc_target"] = f"127.0.0.1:{bench.ports['ni']}"
        data["mocap"] |= {"host": "127.0.0.1", "port": bench.ports["qtm"]}
        bench.world.select_trial(None, "pose", None)
        folder = tmp_path / "simulated" / "session"
        with BenchClock(bench.ports["clock"]) as clock, LiveTap(REQUEST, command) as tap:
            result = TrialRecorder(parse_config(data, "test"), clock, [tap]).record(folder, POSE)
    assert result.accepted and result.lost_samples == 0 and result.path is not None
    assert read_contents(result.path).complete
    assert "recording is not affected" in capfd.readouterr().err
    assert tap.exit_code == (3 if command is crashes else None)


def test_what_a_frozen_live_process_does_not_read_is_dropped_and_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    """The pipe and the backlog take some blocks; every further one costs the oldest, and offer() never waits."""
    monkeypatch.setattr("station.bench.view.JOIN_TIMEOUT_S", 0.05)
    monkeypatch.setattr(tap_module, "JOIN_TIMEOUT_S", 5.0)
    count = 4 * BACKLOG
    with LiveTap(REQUEST, lambda: start("freeze")) as tap:
        for number in range(count):
            tap.offer(frame(number))
        dropped = tap.dropped
    assert count - 2 * BACKLOG < dropped + BACKLOG <= count
    assert tap.exit_code not in (None, 0)  # it was killed at the end


def test_requests_are_kept_where_frames_are_dropped_and_a_preview_is_no_capture(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    tap = LiveTap(REQUEST, cannot_start)
    markers = Stream("/markers", "mm", tuple(f"M{k}" for k in range(400)), 100.0, "test")
    recording = Snapshot(TrialState.RECORDING, streams=(markers,), recording=Path("a.mcap"))
    tap.show(recording)
    for number in range(2 * BACKLOG):
        tap.offer(frame(number))
    kinds = [type(content).__name__ for content, _ in tap._waiting]
    assert kinds[:3] == ["dict", "Stream", "dict"] and len(kinds) == BACKLOG
    assert tap.dropped == BACKLOG + 3
    # The recorder does not store them (Closing), so a replay would not have them.
    tap = LiveTap(REQUEST, cannot_start)
    tap.offer(frame(1))
    tap.show(Snapshot(TrialState.CLOSING, (Message(TrialCode.CAPTURE_ENDED),)))
    tap.offer(frame(2))
    taken = [content.host_time_ns for content, _ in tap._waiting if isinstance(content, Samples)]
    assert taken == [1]


def test_live_is_off_by_default_and_only_for_trials_with_markers_on_the_body(tmp_path: Path) -> None:
    config = wearer_config()
    on = config.model_copy(update={"live": config.live.model_copy(update={"enabled": True})})
    clock = ManualClock()
    assert live_views(config, tmp_path, TIGHT, clock) == []
    assert live_views(on, tmp_path, TrialSpec("hand", "static", 1), clock) == []
    assert len(live_views(on, tmp_path, TIGHT, clock)) == 1
    assert replace(TIGHT, repeat=2).test == "motion"
