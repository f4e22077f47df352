"""The controller without a browser: one session, at most one trial, refusals with codes."""

import asyncio
import shutil
import sys
import threading
from collections.abc import Awaitable, Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from filelock import FileLock
from scipy.constants import g

from documents.message import Message
from drivers.errors import DeviceCode
from recordings.reader import open_recording
from recordings.samples import Event
from station.bench.simulation import SimulatedBench, practice_settings
from station.bench.trial_recorder import LOCK
from station.checksums import JOURNAL_FILE
from station.config import StationConfig, load_config
from station.journal import JournalError, Recorded, Setup, read_journal, write_recorded, write_verdict
from station.messages.bench_messages import AlarmCode, TrialCode
from station.messages.session_messages import CommandCode, JournalCode, ReasonCode, TerminalCode
from station.messages.setup_messages import FolderCode
from station.protocol import TrialSpec
from station.session.controller import SessionController
from station.session.guide import guide_for
from station.session.open_session import CommandRefused, list_sessions
from station.session.summary import Summary
from station.session.trial_runner import LiveTrial, TrialRunner
from station.session.worker import Worker, WorkerKilled
from tests.refusals import raises_refusal
from tests.station.console.served import write_config
from tests.station.session.benched import ThreadedBench, ThreadedWorker, simulated_bench
from tests.timeout import scaled_timeout

SETUP = Setup("P01", "ab", ("hand",), 1, has_bounce=False)
PATIENCE_S = 120.0
SPEED = 12.0
HOLD_S = 600.0
"""Long, for a trial that the test ends."""


@pytest.fixture
def controller(tmp_path: Path) -> Iterator[SessionController]:
    controller = SessionController(load_config(write_config(tmp_path)))
    controller.reviewer._worker = ThreadedWorker()
    controller.session.config = with_folder(controller.session.config, tmp_path / "sessions")
    yield controller
    controller.close()


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[SimulatedBench, StationConfig]]:
    with simulated_bench(tmp_path_factory.mktemp("bench"), speed=SPEED, hold_s=HOLD_S) as both:
        yield both


def with_folder(config: StationConfig, folder: Path) -> StationConfig:
    return config.model_copy(update={"session": config.session.model_copy(update={"folder": folder})})


async def until(is_met: Callable[[], bool]) -> None:
    async with asyncio.timeout(scaled_timeout(PATIENCE_S)):
        while not is_met():
            await asyncio.sleep(0.02)


def run(work: Awaitable[None]) -> None:
    async def whole() -> None:
        await work

    asyncio.run(whole())


def put_recording(controller: SessionController, run: int = 1, test: str = "static") -> str:
    """A recording in the session, and its line in the journal."""
    assert controller.session.folder is not None
    name = f"sub-P01_ses-1_task-{test}_acq-hand_run-{run}.mcap"
    (controller.session.folder / name).touch()
    write_recorded(controller.session.folder, Recorded(name, "hand", test, 1, "1", True, 0, "the mocap capture ended"))
    return name


def test_a_wrong_set_up_is_refused_without_a_folder(controller: SessionController) -> None:
    with raises_refusal(CommandCode.WRONG_SUBJECT, kind=CommandRefused):
        controller.session.begin(replace(SETUP, subject="../P01"))
    assert controller.session.folder is None and not controller.session.config.session.folder.exists()


class SilentBench:
    """A simulated bench that answers no request."""

    clock_port = 0

    def __init__(self) -> None:
        self.is_asked = threading.Event()

    def request(self, _request: object) -> None:
        self.is_asked.set()
        threading.Event().wait()


def test_the_end_waits_for_no_answer_of_the_simulated_bench(controller: SessionController) -> None:
    controller.session.begin(SETUP)
    bench = SilentBench()
    runner = TrialRunner(controller.session, bench)  # type: ignore[arg-type]

    async def arm_and_end() -> None:
        arming = asyncio.ensure_future(runner.arm())
        await until(bench.is_asked.is_set)
        arming.cancel()

    program = threading.Thread(target=asyncio.run, args=(arm_and_end(),), daemon=True)
    program.start()
    program.join(scaled_timeout(10.0))
    assert not program.is_alive()


