"""A session without a page: its own decisions, its questions, and problems between two trials."""

import asyncio
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import count
from pathlib import Path
from unittest.mock import AsyncMock, Mock

import pytest
import qtm_rt

from drivers.errors import DeviceCode
from recordings.reader import open_recording
from station.bench.bench_clock import BenchClock
from station.config import StationConfig, load_config
from station.journal import Recorded, read_journal, write_recorded, write_verdict
from station.messages.bench_messages import RefusalCode, TrialCode
from station.messages.session_messages import CommandCode
from station.session.trial_runner import TrialProcess
from station.terminal import events
from station.terminal.sequencer import SessionSequencer
from tests.station.console.served import write_config
from tests.station.terminal.practice import SETUP, Answer, ScriptedOutput, lead, remote_bench

Told = Callable[[events.SessionEvent], bool]
Rule = tuple[Told, str | Callable[[], object]]


def nth(number: int, is_such: Told) -> Told:
    """The n-th such event."""
    seen = count(1)
    return lambda event: is_such(event) and next(seen) == number


def is_decided(number: int, choice: str = "accept") -> Told:
    return nth(number, lambda event: isinstance(event, events.Decided) and event.choice == choice)


def refused(number: int) -> Told:
    return nth(number, lambda event: isinstance(event, events.CommandAnswered) and event.is_refused)


def answers(*rules: Rule) -> Answer:
    """Each rule answers once; a function is done instead of a command given.

    Every trial is armed when it waits for that, and the session ends where it is summed up.
    """
    waiting = list(rules)

    def answer(event: events.SessionEvent) -> str | None:
        if isinstance(event, events.SummaryStarted):
            return "end"
        if isinstance(event, events.Waiting) and event.what == "start":
            return "arm"
        fitting = [rule for rule in waiting if rule[0](event)]  # every rule is evaluated: some count
        for rule in fitting[:1]:
            waiting.remove(rule)
            if isinstance(rule[1], str):
                return rule[1]
            rule[1]()
        return None

    return answer


def is_in(state: str, number: int = 1) -> Told:
    """The n-th time that a trial is in this state."""
    return nth(number, lambda event: isinstance(event, events.StateChanged) and event.state == state)


def warned(code: str) -> Told:
    return lambda event: isinstance(event, events.WarningRaised) and event.code == code


@pytest.mark.slow
def test_a_plan_is_recorded_judged_and_kept_with_arm_as_the_only_command(tmp_path: Path) -> None:
    with remote_bench(tmp_path / "bench") as (bench, config):
        output = lead(bench, config, tmp_path / "simulated" / "monday", answers())
    assert [trial.test for trial in output.of(events.NextTrial)] == ["static", "dynamic"]
    assert output.of(events.NextTrial)[0].order == "Don the hand cuff, rope slack"
    assert [(one.choice, one.by) for one in output.of(events.Decided)] == [("accept", "station")] * 2
    (stiffness,) = [
        figure for figure in output.of(events.VerdictGiven)[0].figures if figure.quantity == "stiffness_n_per_m"
    ]
    assert stiffness.low < 8520 < stiffness.high, "what the simulated hand cuff has"
    assert output.of(events.SessionClosed)[0].done == 2
    journal = read_journal(tmp_path / "simulated" / "monday")
    assert [journal.verdicts[recorded.file].choice for recorded in journal.recorded] == ["accept", "accept"]


@pytest.mark.slow
def test_commands_of_the_operator_are_executed_and_stored_in_the_journal(tmp_path: Path) -> None:
    """Redo after a decision, don anew, pause and continue, skip, and a redo without a reason."""
    script = answers(
        (is_decided(1), "redo"),  # no reason
        (refused(1), "redo the cuff sat askew"),  # which loses the migration
        (refused(2), "redon the cuff sat askew"),
        (is_decided(1, "redo"), "pause"),
        (lambda event: isinstance(event, events.Waiting) and event.what == "pause", "arm"),
        (is_decided(2), "skip"),
    )
    with remote_bench(tmp_path / "bench") as (bench, config):
        output = lead(bench, config, tmp_path / "simulated" / "monday", script)
    codes = [answer.code for answer in output.of(events.CommandAnswered)]
    assert codes == [CommandCode.REASON_MISSING, CommandCode.LOSES_MIGRATION]
    orders = [trial.order for trial in output.of(events.NextTrial)]
    assert orders[-2:] == ["Don the hand cuff, rope slack", "Rope slack, wearer at ease"]
    journal = read_journal(tmp_path / "simulated" / "monday")
    assert journal.donnings == {"hand": 1} and [spec.test for spec in journal.skipped] == ["dynamic"]
    assert list(journal.redone.values()) == ["the cuff sat askew"]
    assert [(one.test, one.donning) for one in journal.recorded] == [("static", "1"), ("static", "2")]
    closed = output.of(events.SessionClosed)[0]
    assert (closed.done, closed.skipped, closed.is_complete) == (1, 1, False), "ended while it was summed up"


