"""The recorder's process on a simulated bench: whatever becomes of its console, the trial is kept.

Telemetry shows values, marks, tares and alarms of the running trial.
"""

import asyncio
import math
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import asdict, replace
from itertools import pairwise
from multiprocessing import connection
from pathlib import Path
from typing import Any
from unittest.mock import AsyncMock, MagicMock, Mock

import numpy as np
import pytest
from scipy.constants import g

from documents.message import Message
from recordings.contents import read_contents
from recordings.manifest import BodyMarkers, BounceRig, CuffSite, EmgAmplifier, LoadCell, MeasurementProtocol, TestKind
from recordings.reader import open_recording
from recordings.samples import Event, Item, Loss, Samples, Stream
from station.bench.live_displacement import LiveDisplacement
from station.bench.simulation import SimulatedBench, practice_settings
from station.bench.view import Snapshot, TrialState, TrialTelemetry
from station.child import Child
from station.config import StationConfig, load_config
from station.console.running_view import status_text
from station.journal import Recorded, read_journal
from station.messages.bench_messages import CueCode, RefusalCode, TrialCode
from station.messages.session_messages import ReasonCode
from station.protocol import TrialSpec
from station.session.controller import SessionController
from station.session.fitted_judgement import unfinished_step
from station.session.guide import FreeStaticGuide, MotionGuide, StaticGuide
from station.session.reviewer import adopt_recordings, is_being_recorded
from station.session.trial_daemon import Telemetry
from station.session.trial_runner import ForceLimits, LiveTrial, TrialProcess
from station.terminal.events import TrialMonitor, WarningRaised
from tests.station.console.served import write_config
from tests.station.session.benched import Recorder, ThreadedBench, has_recorded, simulated_bench
from tests.station.session.test_controller import SETUP, SPEED, until, with_folder
from tests.timeout import scaled_timeout

Running = tuple[SimulatedBench, StationConfig]
PATIENCE_S = 120
BLOCK = bytes(1 << 16)  # larger than the buffer of a pipe of Windows
PENDING: list[object] = []  # a write of Windows that has not ended needs its memory
PLANNED = MeasurementProtocol((1.5, 1.0), hold_s=4.0, swing_s=10.0)
LEVEL_S = 8.0
LEVELS = [0.0, 1.5, 2.5, 1.5, 0.0]
"""Kilograms above the empty hook."""
RECORDING = (Message(TrialCode.RECORDING),)
ANCHOR = ("anchor_1", "anchor_2", "anchor_3")
LABELS = (*ANCHOR, "cuff_1", "rope_1", "rope_2")
CUFF = CuffSite("hand", "arm", ANCHOR, ("cuff_1",), ("rope_1", "rope_2"))
CELL = LoadCell("daq", 100.0, -1)
STREAMS = (Stream("/force", "V", ("force",), 1000.0, "NI"), Stream("/markers", "mm", LABELS, 100.0, "QTM"))
AT_REST = np.array([[0, 0, 0], [100, 0, 0], [0, 100, 0], [50, 50, 50], [60, 50, 50], [160, 50, 50]], np.float64)
RNG = np.random.default_rng(11)


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    with simulated_bench(tmp_path_factory.mktemp("bench")) as both:
        yield both


@pytest.fixture
def config(running: Running) -> StationConfig:
    """The bench stands ready for one more dynamic trial."""
    running[0].request({"trial": {"cuff": "hand", "test": "dynamic"}})
    return running[1]


def codes(result: dict[str, Any]) -> list[str]:
    return [message["code"] for message in result["codes"]]


def _full_pipe(pipe: Callable[[], Any] = connection.Pipe) -> tuple[Any, Any]:
    """A pipe whose second end can send nothing until the first end has received."""
    ours, theirs = pipe()
    if sys.platform == "win32":
        import ctypes

        overlapped = ctypes.create_string_buffer(32)
        ctypes.WinDLL("kernel32").WriteFile(ctypes.c_void_p(theirs.fileno()), BLOCK, len(BLOCK), None, overlapped)
        PENDING.append(overlapped)
        return ours, theirs
    os.set_blocking(theirs.fileno(), False)
    with suppress(BlockingIOError):
        while os.write(theirs.fileno(), BLOCK):
            pass
    os.set_blocking(theirs.fileno(), True)
    return ours, theirs