def test_a_session_is_resumed_with_its_plan(controller: SessionController) -> None:
    controller.session.begin(SETUP)
    name = put_recording(controller)
    controller.reviewer.decide("accept", "")
    controller.session.mvc_file, controller.session.mvc_uv = "mvc.mcap", {"deltoid": 240.0}
    controller.session.leave()
    assert controller.session.folder is None
    controller.session.begin(SETUP)
    assert (controller.session.mvc_file, controller.session.mvc_uv) == ("", {}), "it may be of another wearer"
    plan = controller.session.plan
    assert plan is not None and len(plan.done) == 1
    assert plan.spec is not None and plan.spec.test == "dynamic"
    assert [
        (listed.setup, listed.done, listed.trials) for listed in list_sessions(controller.session.config.session.folder)
    ] == [(SETUP, 1, 2)]
    assert name in controller.session.journal.verdicts


def move(folder: Path) -> None:
    folder.rename(folder.with_name("elsewhere"))


def put_a_file_in_place(folder: Path) -> None:
    move(folder)
    folder.write_text("a file\n")


def damage(folder: Path) -> None:
    (folder / "session.jsonl").write_text("no entry\n")


@pytest.mark.parametrize(
    ("lose", "code"),
    [
        (move, JournalCode.GONE),
        (shutil.rmtree, JournalCode.GONE),
        # below a file, Windows finds no path
        (put_a_file_in_place, JournalCode.GONE if sys.platform == "win32" else JournalCode.UNREADABLE),
        (damage, JournalCode.WRONG_LINE),
    ],
)
def test_a_session_whose_folder_is_lost_is_closed_with_one_sentence(
    controller: SessionController, lose: Callable[[Path], None], code: JournalCode
) -> None:
    controller.session.begin(SETUP)
    name, folder = put_recording(controller), controller.session.folder
    assert folder is not None
    assert name in {recorded.file for recorded in controller.session.journal.recorded}
    lose(folder)
    assert controller.session.plan is not None, "a page shows the session until it is closed"
    with raises_refusal(code, kind=JournalError):
        run(controller.runner.arm())
    if code is not JournalCode.WRONG_LINE:
        with pytest.raises(JournalError):
            controller.session.note("", "written after the loss")
    assert folder.is_dir() is (code is JournalCode.WRONG_LINE), "no second session is made in its place"
    run(controller.process_recordings())
    assert controller.session.folder is None and str(folder) in controller.session.message
    controller.session.message = ""
    run(controller.process_recordings())
    assert controller.session.message == "", "once"


def test_names_of_marks_that_cannot_be_stored_at_the_end_of_a_trial_are_reported(controller: SessionController) -> None:
    controller.session.begin(SETUP)
    folder, plan = controller.session.folder, controller.session.plan
    assert folder is not None and plan is not None and plan.spec is not None
    controller.runner.live = LiveTrial(plan.spec, guide_for("dynamic", controller.session.trial_config.protocol))
    controller.runner.live.mark_names[1] = "coughed"
    recorded = Recorded("a.mcap", "hand", "static", 1, "1", True, 0, "the mocap capture ended")

    async def lose_folder(_: object) -> None:
        move(folder)

    trial: Any = SimpleNamespace(recorded=recorded, refusal="", refusal_code="", follow=lose_folder)
    run(controller.runner._follow(trial))
    assert str(folder / JOURNAL_FILE) in controller.session.message