def test_a_recording_with_reasons_to_redo_waits_for_a_decision_here_or_elsewhere(tmp_path: Path) -> None:
    """The trial is stopped much too early: the fit refuses it, and `station judge` in another terminal decides."""
    folder = tmp_path / "simulated" / "monday"

    def judge() -> None:
        write_verdict(folder, read_journal(folder).recorded[0].file, "redo", "stopped by mistake")

    def waits(event: events.SessionEvent) -> bool:
        return isinstance(event, events.Waiting) and event.what == "decision"

    with remote_bench(tmp_path / "bench") as (bench, config):
        script = answers(
            (is_in("recording"), "stop"),
            (waits, judge),
            (lambda event: isinstance(event, events.Decided) and event.by == "elsewhere", "end"),
        )
        output = lead(bench, config, folder, script)
    assert output.of(events.VerdictGiven)[0].advice == "redo" and output.of(events.VerdictGiven)[0].reasons
    (decided,) = output.of(events.Decided)
    assert (decided.choice, decided.reason, decided.by) == ("redo", "stopped by mistake", "elsewhere")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "words"),
    [({"device": "qtm", "fault": "restart"}, "QTM"), ({"device": "ni", "fault": "refuse"}, "Dev1")],
    ids=["QTM restarts", "the DAQ is not to be had"],
)
def test_a_device_missing_between_two_trials_is_named_and_the_session_continues(
    tmp_path: Path, fault: dict[str, str], words: str
) -> None:
    """The world stands still between two trials, so the fault lasts until the test lets time pass."""
    with remote_bench(tmp_path / "bench") as (bench, config):
        script = answers(
            (is_decided(1), lambda: bench.request({"fault": {**fault, "for_s": 20.0}})),
            (warned("not_ready"), lambda: bench.request({"pause_s": 21.0})),
        )
        output = lead(bench, config, tmp_path / "simulated" / "monday", script)
    (warning,) = [event for event in output.of(events.WarningRaised) if event.code == "not_ready"]
    assert words in warning.sentence and "\n" not in warning.sentence
    assert output.of(events.SessionClosed)[0].done == 2


def test_the_plan_is_reordered_and_any_trial_skipped_or_redone_by_its_number(tmp_path: Path) -> None:
    """Static and dynamic of two repeats; the first two are kept already."""
    folder, setup = tmp_path / "simulated" / "monday", replace(SETUP, repeats=2)
    folder.mkdir(parents=True)
    for test in ("static", "dynamic"):
        (folder / f"{test}.mcap").touch()
        write_recorded(folder, Recorded(f"{test}.mcap", "hand", test, 1, "1", True, 0, "the capture ended"))
        write_verdict(folder, f"{test}.mcap", "accept", "")
    commands = iter(["next #4", "skip #3", "redo #2 the rope was caught", "trials", "next #1", "redo #9 it slipped"])

    def answer(event: events.SessionEvent) -> str | None:
        if isinstance(event, events.CommandAnswered | events.Waiting | events.PlanListed):
            return next(commands, "end")
        return None

    output = lead(None, load_config(write_config(tmp_path)), folder, answer, setup)
    assert [trial.number for trial in output.of(events.NextTrial)] == [3, 4, 4, 4]
    assert [(one.file, one.reason) for one in output.of(events.Decided)] == [("dynamic.mcap", "the rope was caught")]
    (listed,) = output.of(events.PlanListed)
    assert [trial.state for trial in listed.trials] == ["kept", "to come", "skipped", "next"]
    assert [refused.code for refused in output.of(events.CommandAnswered)] == [
        CommandCode.NOT_LEFT,
        CommandCode.NO_SUCH_TRIAL,
    ]


@pytest.fixture
def refused_by(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., ScriptedOutput]:
    """A session whose recorders refuse every trial with this code; another attempt fails the test."""

    def lead_refused(code: str, *rules: Rule, wait: object = None) -> ScriptedOutput:
        process = Mock(spec=["recorded", "refusal", "refusal_code", "follow"])
        process.configure_mock(recorded=None, refusal="not recorded", refusal_code=code, follow=AsyncMock())
        monkeypatch.setattr(TrialProcess, "start", AsyncMock(return_value=process))
        monkeypatch.setattr(SessionSequencer, "_wait", wait)
        return lead(None, load_config(write_config(tmp_path)), tmp_path / "monday", answers(*rules))

    return lead_refused


def test_a_session_ends_if_its_folder_is_not_for_the_data_of_these_devices(
    refused_by: Callable[..., ScriptedOutput],
) -> None:
    """Every further attempt would be refused, too."""
    output = refused_by(RefusalCode.SIMULATED_DEVICES)
    (warning,) = output.of(events.WarningRaised)
    assert (warning.cause, warning.retry_s) == (RefusalCode.SIMULATED_DEVICES, None)
    assert output.events[-1] == output.of(events.SessionClosed)[0]


