"""A session after its recorder was killed, and a trial that ended early, described by the step that was reached."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any, cast

import pytest
from scipy.constants import g

from recordings.manifest import MeasurementProtocol, TestKind
from station.bench.simulation import SimulatedBench, practice_settings
from station.child import Child
from station.config import load_config
from station.journal_lines import Recorded
from station.messages.codes import ReasonCode, TrialCode
from station.messages.message import Message
from station.session.controller import SessionController
from station.session.fitted_judgement import unfinished_step
from station.session.trial_runner import TrialProcess
from tests.station.console.served import write_config
from tests.station.session.test_controller import SETUP, SPEED, until, with_folder


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