def test_a_new_console_returns_to_the_session_of_which_a_trial_is_still_recorded(controller: SessionController) -> None:
    for subject in ("P01", "P02"):
        controller.session.begin(replace(SETUP, subject=subject))
        controller.session.leave()
    recorded = controller.session.config.session.folder / "sub-P01_ses-1"
    controller.resume_recorded()
    assert controller.session.folder is None
    with FileLock(recorded / LOCK):  # as the recorder of a killed console
        controller.resume_recorded()
        assert controller.session.folder == recorded and controller.session.is_recorded_elsewhere
        asyncio.run(controller.reviewer.process_recordings())
        assert controller.session.is_recorded_elsewhere
    asyncio.run(controller.reviewer.process_recordings())
    assert not controller.session.is_recorded_elsewhere


def test_a_note_after_the_report_asks_for_a_new_one(controller: SessionController) -> None:
    controller.session.begin(SETUP)
    controller.session.note("", "left-handed")
    controller.session.summary = Summary((), ())
    controller.session.note("", "left-handed")
    assert controller.session.summary is not None, "it has this note"
    controller.session.note("", "right-handed")
    assert controller.session.summary is None and controller.session.message


@pytest.mark.parametrize(
    "line", ["[" * 100_000, '{"kind": "setup", "at": "", "subject": 5}', "\0", '{"at": 1e999}', "?"]
)
def test_a_malformed_journal_hides_no_other_session(controller: SessionController, line: str) -> None:
    controller.session.begin(SETUP)
    controller.session.leave()
    malformed = controller.session.config.session.folder / "sub-P02_ses-1"
    malformed.mkdir()
    (malformed / "session.jsonl").write_text(line + "\n")
    assert [listed.setup for listed in list_sessions(controller.session.config.session.folder)] == [SETUP]


def test_another_plan_under_the_same_number_is_refused(controller: SessionController) -> None:
    controller.session.begin(SETUP)
    controller.session.leave()
    with raises_refusal(CommandCode.OTHER_PLAN, kind=CommandRefused):
        controller.session.begin(replace(SETUP, repeats=3))
    with raises_refusal(CommandCode.OTHER_PLAN, kind=CommandRefused):
        controller.session.begin(replace(SETUP, step_masses_kg=(5.0,)))
    controller.session.begin(replace(SETUP, step_masses_kg=(2.0, 2.0, 2.0)))
    controller.session.begin(replace(SETUP, repeats=3, number="2"))
    assert controller.session.folder is not None and controller.session.folder.name == "sub-P01_ses-2"


def test_a_rehearsal_leaves_nothing(controller: SessionController) -> None:
    controller.session.begin(SETUP, is_rehearsal=True)
    folder = controller.session.folder
    assert folder is not None and (folder / "session.jsonl").is_file()
    controller.session.leave()
    assert not folder.exists() and not controller.session.config.session.folder.exists()


def test_to_redo_a_trial_needs_a_reason_and_a_cuff_donned_anew_is_another_donning(
    controller: SessionController,
) -> None:
    controller.session.begin(SETUP)
    put_recording(controller)
    with raises_refusal(JournalCode.NO_REASON, kind=JournalError):
        controller.reviewer.decide("redo", " ")
    assert controller.session.plan is not None and controller.session.plan.undecided is not None
    controller.reviewer.decide("redo", "the wearer coughed")
    plan = controller.session.plan
    assert plan is not None and plan.spec is not None and (plan.undecided, plan.done) == (None, frozenset())
    assert plan.spec.donning == "1"
    put_recording(controller, run=2)
    controller.reviewer.decide("redo", "it slipped", is_donned_anew=True)
    plan = controller.session.plan
    assert plan is not None and plan.spec is not None
    assert plan.spec.donning == "2" and plan.is_new_cuff


def test_a_session_in_a_folder_of_any_name_is_resumed(controller: SessionController, tmp_path: Path) -> None:
    controller.session.begin(SETUP, folder=tmp_path / "monday")
    controller.session.leave()
    controller.session.resume(tmp_path / "monday")
    assert controller.session.journal.setup == SETUP
    with raises_refusal(CommandCode.NO_PLAN, kind=CommandRefused):
        controller.session.resume(tmp_path / "tuesday")