def test_a_session_without_operator_ends_if_a_device_is_missing_for_ten_minutes(
    monkeypatch: pytest.MonkeyPatch, refused_by: Callable[..., ScriptedOutput]
) -> None:
    """The reason is shown at once and about once a minute."""
    waits: list[float] = []

    async def wait(sequencer: SessionSequencer, seconds: float) -> None:
        waits.append(seconds)
        await asyncio.sleep(0)

    monkeypatch.setattr("station.terminal.sequencer.POLL_S", 0.001)
    output = refused_by(DeviceCode.NO_ANSWER, (lambda event: isinstance(event, events.SessionOpened), ""), wait=wait)
    assert waits[:5] == [2.0, 4.0, 8.0, 15.0, 15.0]
    assert 500.0 < sum(waits) < 600.0
    warnings = output.of(events.WarningRaised)
    assert [warning.retry_s for warning in warnings] == [15.0] * 10 + [None]
    assert {warning.cause for warning in warnings} == {DeviceCode.NO_ANSWER}
    assert not output.of(events.SessionClosed)[0].is_complete


def test_a_recorded_trial_whose_result_cannot_be_read_is_not_tried_again(
    refused_by: Callable[..., ScriptedOutput],
) -> None:
    output = refused_by(RefusalCode.UNREADABLE_MESSAGE, (warned("telemetry_unread"), "end"))
    (warning,) = output.of(events.WarningRaised)
    assert (warning.code, warning.cause) == ("telemetry_unread", RefusalCode.UNREADABLE_MESSAGE)


@pytest.mark.slow
def test_a_missed_edge_is_reported_and_the_trial_is_armed_again(tmp_path: Path) -> None:
    """No capture starts in time; the vendor's own client starts one once the trial is armed for the second time.

    From the first trial on the world waits for the test, because 20 s of it take less than a second of the wall clock.
    """
    with remote_bench(tmp_path / "bench", control="none", timeout_s=20.0) as (bench, config):
        mocap, clock, held = _MocapOperator(config), BenchClock(bench.clock_port), threading.Event()

        def hold() -> None:
            clock.__enter__()
            held.set()

        def is_armed_again(event: events.SessionEvent) -> bool:
            return held.is_set() and isinstance(event, events.StateChanged) and event.state == "armed"

        def start() -> None:
            clock.step()  # the sync line is low while the trial is armed
            mocap.start()
            clock.close()

        script = answers((warned("not_recorded"), hold), (is_armed_again, start), (is_decided(1), "end"))
        output = lead(bench, config, tmp_path / "simulated" / "monday", script)
    (missed,) = output.of(events.WarningRaised)
    assert (missed.code, missed.cause) == ("not_recorded", TrialCode.NO_SYNC_EDGE_LOW)
    assert [ended.accepted for ended in output.of(events.TrialEnded)] == [True]


@pytest.mark.slow
def test_an_unplanned_capture_is_reported_and_not_recorded(tmp_path: Path) -> None:
    """The vendor's own client starts a capture before the trial is armed, stops it, and then starts the trial's."""
    with remote_bench(tmp_path / "bench", control="none", timeout_s=1000.0) as (bench, config):
        mocap = _MocapOperator(config)

        def restart() -> None:
            mocap.stop()
            bench.request({"pause_s": 5.0})
            mocap.start()

        script = answers((is_in("idle"), mocap.start), (warned("capture_running"), restart), (is_decided(1), "end"))
        output = lead(bench, config, tmp_path / "simulated" / "monday", script)
    assert [warning.code for warning in output.of(events.WarningRaised)] == ["capture_running"]
    (ended,) = output.of(events.TrialEnded)
    assert ended.accepted and ended.codes == (TrialCode.CAPTURE_ENDED,)
    (recorded,) = read_journal(tmp_path / "simulated" / "monday").recorded
    frames = open_recording(tmp_path / "simulated" / "monday" / recorded.file).load("/markers").sample_numbers
    assert frames[0] == 1, "of the second capture from its first frame on, and none of the first"


class _MocapOperator:
    """An operator of the mocap system, who uses the vendor's client."""

    def __init__(self, config: StationConfig) -> None:
        self._port = config.mocap.port

    def start(self) -> None:
        self._do("new", "start")

    def stop(self) -> None:
        self._do("stop", "close")

    def _do(self, *commands: str) -> None:
        async def send() -> None:
            connection = await qtm_rt.connect("127.0.0.1", self._port)
            await connection.take_control("")
            for command in commands:
                await getattr(connection, command)()
            await connection.release_control()
            connection.disconnect()
            await asyncio.sleep(0)  # for the transport to close

        with ThreadPoolExecutor(1) as beside_the_event_loop:
            beside_the_event_loop.submit(asyncio.run, send()).result()