def assert_whole(folder: Path) -> None:
    """One recording, accepted by its recorder, with its line in the journal."""
    (recorded,) = read_journal(folder).recorded
    contents = read_contents(folder / recorded.file)
    assert contents.complete and not contents.gaps
    assert contents.outcome is not None and contents.outcome.accepted
    assert recorded.accepted and [message.code for message in recorded.codes] == [TrialCode.CAPTURE_ENDED]


def test_a_running_trial_sends_telemetry_and_stores_marks(
    running: Running, config: StationConfig, tmp_path: Path
) -> None:
    with Recorder(config, tmp_path, running[0].clock_port) as recorder:
        telemetry = recorder.until(has_recorded(4.0))
        recorder.send({"mark": True})
        assert telemetry["streams"]["/force"]["nominal_hz"] == 1000
        assert telemetry["disk_left_s"] > 0
        assert all(telemetry["seen"].values()) and telemetry["force"] and telemetry["displacement"]
        result = recorder.end()["result"]
        assert recorder.child.process.wait(scaled_timeout(PATIENCE_S)) == 0
        assert recorder.errors() == ""
    assert_whole(tmp_path)
    events = [item for item in open_recording(tmp_path / result["file"]).items() if isinstance(item, Event)]
    assert [event.text for event in events if event.kind == "mark"] == ["mark 1"]