def test_a_skipped_trial_stays_skipped_when_the_session_is_resumed(controller: SessionController) -> None:
    controller.session.begin(SETUP)
    assert controller.session.skip().test == "static"
    controller.session.leave()
    controller.session.begin(SETUP)
    plan = controller.session.plan
    assert plan is not None and plan.spec is not None
    assert plan.spec.test == "dynamic" and len(plan.skipped) == 1 and not plan.done
    controller.session.skip()
    with raises_refusal(CommandCode.NOTHING_TO_SKIP, kind=CommandRefused):
        controller.session.skip()


def test_any_trial_that_is_left_is_skipped_or_chosen_and_any_kept_one_redone(controller: SessionController) -> None:
    controller.session.begin(replace(SETUP, repeats=2))
    first, second, third, fourth = controller.session.plan.trials  # type: ignore[union-attr]
    controller.session.skip(third)
    controller.session.choose(fourth)
    plan = controller.session.plan
    assert plan is not None and (plan.left, plan.skipped) == ((fourth, first, second), {third})
    put_recording(controller)
    with raises_refusal(CommandCode.NOT_DONE, kind=CommandRefused):
        controller.reviewer.redo(first, "no decision yet")
    controller.reviewer.decide("accept", "")
    with raises_refusal(CommandCode.NOT_LEFT, kind=CommandRefused):
        controller.session.choose(first)
    with raises_refusal(CommandCode.NOTHING_TO_SKIP, kind=CommandRefused):
        controller.session.skip(first)
    with raises_refusal(JournalCode.NO_REASON, kind=JournalError):
        controller.reviewer.redo(first, " ")
    controller.reviewer.redo(first, "the rope was caught")
    plan = controller.session.plan
    assert plan is not None and plan.done == frozenset() and first in plan.left


def test_commands_that_are_not_possible_now_are_refused(controller: SessionController) -> None:
    for work, code in (
        (controller.runner.arm, CommandCode.NO_SESSION),
        (controller.runner.stop, CommandCode.NO_TRIAL),
        (controller.runner.mark, CommandCode.NO_TRIAL),
    ):
        with raises_refusal(code, kind=CommandRefused):
            run(work())
    with raises_refusal(CommandCode.NOTHING_TO_DECIDE, kind=CommandRefused):
        controller.reviewer.decide("accept", "")
    controller.session.begin(SETUP)
    put_recording(controller)
    with raises_refusal(CommandCode.UNDECIDED, kind=CommandRefused):
        run(controller.runner.arm())
    controller.reviewer.decide("accept", "")
    put_recording(controller, test="dynamic")
    controller.reviewer.decide("accept", "")
    with raises_refusal(CommandCode.COMPLETE, kind=CommandRefused):
        run(controller.runner.arm())


