"""One check of the bench for all pages, whose worst result decides, with readings that go into the next session."""

import asyncio
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from documents.message import Message
from drivers.errors import DeviceLost
from fitting.trial.mass_checks import MassCheck, read_checks
from station.bench.bench_clock import BenchClock
from station.bench.check import OPEN_S, CheckResult, inspect_bench_and_zero, survey_devices
from station.clock import ManualClock
from station.config import StationConfig
from station.console.setup_view import check_verdict
from station.messages.bench_messages import CheckCode
from station.messages.session_messages import CommandCode
from station.session.controller import BenchChecker
from station.session.open_session import CommandRefused, OpenSession
from tests.refusals import raises_refusal

GOOD = CheckResult("disk", Message(CheckCode.LABELS_PRESENT), is_good=True)
DOUBTFUL = CheckResult("/markers", Message(CheckCode.NO_CAPTURE, {"nominal_hz": 100}), is_good=True, is_doubtful=True)
BAD = CheckResult("NI Dev1", Message(CheckCode.NO_ANSWER, {"device": "NI Dev1", "timeout_s": 5}), is_good=False)
RIGHT = CheckResult("2 kg on the load cell", Message(CheckCode.MASS_RIGHT), is_good=True)
ZERO, LOADED = MassCheck("a", 0.0, 0.0, 3.0, 0.01, None), MassCheck("b", 2.0, 19.6, 19.6, 0.01, 3.0)


class Bench:
    """Answers for the worker process, and counts the checks."""

    def __init__(self, *results: CheckResult) -> None:
        self.results, self.checks, self.timeout_scales = list(results), 0, set[float]()

    async def __call__(self, work: Callable[..., Any], *arguments: Any) -> Any:
        await asyncio.sleep(0)
        self.timeout_scales.add(arguments[-1])
        if work is inspect_bench_and_zero:
            self.checks += 1
            return list(self.results), ZERO
        return LOADED, RIGHT


def checker_of(bench: Bench, clock_port: int | None = None) -> tuple[BenchChecker, OpenSession]:
    session = OpenSession(StationConfig(), None, clock_port)
    return BenchChecker(session, bench), session


def test_the_worst_result_comes_first_and_is_the_verdict() -> None:
    checker, _ = checker_of(Bench(GOOD, DOUBTFUL, BAD))
    assert checker.grade is None
    asyncio.run(checker.wait())
    assert checker.results[:2] == (BAD, DOUBTFUL) and checker.results[-1] == GOOD and checker.grade == "bad"
    assert check_verdict(checker.grade, checker.results) == "not ready: 1 problem"


def test_several_pages_wait_for_one_check() -> None:
    bench = Bench(GOOD)
    checker, _ = checker_of(bench)

    async def pages() -> None:
        await asyncio.gather(checker.wait(), checker.check(), checker.wait())
        await checker.wait()

    asyncio.run(pages())
    assert bench.checks == 1


def test_a_known_mass_completes_the_check_and_its_readings_go_into_one_session(tmp_path: Path) -> None:
    checker, _ = checker_of(Bench(GOOD))
    asyncio.run(checker.wait())
    assert (checker.grade, checker.results[0].message.code) == ("doubtful", CheckCode.MASS_UNREAD)
    asyncio.run(checker.read_mass(2.0))
    assert checker.grade == "good" and RIGHT in checker.results
    for folder in ("first", "second"):
        checker.write_readings(tmp_path / folder)
    assert read_checks(tmp_path / "first") == (ZERO, LOADED) and read_checks(tmp_path / "second") == ()


@pytest.mark.parametrize(("clock_port", "timeout_scale"), [(None, 1.0), (5000, BenchClock.timeout_scale)])
def test_a_simulated_bench_has_the_timeouts_of_its_trials(clock_port: int | None, timeout_scale: float) -> None:
    bench = Bench(GOOD)
    checker, _ = checker_of(bench, clock_port)
    asyncio.run(checker.read_mass(2.0))
    assert bench.timeout_scales == {timeout_scale}


class OpeningDevice:
    """A device that opens until it is released."""

    name, streams = "NI Dev1", ()

    def __init__(self) -> None:
        self.is_released = threading.Event()

    def open(self) -> None:
        self.is_released.wait()
        raise DeviceLost("released")

    def close(self) -> None: ...


class SecondByLook(ManualClock):
    """A wall clock that is a second later at every look, and releases the device in the fourth second."""

    timeout_scale = 0.2

    def __init__(self, device: OpeningDevice) -> None:
        super().__init__()
        self._device, self._looks = device, 0

    def wall_s(self) -> float:
        self._looks += 1
        if self._looks == 4:
            self._device.is_released.set()
        return float(self._looks)


def test_a_device_has_its_scaled_time_to_open(tmp_path: Path) -> None:
    device = OpeningDevice()
    survey, (name,) = survey_devices(StationConfig(), tmp_path, SecondByLook(device), lambda *_: [device])  # type: ignore[list-item]
    assert survey.errors[name] == Message(CheckCode.NO_ANSWER, {"device": name, "timeout_s": 0.2 * OPEN_S})


def test_while_a_trial_runs_the_devices_are_not_read() -> None:
    bench = Bench(GOOD)
    checker, session = checker_of(bench)
    session.has_running_trial = True
    with raises_refusal(CommandCode.TRIAL_RUNNING, kind=CommandRefused):
        asyncio.run(checker.check())
    assert bench.checks == 0