@pytest.mark.slow
def test_a_console_that_receives_nothing_does_not_affect_the_recording(
    running: Running, config: StationConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The pipe to the console is full from the start, so that a thread that sends is blocked for good."""
    monkeypatch.setattr(connection, "Pipe", _full_pipe)
    with Recorder(config, tmp_path, running[0].clock_port) as recorder:
        recorder.let_go()
        assert recorder.child.process.wait(scaled_timeout(PATIENCE_S)) == 0
    assert_whole(tmp_path)


def test_a_killed_console_does_not_affect_the_recording(
    running: Running, config: StationConfig, tmp_path: Path
) -> None:
    with Recorder(config, tmp_path, running[0].clock_port) as recorder:
        recorder.until(has_recorded(2.0))
        recorder.let_go()
        recorder.child.close()
        assert recorder.child.process.wait(scaled_timeout(PATIENCE_S)) == 0
        assert recorder.errors() == ""
    assert_whole(tmp_path)


@pytest.mark.slow
def test_the_file_of_a_killed_recorder_is_recovered_and_waits_for_a_decision(tmp_path: Path) -> None:
    with (
        simulated_bench(tmp_path / "bench") as (bench, config),
        Recorder(config, tmp_path, bench.clock_port) as recorder,
    ):
        recorder.until(has_recorded(4.0))
        assert adopt_recordings(tmp_path) is None and is_being_recorded(tmp_path)
        assert read_journal(tmp_path).recorded == (), "the recorder writes its own entry"
        recorder.child.process.kill()
        recorder.child.process.wait()
    assert not is_being_recorded(tmp_path)
    assert [len(adopt_recordings(tmp_path) or ()) for _ in range(2)] == [1, 0]
    (recorded,) = read_journal(tmp_path).recorded
    assert recorded.file.endswith(".recovered.mcap")
    assert not recorded.accepted
    assert [message.code for message in recorded.codes] == [TrialCode.RECORDER_KILLED]
    assert "/force keeps" in recorded.codes[0].figures["details"], "and no part of the operator's sentence"
    assert "/force" not in recorded.sentence
    assert read_contents(tmp_path / recorded.file).streams["/force"].samples > 1000


def test_a_second_start_is_refused_and_the_first_continues_until_it_is_stopped(
    running: Running, config: StationConfig, tmp_path: Path
) -> None:
    port = running[0].clock_port
    with Recorder(config, tmp_path, port) as recorder, Recorder(config, tmp_path, begins_at_once=False) as second:
        recorder.until(has_recorded(1.0))
        second.begin()
        assert second.end()["code"] == RefusalCode.FOLDER_IN_USE
        recorder.send({"stop": True})
        assert codes(recorder.end()["result"]) == [TrialCode.OPERATOR_STOP]
    (recorded,) = read_journal(tmp_path).recorded
    assert recorded.accepted and not recorded.lost_samples


def test_a_stop_while_armed_records_nothing(running: Running, tmp_path: Path) -> None:
    data = running[1].model_dump(mode="json")
    data["mocap"]["control"] = "none"
    with Recorder(StationConfig(**data), tmp_path, running[0].clock_port) as recorder:
        recorder.until(lambda telemetry: telemetry["state"] == "armed")
        recorder.send({"stop": True})
        result = recorder.end()["result"]
    assert codes(result) == [TrialCode.CANCELLED]
    assert result["file"] == "" and read_journal(tmp_path).recorded == ()
    assert not list(tmp_path.glob("*.mcap"))


@pytest.mark.slow
def test_a_device_lost_during_a_trial_is_named_and_the_recording_kept(tmp_path: Path) -> None:
    with (
        simulated_bench(tmp_path / "bench") as (bench, config),
        Recorder(config, tmp_path, bench.clock_port) as recorder,
    ):
        recorder.until(has_recorded(4.0))
        bench.request({"fault": {"device": "ni", "fault": "unplug", "for_s": 200.0}})
        result = recorder.end()["result"]
    assert not result["accepted"] and result["file"]
    assert codes(result)[0] == TrialCode.END_MISSING and "Dev1" in result["sentence"]
    assert read_contents(tmp_path / result["file"]).complete
    assert read_journal(tmp_path).recorded[0].sentence == result["sentence"]


@pytest.mark.slow
def test_the_next_trial_of_a_simulated_bench_ends_the_capture_of_a_killed_recorder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As the operator of a real mocap system would; the hands that are led wait for cues that no longer come."""
    recorders = []
    start = TrialProcess.start

    async def started(*arguments: object) -> TrialProcess:
        recorders.append(await start(*arguments))  # type: ignore[arg-type]
        return recorders[-1]

    monkeypatch.setattr(TrialProcess, "start", started)
    config = load_config(write_config(tmp_path, hold_s=600.0))  # the test ends both trials
    with ThreadedBench(practice_settings(config), SPEED, 3) as bench:
        controller = SessionController(with_folder(bench.configure(config), tmp_path / "sessions"), SPEED, bench)

        def is_recording() -> bool:
            live = controller.runner.live
            return live is not None and live.latest.state == "recording" and live.latest.recorded_s > 1.0

        async def record() -> None:
            controller.session.begin(SETUP)
            await controller.runner.arm()
            await until(is_recording)
            recorders[0]._child.process.kill()
            await until(lambda: not controller.session.has_running_trial)
            await controller.runner.arm()
            await until(is_recording)
            await controller.runner.stop()
            await until(lambda: controller.runner.live is None)

        asyncio.run(record())
        controller.close()
    assert recorders[1].recorded is not None, recorders[1].refusal
    assert [message.code for message in recorders[1].recorded.codes] == [TrialCode.OPERATOR_STOP]


def test_the_end_of_a_killed_recorder_is_stated_by_the_verdict_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    killed = Message(TrialCode.RECORDER_KILLED, {"kept_s": 0.0})
    entry = Recorded("a.mcap", "hand", "static", 1, "1", False, 0, str(killed), codes=(killed,))
    adopted: list[tuple[Recorded, ...]] = [(), (entry,)]
    monkeypatch.setattr("station.session.reviewer.adopt_recordings", lambda _: adopted.pop(0))
    controller = SessionController(with_folder(load_config(write_config(tmp_path)), tmp_path / "sessions"))
    controller.session.begin(SETUP)
    controller.session.message = "the recorder ended with code -9 during the trial"
    asyncio.run(controller.reviewer.process_recordings())
    assert controller.session.message, "nothing of it was written: the message is all there is"
    asyncio.run(controller.reviewer.process_recordings())
    assert controller.session.message == ""
    controller.close()


def weights(t: float) -> float:
    return 4.0 + g * LEVELS[min(int(t / LEVEL_S), 4)]


def swing(t: float) -> float:
    return 25.0 + (10.0 * math.sin(2 * math.pi * t) if 4.0 < t < 16.0 else 0.0)


@pytest.mark.parametrize(
    ("test", "force", "until_s", "expected"),
    [
        ("static", weights, 0.5 * LEVEL_S, (ReasonCode.WEIGHTS_MISSING, {"found": 0, "planned": 2})),
        ("static", weights, 2.2 * LEVEL_S, (ReasonCode.WEIGHTS_MISSING, {"found": 1, "planned": 2})),
        ("static", weights, 3.2 * LEVEL_S, (ReasonCode.UNLOADING_MISSING, {"found": 0, "planned": 2})),
        ("static", weights, 4.2 * LEVEL_S, (ReasonCode.UNLOADING_MISSING, {"found": 1, "planned": 2})),
        ("static", weights, 5.0 * LEVEL_S, None),
        ("dynamic", swing, 3.0, (ReasonCode.SWING_SHORT, {"found_s": 0.0, "planned_s": 10.0})),
        ("bounce", swing, 9.0, (ReasonCode.SWING_SHORT, {"found_s": pytest.approx(4.0, abs=1.5), "planned_s": 10.0})),
        ("dynamic", swing, 20.0, None),
    ],
)
def test_the_step_at_which_a_trial_ended_is_its_cause(
    test: TestKind,
    force: Callable[[float], float],
    until_s: float,
    expected: tuple[ReasonCode, dict[str, float]] | None,
) -> None:
    points = ((t / 20, force(t / 20)) for t in range(int(20 * until_s)))
    found = unfinished_step(test, PLANNED, points)
    assert found == (Message(*expected) if expected else None)
    assert unfinished_step("static", MeasurementProtocol(), [(0.0, 1.0)]) is None, "no weights are planned"


def played(*messages: dict[str, Any]) -> TrialProcess:
    """A recorder that has already sent everything."""
    child = MagicMock(Child)
    child.__iter__.return_value = iter(messages)
    child.ensure_ended.return_value = 0
    return TrialProcess(child)


def test_a_page_is_served_while_telemetry_arrives_faster_than_it_is_shown() -> None:
    async def served_meanwhile() -> list[int]:
        served, shown = 0, []

        async def serve() -> None:
            nonlocal served
            while True:
                served += 1
                await asyncio.sleep(0)

        page = asyncio.create_task(serve())
        await played(*[{"state": "recording"}] * 200).follow(lambda _: shown.append(served))
        page.cancel()
        return shown

    shown = asyncio.run(served_meanwhile())
    assert len(shown) == 200
    assert all(later > sooner for sooner, later in pairwise(shown)), "other work between two messages"


RESULT = asdict(
    Recorded("a.mcap", "hand", "static", 1, "1", True, 0, "it ended", codes=(Message(TrialCode.CAPTURE_ENDED),))
)


@pytest.mark.parametrize(
    ("result", "message"), [(RESULT, ""), ({**RESULT, "lost_samples": "many"}, f"[{RefusalCode.UNREADABLE_MESSAGE}]")]
)
def test_a_message_of_the_recorder_that_cannot_be_read_is_reported_and_the_trial_followed_to_its_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, result: dict[str, Any], message: str
) -> None:
    process = played({"state": "armed"}, {"state": 5}, {"state": "recording", "force": "x"}, {"result": result})
    monkeypatch.setattr(TrialProcess, "start", AsyncMock(return_value=process))
    controller = SessionController(with_folder(load_config(write_config(tmp_path)), tmp_path / "sessions"))

    async def record() -> LiveTrial:
        controller.session.begin(SETUP)
        await controller.runner.arm()
        live = controller.runner.live
        assert live is not None
        await until(lambda: controller.runner.live is None)
        return live

    live = asyncio.run(record())
    controller.close()
    assert live.latest.state == "armed" and live.unread is not None
    assert (live.unread.code, live.unread.figures["reason"]) == (
        RefusalCode.UNREADABLE_MESSAGE,
        "force is 'x', expected a list",
    )
    assert str(live.unread) in status_text(live) and not controller.session.has_running_trial
    ended = controller.runner.ended
    assert ended is not None and (ended.recorded is None) == bool(message)
    assert controller.session.message.endswith(message or str(live.unread))
    shown: list[object] = []
    monitor = TrialMonitor(shown.append)
    monitor.update(live)
    monitor.update(live)
    assert [one.cause for one in shown if isinstance(one, WarningRaised)] == [RefusalCode.UNREADABLE_MESSAGE]