def test_a_session_without_recordings_has_no_summary(
    controller: SessionController, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def here(work: Callable[..., object], *arguments: object) -> object:
        return work(*arguments)

    monkeypatch.setattr(controller.reviewer, "in_worker", here)
    controller.session.begin(SETUP)
    run(controller.reviewer.finish())
    figures = {"folder": str(controller.session.folder)}
    assert controller.session.message == str(Message(FolderCode.NO_RECORDING, figures))
    assert controller.reviewer.progress == "" and controller.session.summary is None


def test_an_unexpected_error_of_the_summary_is_a_message(
    controller: SessionController, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def fail(*_: object) -> None:
        raise ZeroDivisionError("oh")

    controller.session.begin(SETUP)
    monkeypatch.setattr(Worker, "run_with_progress", fail)
    run(controller.reviewer.finish())
    figures = {"error": "ZeroDivisionError: oh"}
    assert controller.session.message == str(Message(TerminalCode.SUMMARY_FAILED, figures))
    assert controller.reviewer.progress == ""


def test_after_a_killed_fit_the_operator_decides_without_figures(
    controller: SessionController, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def die(*_: object) -> None:
        raise WorkerKilled

    controller.session.begin(SETUP)
    name = put_recording(controller)
    monkeypatch.setattr(controller.reviewer, "in_worker", die)
    run(controller.reviewer.process_recordings())
    assert (
        controller.session.judgement is not None
        and controller.session.judgement.file == name
        and controller.session.judgement.reasons == (Message(ReasonCode.FIT_KILLED),)
    )


def test_the_mvc_is_that_of_the_last_usable_trial_of_the_session_whoever_recorded_it(
    controller: SessionController, monkeypatch: pytest.MonkeyPatch
) -> None:
    kills = [WorkerKilled()]

    async def read(_: object, path: Path) -> dict[str, float]:
        if kills:
            raise kills.pop()
        return {path.name: 240.0}

    controller.session.begin(SETUP)
    folder = controller.session.folder
    assert folder is not None
    monkeypatch.setattr(controller.reviewer, "in_worker", read)
    for name, is_accepted in (("1.mcap", True), ("2.mcap", True), ("3.mcap", False)):
        (folder / name).touch()
        place = (name, None, "motion", 1, "", is_accepted, 0, "the mocap capture ended")
        write_recorded(folder, Recorded(*place, condition="mvc"))
        write_verdict(folder, name, "accept", "")
    run(controller.reviewer.process_recordings())
    assert (controller.session.mvc_file, controller.session.mvc_uv) == ("", {}), "the worker was killed"
    run(controller.reviewer.process_recordings())
    assert (controller.session.mvc_file, controller.session.mvc_uv) == ("2.mcap", {"2.mcap": 240.0})
    kills += [WorkerKilled(), WorkerKilled()]
    write_verdict(folder, "2.mcap", "redo", "an electrode fell off")
    run(controller.reviewer.process_recordings())
    run(controller.reviewer.process_recordings())
    assert (controller.session.mvc_file, controller.session.mvc_uv) == ("1.mcap", {}), "not read a third time"
    assert controller.session.message == str(Message(TerminalCode.MVC_NOT_READ, {"file": "1.mcap"}))
    write_verdict(folder, "1.mcap", "redo", "an electrode fell off")
    write_verdict(folder, "2.mcap", "accept", "")
    run(controller.reviewer.process_recordings())
    assert controller.session.mvc_uv == {"2.mcap": 240.0}
    write_verdict(folder, "2.mcap", "redo", "an electrode fell off")
    write_verdict(folder, "1.mcap", "accept", "")
    run(controller.reviewer.process_recordings())
    assert controller.session.mvc_uv == {"1.mcap": 240.0}


def test_a_mark_is_named_in_the_journal(controller: SessionController) -> None:
    controller.session.begin(SETUP)
    name = put_recording(controller)
    controller.reviewer.name_mark(2, "coughed")
    assert controller.session.journal.marks == {name: {2: "coughed"}}


def test_devices_that_are_not_ready_are_a_message_and_no_trial(controller: SessionController) -> None:
    """No device listens at these ports: the trial does not begin, no file remains, and arming again is possible."""
    data = controller.session.config.model_dump(mode="json")
    data["daq"]["grpc_target"], data["mocap"]["port"] = "127.0.0.1:9", 9
    controller.session.config = StationConfig(**data)

    async def whole() -> None:
        controller.session.begin(SETUP)
        await controller.runner.arm()
        with raises_refusal(CommandCode.TRIAL_RUNNING, kind=CommandRefused):
            controller.session.leave()
        await until(lambda: controller.runner.live is None)

    run(whole())
    assert "127.0.0.1" in controller.session.message and controller.session.message.count("\n") == 0
    shown_code = DeviceCode(controller.session.message.rpartition("[")[2].removesuffix("]"))
    assert shown_code.startswith(DeviceCode.UNAVAILABLE)
    assert controller.session.plan is not None and controller.session.plan.undecided is None
    assert controller.session.folder is not None and not list(controller.session.folder.glob("*.mcap"))


@pytest.mark.slow
def test_the_simulated_operator_follows_the_cues_and_the_trial_gives_migration(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The holds of the cues, the empty hook first, suffice for the fit."""
    config = load_config(write_config(tmp_path))
    seen: list[tuple[int, float]] = []
    update = LiveTrial.update

    def update_and_note(live: LiveTrial, *arguments: Any) -> bool:
        is_alarm = update(live, *arguments)
        if live.latest.state == "recording" and live.force:
            seen.append((live.cue.step, live.force[-1][1]))
        return is_alarm

    monkeypatch.setattr(LiveTrial, "update", update_and_note)
    with ThreadedBench(practice_settings(config), SPEED, 3) as bench:
        pointed = with_folder(bench.configure(config), tmp_path / "sessions")
        controller = SessionController(pointed, SPEED, bench)
        controller.reviewer._worker = ThreadedWorker()

        async def record() -> None:
            controller.session.begin(SETUP)
            await controller.runner.arm()
            await until(lambda: controller.runner.live is None)
            await controller.reviewer.process_recordings()

        run(record())
        controller.close()
    (recorded,) = controller.session.journal.recorded
    assert [message.code for message in recorded.codes] == [TrialCode.CAPTURE_ENDED]
    assert controller.session.message == "", "the verdict suffices"
    assert sorted({step for step, _ in seen}) == list(range(8)), "every step, and then the end"
    hook, weight = seen[0][1], 2 * g
    for step, newtons in seen:
        expected = hook + weight * min(step, max(6 - step, 0))
        assert newtons < expected + 0.4 * weight or step > 3, "no weight hangs before its cue"
        assert newtons > expected - 0.4 * weight or step <= 3, "none is removed before its cue"
    judgement = controller.session.judgement
    assert judgement is not None and judgement.grade == "good", judgement


@pytest.mark.slow
def test_a_trial_a_second_start_an_alarm_and_a_new_controller_that_resumes(
    running: tuple[SimulatedBench, StationConfig], tmp_path: Path
) -> None:
    bench, config = running
    safety = config.safety.model_copy(update={"force_ceiling_n": 15.0})  # the first weight exceeds it
    config = with_folder(config, tmp_path).model_copy(update={"safety": safety})
    first, second = (SessionController(config, SPEED, bench) for _ in range(2))
    second.reviewer._worker = ThreadedWorker()

    async def record() -> None:
        first.session.begin(SETUP)
        await first.runner.arm()
        with raises_refusal(CommandCode.TRIAL_RUNNING, kind=CommandRefused):
            await first.runner.arm()
        live = first.runner.live
        assert live is not None
        await until(lambda: live.alarm is not None)
        assert live.alarm is not None and live.alarm.code is AlarmCode.FORCE
        first.runner.acknowledge_alarm()
        await until(lambda: live.latest.state == "recording" and live.latest.recorded_s > 4)
        await first.runner.stop()
        await until(lambda: first.runner.live is None)

    run(record())
    first.close()
    assert first.session.message == str(Message(TrialCode.OPERATOR_STOP))
    folder = tmp_path / "sub-P01_ses-1"
    (recorded,) = read_journal(folder).recorded
    assert TrialSpec("hand", "static", 1).test == recorded.test and recorded.accepted
    marks = [item for item in open_recording(folder / recorded.file).items() if isinstance(item, Event)]
    assert [event.text for event in marks if event.kind == "mark"][:1] == ["mark 1"]
    assert read_journal(folder).marks[recorded.file][1].startswith("STOP: ")

    async def resume() -> None:
        second.session.begin(SETUP)
        await second.reviewer.process_recordings()

    run(resume())
    second.close()
    plan = second.session.plan
    assert plan is not None and plan.undecided == recorded
    assert second.session.judgement is not None and second.session.judgement.file == recorded.file
    assert second.session.judgement.marks == len([event for event in marks if event.kind == "mark"])
