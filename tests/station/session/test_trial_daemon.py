"""The recorder's process on a simulated bench: whatever becomes of its console, the trial is kept."""

from __future__ import annotations

import asyncio
import math
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import pairwise
from multiprocessing import connection
from pathlib import Path
from typing import Any, cast

import pytest
from scipy.constants import g

from recordings.contents import contents_of
from recordings.manifest import MeasurementProtocol, TestKind
from recordings.reader import open_recording
from recordings.samples import Event
from station.bench.simulation import SimulatedBench, practice_settings
from station.child import Child
from station.config import StationConfig, load_config
from station.journal import Recorded, read_journal
from station.messages.codes import ReasonCode, RefusalCode, TrialCode
from station.messages.message import Message
from station.session.controller import SessionController
from station.session.fitted_judgement import unfinished_step
from station.session.reviewer import adopt_recordings, is_being_recorded
from station.session.trial_runner import TrialProcess
from tests.station.console.served import write_config
from tests.station.session.benched import Recorder, has_recorded, simulated_bench
from tests.station.session.test_controller import SETUP, SPEED, until, with_folder
from tests.timeout import scaled_timeout

PATIENCE_S = 120
BLOCK = bytes(1 << 16)  # larger than the buffer of a pipe of Windows
PENDING: list[object] = []  # a write of Windows that has not ended needs its memory
NOT_FOR_RECORDING = {"scipy", "numba", "pandas", "rich", "nicegui"}


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[SimulatedBench, StationConfig]]:
    with simulated_bench(tmp_path_factory.mktemp("bench")) as both:
        yield both


@pytest.fixture
def config(running: tuple[SimulatedBench, StationConfig]) -> StationConfig:
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
    contents = contents_of(folder / recorded.file)
    assert contents.complete and not contents.gaps
    assert contents.outcome is not None and contents.outcome.accepted
    assert recorded.accepted and [message.code for message in recorded.codes] == [TrialCode.CAPTURE_ENDED]


def test_the_recorder_starts_without_the_packages_of_fits_and_pages() -> None:
    """The operator waits for it before every trial."""
    code = f"import sys, station.session.trial_daemon; print(*{NOT_FOR_RECORDING} & sys.modules.keys())"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)  # noqa: S603
    assert ran.stdout.split() == []


def test_a_running_trial_sends_telemetry_and_stores_marks(
    running: tuple[SimulatedBench, StationConfig], config: StationConfig, tmp_path: Path
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
    running: tuple[SimulatedBench, StationConfig],
    config: StationConfig,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The pipe to the console is full from the start, so that a thread that sends is blocked for good."""
    monkeypatch.setattr(connection, "Pipe", _full_pipe)
    with Recorder(config, tmp_path, running[0].clock_port) as recorder:
        recorder.let_go()
        assert recorder.child.process.wait(scaled_timeout(PATIENCE_S)) == 0
    assert_whole(tmp_path)


def test_a_killed_console_does_not_affect_the_recording(
    running: tuple[SimulatedBench, StationConfig], config: StationConfig, tmp_path: Path
) -> None:
    with Recorder(config, tmp_path, running[0].clock_port) as recorder:
        recorder.until(has_recorded(2.0))
        recorder.let_go()
        recorder.child.close()
        assert recorder.child.process.wait(scaled_timeout(PATIENCE_S)) == 0
        assert recorder.errors() == ""
    assert_whole(tmp_path)


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
    assert contents_of(tmp_path / recorded.file).streams["/force"].samples > 1000


def test_a_second_start_is_refused_and_the_first_continues_until_it_is_stopped(
    running: tuple[SimulatedBench, StationConfig], config: StationConfig, tmp_path: Path
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


def test_a_stop_while_armed_records_nothing(running: tuple[SimulatedBench, StationConfig], tmp_path: Path) -> None:
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
    assert contents_of(tmp_path / result["file"]).complete
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
    config = load_config(write_config(tmp_path, hold_s=5.0))
    with SimulatedBench(practice_settings(config), SPEED, 3) as bench:
        controller = SessionController(with_folder(bench.configure(config), tmp_path / "sessions"), SPEED, bench)

        def is_recording() -> bool:
            live = controller.runner.live
            return live is not None and live.latest["state"] == "recording" and live.latest["recorded_s"] > 1.0

        async def record() -> None:
            controller.session.begin(SETUP)
            await controller.runner.arm()
            await until(is_recording)
            recorders[0]._child.process.kill()
            await until(lambda: not controller.session.has_running_trial)
            await controller.runner.arm()
            await until(lambda: is_recording() or controller.runner.live is None)
            await controller.runner.stop()
            await until(lambda: controller.runner.live is None)

        asyncio.run(record())
        controller.close()
    assert recorders[1].recorded is not None, recorders[1].refusal
    assert [message.code for message in recorders[1].recorded.codes] == [TrialCode.OPERATOR_STOP]


def test_the_end_of_a_killed_recorder_is_stated_by_the_verdict_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    killed = Message(TrialCode.RECORDER_KILLED, {"text": ""})
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


PLANNED = MeasurementProtocol((1.5, 1.0), hold_s=4.0, swing_s=10.0)
LEVEL_S = 8.0
LEVELS = [0.0, 1.5, 2.5, 1.5, 0.0]
"""Kilograms above the empty hook."""


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


def test_without_planned_weights_no_step_is_missing() -> None:
    assert unfinished_step("static", MeasurementProtocol(), [(0.0, 1.0)]) is None


def test_a_page_is_served_while_telemetry_arrives_faster_than_it_is_shown() -> None:
    class Flooding:
        """A recorder that has already sent everything."""

        def __iter__(self) -> Iterator[dict[str, Any]]:
            return iter([{"state": "recording"}] * 200)

        def ensure_ended(self, _: float) -> int:
            return 0

    async def served_meanwhile() -> list[int]:
        served, shown = 0, []

        async def serve() -> None:
            nonlocal served
            while True:
                served += 1
                await asyncio.sleep(0)

        page = asyncio.create_task(serve())
        await TrialProcess(cast(Child, Flooding())).follow(lambda _: shown.append(served))
        page.cancel()
        return shown

    shown = asyncio.run(served_meanwhile())
    assert len(shown) == 200
    assert all(later > sooner for sooner, later in pairwise(shown)), "other work between two messages"