def moved(frames: int, displacement_mm: float, rope: bool = True) -> np.ndarray:
    """Frames in which the cuff is so far along the rope (+x) while the whole body turns and sways."""
    points = np.tile(AT_REST, (frames, 1, 1))
    points[:, 3:, 0] += displacement_mm
    for frame in points:
        angle, sway = RNG.normal(0, 0.05), RNG.normal(0, 30, 3)
        turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
        frame[:] = frame @ turn.T + sway
    return points


@pytest.mark.parametrize("rope", [CUFF.rope_markers, ()], ids=["rope markers", "the largest direction"])
def test_displacement_is_along_the_rope_while_the_body_moves(rope: tuple[str, ...]) -> None:
    live = LiveDisplacement(replace(CUFF, rope_markers=rope), LABELS)
    for frames, displacement_mm in ((30, 0.0), (5, 7.5), (5, -2.0)):
        last = live.update(moved(frames, displacement_mm))[-5:]
        assert last == pytest.approx(displacement_mm, abs=0.1), "the direction keeps its sign"


def test_a_hidden_cuff_and_an_anchor_of_two_markers_have_no_displacement() -> None:
    live = LiveDisplacement(CUFF, LABELS)
    live.update(moved(30, 0.0))
    hidden = moved(4, 3.0)
    hidden[1:3, 3] = np.nan
    assert np.isnan(live.update(hidden)).tolist() == [False, True, True, False]
    of_two = LiveDisplacement(CuffSite("hand", "arm", ANCHOR[:2], ("cuff_1",)), LABELS)
    assert np.isnan(of_two.update(moved(40, 0.0))).all()


def test_a_bouncing_weight_is_displaced_in_the_laboratory() -> None:
    live = LiveDisplacement(BounceRig(2.5, "weight"), ("other", "weight"))
    frames = np.zeros((60, 2, 3))
    frames[:, 0] = np.nan
    frames[:, 1, 2] = 900.0 + np.concatenate([np.zeros(30), 40.0 * np.sin(np.linspace(0, 6 * np.pi, 30))])
    assert live.update(frames)[30:] == pytest.approx(frames[30:, 1, 2] - 900.0, abs=1e-6)


class TelemetryByHand:
    """A telemetry view driven by hand, and the messages it sent."""

    def __init__(
        self, folder: Path, marked: CuffSite | BodyMarkers = CUFF, streams: tuple[Stream, ...] = STREAMS
    ) -> None:
        self.sent: list[dict[str, Any]] = []
        self.view = Telemetry(self.sent.append, marked, CELL, folder, emg=EmgAmplifier("daq", {"deltoid": 500.0}))
        self.view.show(Snapshot(TrialState.RECORDING, RECORDING, 4.9, 0.0, 3.0, 2, 1, streams))

    def line(self, *items: Item) -> dict[str, Any]:
        for item in items:
            self.view.offer(item)
        self.view._refresh()
        return self.sent[-1]


def force(start_s: float, seconds: float, volts: float) -> Samples:
    numbers = np.arange(round(1000 * start_s), round(1000 * (start_s + seconds)), dtype=np.uint64)
    times = numbers.astype(np.int64) * 1_000_000
    return Samples("/force", numbers, times, int(times[-1]) + 5_000_000, np.full((len(numbers), 1), volts))


def markers(start_s: float, values: np.ndarray) -> Samples:
    numbers = np.arange(len(values), dtype=np.uint64) + round(100 * start_s)
    times = numbers.astype(np.int64) * 10_000_000
    with_residual = np.concatenate([values, np.zeros((*values.shape[:2], 1))], axis=2).astype(np.float32)
    return Samples("/markers", numbers, times, int(times[-1]) + 5_000_000, with_residual)


def test_a_line_has_state_force_in_newtons_lost_samples_and_events_as_text(tmp_path: Path) -> None:
    before = time.time()
    events = Event("capture_started", "capture started", 0, "QTM"), Loss("/force", "overrun", 5, 40, 0, 0)
    telemetry = TelemetryByHand(tmp_path).line(force(0.0, 0.1, -0.25), *events)
    assert before <= telemetry["at"] <= time.time()
    values = [telemetry[key] for key in ("state", "sync_v", "lost_samples", "marks")]
    assert values == ["recording", 4.9, 2, 1]
    assert 3 <= len(telemetry["force"]) <= 6, "a curve for the eye, not a kilohertz"
    assert {newtons for _, newtons in telemetry["force"]} == {25.0}
    assert telemetry["events"] == ["capture started", "lost 40 samples of /force: overrun"]


def test_rates_are_in_station_time_and_the_disk_lasts_for_its_free_space_over_the_measured_rate(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("station.session.trial_daemon.bytes_free", lambda folder: 210_000_000)
    view = TelemetryByHand(tmp_path)
    assert view.line()["disk_left_s"] is None
    for block in range(30):
        telemetry = view.line(force(0.1 * block, 0.1, 0.0))
        if block == 9:
            assert telemetry["streams"]["/force"]["rate_hz"] == pytest.approx(1000, rel=0.02)
            assert telemetry["streams"]["/force"]["nominal_hz"] == 1000
    assert telemetry["disk_left_s"] == pytest.approx((210e6 - 50e6) / 16e3, rel=0.05), "16 bytes a sample, a kilohertz"


def test_a_hidden_marker_is_named_and_leaves_no_point(tmp_path: Path) -> None:
    view = TelemetryByHand(tmp_path)
    view.line(markers(0.0, moved(30, 0.0)))
    hidden = moved(4, 3.0)
    hidden[:, 3] = np.nan
    telemetry = view.line(markers(0.3, hidden))
    assert [name for name, is_seen in telemetry["seen"].items() if not is_seen] == ["cuff_1"]
    assert telemetry["points"][3] is None and telemetry["points"][4] == pytest.approx(hidden[-1, 4], abs=0.06)
    assert telemetry["displacement"] == []


def test_a_closed_console_is_not_an_error(tmp_path: Path) -> None:
    view = TelemetryByHand(tmp_path)
    view.view._send = Mock(side_effect=BrokenPipeError)
    for block in range(3):
        view.view.offer(force(0.1 * block, 0.1, -0.25))
        view.view._refresh()
    view.view._send = view.sent.append
    telemetry = view.line(force(0.3, 0.1, -0.25))
    assert telemetry["streams"]["/force"]["samples"] == 400 and telemetry["dropped"] == 0, "it looked on all the while"


def test_a_view_that_is_not_read_drops_items_and_counts_them(tmp_path: Path) -> None:
    view = TelemetryByHand(tmp_path)
    for _ in range(2100):
        view.view.offer(Event("note", "x", 0, "QTM"))
    assert view.line()["dropped"] == 100


def test_the_curves_begin_at_the_sync_edge(tmp_path: Path) -> None:
    view = TelemetryByHand(tmp_path)
    numbers = np.arange(4000, 5000, dtype=np.uint64)
    sync = Samples("/sync", numbers, numbers.astype(np.int64) * 1_000_000, 5_004_000_000, np.zeros((1000, 1)))
    assert view.line(force(4.0, 1.0, 0.1), sync)["edge_s"] is None
    shown = Snapshot(TrialState.RECORDING, RECORDING, 4.9, 0.0, 3.0, 2, 1, STREAMS, edge_device_ns=4_250_000_000)
    view.view.show(shown)
    telemetry = view.line()
    live = LiveTrial(TrialSpec("hand", "static", 1), StaticGuide((), 1.0))
    live.latest = TrialTelemetry.model_validate(telemetry)
    at_edge_s = telemetry["edge_s"]
    curve = [(-0.5, 1.0), (0.0, 2.0), (1.5, 3.0)]
    assert live.from_edge([(at_edge_s + t, value) for t, value in curve]) == curve
    assert at_edge_s == pytest.approx(-0.749), "a quarter of a second into a block whose last sample came at time 0"
    live.latest = TrialTelemetry.model_validate({**telemetry, "edge_s": None})
    assert live.from_edge([(7.0, 1.0), (9.0, 2.0)]) == [(-2.0, 1.0), (0.0, 2.0)]


def test_of_a_wearer_the_elevation_of_the_arm_and_the_level_of_the_emg_are_shown(tmp_path: Path) -> None:
    body = BodyMarkers(("ac", "el", "c7", "t8"), (), ("ac", "el"), ("c7", "t8"), False)
    streams = (
        Stream("/markers", "mm", ("el", "t8", "c7", "ac"), 100.0, "QTM"),
        Stream("/emg", "V", ("deltoid", "biceps"), 1000.0, "NI"),
    )
    view = TelemetryByHand(tmp_path, body, streams)
    angle = np.radians(60.0)
    el = [300 * np.sin(angle), 0.0, 1400 - 300 * np.cos(angle)]
    frames = np.tile(np.array([el, [-50, 0, 1100], [-50, 0, 1450], [0, 0, 1400]]), (10, 1, 1))
    frames[5:, 0] = np.nan
    t = np.arange(100) / 1000
    volts = np.column_stack([0.1 * np.sqrt(2) * np.sin(2 * np.pi * 100 * t) + 0.02, np.zeros(100)])
    numbers = np.arange(100, dtype=np.uint64)
    emg = Samples("/emg", numbers, numbers.astype(np.int64) * 1_000_000, 105_000_000, volts)
    telemetry = view.line(markers(0.0, frames), emg)
    assert telemetry["displacement"] == [] and telemetry["elevation"]
    assert [angle for _, angle in telemetry["elevation"]] == pytest.approx([60.0] * len(telemetry["elevation"]))
    assert telemetry["emg_uv"] == {"deltoid": pytest.approx(200.0, abs=0.1), "biceps": 0.0}
    live = LiveTrial(TrialSpec(None, "motion", 1, condition="unsuited"), MotionGuide(2))
    live.update(TrialTelemetry.model_validate(telemetry), ForceLimits(150.0, 5e3))
    assert live.motion is live.elevation and live.cue.message.code is CueCode.RAISE_ARM


def test_a_mark_has_its_time_and_a_note_and_a_tare_its_force() -> None:
    live = LiveTrial(TrialSpec("hand", "static", 1), FreeStaticGuide(7.0))
    points = [(0.1 * i, 10.0 + 5.0 * (i > 15)) for i in range(30)]
    live.update(TrialTelemetry(state="recording", recorded_s=2.9, force=points), ForceLimits(150.0, 5e3))
    assert (live.add_mark(), live.add_mark("STOP")) == (1, 2)
    assert live.marks == {1: 2.9, 2: 2.9} and live.mark_names == {2: "STOP"}
    live.tare()
    assert live.tare_n == pytest.approx(15.0)


def test_an_alarm_lasts_until_it_is_acknowledged_and_its_cause_is_gone() -> None:
    live = LiveTrial(TrialSpec("hand", "static", 1), FreeStaticGuide(7.0))

    def raised_by(start_s: float, newtons: float) -> bool:
        points = [(start_s + 0.1 * i, newtons) for i in range(12)]
        return live.update(TrialTelemetry(state="armed", force=points), ForceLimits(150.0, 5e3))

    assert not raised_by(0.0, 20.0) and live.alarm is None
    assert raised_by(2.0, 160.0) and live.unseen_alarm is not None
    assert not raised_by(4.0, 20.0) and live.unseen_alarm is not None, "the operator has not seen it"
    assert not raised_by(6.0, 160.0)
    live.is_alarm_seen = True
    assert not raised_by(8.0, 160.0) and live.unseen_alarm is None and live.alarm is not None, (
        "the force is still above the limit"
    )
    assert not raised_by(10.0, 20.0) and not raised_by(11.5, 20.0) and live.alarm is None
    assert raised_by(13.0, 160.0) and live.unseen_alarm is not None, "another one"
