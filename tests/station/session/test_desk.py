"""The desk without a browser: one session, at most one trial, refusals in sentences."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Iterator
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from pathlib import Path

import pytest
from scipy.constants import g

from recordings.reader import open_recording
from recordings.samples import Event
from station.bench.simulation import SimulatedBench, practice_settings
from station.config import StationConfig, load_config
from station.journal import JournalError, Recorded, Setup, read_journal, write_recorded, write_setup
from station.protocol import TrialSpec
from station.session.desk import Desk
from station.session.guide import Ceilings, FreeStaticGuide
from station.session.listing import list_sessions
from station.session.live import Live
from station.session.open_session import CommandRefused
from station.session.plan_check import looks_like_a_name
from tests.station.console.served import write_config
from tests.station.session.benched import simulated_bench
from tests.timeout import scaled_timeout

SETUP = Setup("P01", "ab", ("hand",), 1, has_bounce=False)
PATIENCE_S = 120.0
SPEED = 12.0
HOLD_S = 30.0
"""Long, for a trial that the test ends."""


@pytest.fixture
def desk(tmp_path: Path) -> Iterator[Desk]:
    desk = Desk(load_config(write_config(tmp_path)))
    desk.session.config = with_folder(desk.session.config, tmp_path / "sessions")
    yield desk
    desk.close()


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


def put_recording(desk: Desk, run: int = 1, test: str = "static") -> str:
    """A file that a recorder left in the session, and its account."""
    assert desk.session.folder is not None
    name = f"sub-P01_ses-1_task-{test}_acq-hand_run-{run}.mcap"
    (desk.session.folder / name).touch()
    write_recorded(desk.session.folder, Recorded(name, "hand", test, 1, "1", True, 0, "the mocap capture ended"))
    return name


@pytest.mark.parametrize("word", ["Maria", "smith", "Anna Lee", "de Vries"])
def test_a_name_is_told_from_a_code(word: str) -> None:
    assert looks_like_a_name(word)


@pytest.mark.parametrize("word", ["P01", "S12b", "AB", "x3", ""])
def test_a_code_is_no_name(word: str) -> None:
    assert not looks_like_a_name(word)


@pytest.mark.parametrize(
    ("setup", "words"),
    [
        (replace(SETUP, subject="Maria Lee"), "the subject is 'Maria Lee', expected a code of letters and digits"),
        (replace(SETUP, subject="../P01"), "expected a code of letters and digits"),
        (replace(SETUP, cuffs=("hand", "knee")), "no cuff knee; the configuration has hand"),
        (replace(SETUP, number="1/2"), "the session is '1/2', expected letters and digits"),
        (replace(SETUP, step_masses_kg=(2.0, -2.0)), "the load steps are (2.0, -2.0) kg, expected masses above 0"),
        (replace(SETUP, cuffs=()), "no cuff is chosen; the configuration has "),
    ],
)
def test_a_set_up_that_cannot_be_is_refused_and_leaves_no_folder(desk: Desk, setup: Setup, words: str) -> None:
    with pytest.raises(CommandRefused) as refused:
        desk.session.begin(setup)
    assert words in str(refused.value)
    assert desk.session.folder is None and not desk.session.config.session.folder.exists()


def test_a_session_goes_on_another_hour_as_it_was_planned(desk: Desk) -> None:
    desk.session.begin(SETUP)
    name = put_recording(desk)
    desk.reviewer.decide("accept", "")
    desk.session.leave()
    assert desk.session.folder is None
    desk.session.begin(SETUP)
    plan = desk.session.agenda
    assert plan is not None and len(plan.done) == 1
    assert plan.spec is not None and plan.spec.test == "dynamic"
    assert [
        (listed.setup, listed.done, listed.trials) for listed in list_sessions(desk.session.config.session.folder)
    ] == [(SETUP, 1, 2)]
    assert name in desk.session.journal.verdicts


@pytest.mark.parametrize("line", ["[" * 100_000, '{"kind": "setup", "at": "", "subject": 5}', "\0", '{"at": 1e999}'])
def test_a_poisoned_journal_hides_no_other_session(desk: Desk, line: str) -> None:
    desk.session.begin(SETUP)
    desk.session.leave()
    poisoned = desk.session.config.session.folder / "sub-P02_ses-1"
    poisoned.mkdir()
    (poisoned / "session.jsonl").write_text(line + "\n")
    assert [each.setup for each in list_sessions(desk.session.config.session.folder)] == [SETUP]


def test_another_plan_under_the_same_number_is_refused(desk: Desk) -> None:
    desk.session.begin(SETUP)
    desk.session.leave()
    with pytest.raises(CommandRefused, match=r"was planned with 1 repeats of hand and steps of 2 \+ 2 \+ 2 kg; resume"):
        desk.session.begin(replace(SETUP, repeats=3))
    with pytest.raises(CommandRefused, match=r"resume it as it is or give this one another session number"):
        desk.session.begin(replace(SETUP, step_masses_kg=(5.0,)))
    desk.session.begin(replace(SETUP, step_masses_kg=(2.0, 2.0, 2.0)))
    desk.session.begin(replace(SETUP, repeats=3, number="2"))
    assert desk.session.folder is not None and desk.session.folder.name == "sub-P01_ses-2"


def test_a_rehearsal_leaves_nothing(desk: Desk) -> None:
    desk.session.begin(SETUP, is_rehearsal=True)
    folder = desk.session.folder
    assert folder is not None and (folder / "session.jsonl").is_file()
    desk.session.leave()
    assert not folder.exists() and not desk.session.config.session.folder.exists()


def test_to_redo_a_trial_needs_a_reason(desk: Desk) -> None:
    desk.session.begin(SETUP)
    put_recording(desk)
    with pytest.raises(JournalError, match="no reason is given"):
        desk.reviewer.decide("redo", " ")
    assert desk.session.agenda is not None and desk.session.agenda.undecided is not None
    desk.reviewer.decide("redo", "the wearer coughed")
    assert (
        desk.session.agenda is not None
        and desk.session.agenda.undecided is None
        and desk.session.agenda.done == frozenset()
    )


def test_a_cuff_donned_anew_is_another_donning(desk: Desk) -> None:
    desk.session.begin(SETUP)
    put_recording(desk)
    desk.reviewer.decide("redo", "it slipped", is_donned_anew=True)
    plan = desk.session.agenda
    assert plan is not None and plan.spec is not None
    assert plan.spec.donning == "2" and plan.is_new_cuff


def test_a_session_in_a_folder_of_any_name_is_resumed(desk: Desk, tmp_path: Path) -> None:
    desk.session.begin(SETUP, folder=tmp_path / "monday")
    desk.session.leave()
    desk.session.resume(tmp_path / "monday")
    assert desk.session.journal.setup == SETUP
    with pytest.raises(CommandRefused, match="holds no session that could go on"):
        desk.session.resume(tmp_path / "tuesday")


def test_a_skipped_trial_is_passed_over_by_whoever_goes_on(desk: Desk) -> None:
    desk.session.begin(SETUP)
    assert desk.session.skip().test == "static"
    desk.session.leave()
    desk.session.begin(SETUP)
    plan = desk.session.agenda
    assert plan is not None and plan.spec is not None
    assert plan.spec.test == "dynamic" and len(plan.skipped) == 1 and not plan.done
    desk.session.skip()
    with pytest.raises(CommandRefused, match="no trial of the plan is left to skip"):
        desk.session.skip()


def test_what_cannot_be_done_now_is_a_sentence(desk: Desk) -> None:
    for work, words in (
        (desk.runner.arm, "no session is open"),
        (desk.runner.stop, "no trial"),
        (desk.runner.mark, "no trial"),
    ):
        with pytest.raises(CommandRefused, match=words):
            run(work())
    with pytest.raises(CommandRefused, match="no recording waits for a decision"):
        desk.reviewer.decide("accept", "")
    desk.session.begin(SETUP)
    name = put_recording(desk)
    with pytest.raises(CommandRefused, match=f"{name} waits for accept or redo; decide that first"):
        run(desk.runner.arm())
    desk.reviewer.decide("accept", "")
    put_recording(desk, test="dynamic")
    desk.reviewer.decide("accept", "")
    with pytest.raises(CommandRefused, match="the session is complete"):
        run(desk.runner.arm())


def test_a_session_that_cannot_be_summed_up_says_so(desk: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    async def here(work: Callable[..., object], *arguments: object) -> object:
        return work(*arguments)

    monkeypatch.setattr(desk.reviewer, "in_worker", here)
    desk.session.begin(SETUP)
    run(desk.reviewer.finish())
    assert (
        "holds no recording" in desk.session.message and desk.reviewer.progress == "" and desk.session.summary is None
    )


def test_a_fault_of_ours_at_the_end_is_a_sentence_too(desk: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    async def fail(*_: object) -> None:
        raise ZeroDivisionError("oh")

    desk.session.begin(SETUP)
    monkeypatch.setattr(desk.reviewer, "in_worker", fail)
    run(desk.reviewer.finish())
    assert "ZeroDivisionError: oh" in desk.session.message and desk.reviewer.progress == ""


def test_a_fit_that_is_killed_again_and_again_leaves_the_decision_to_the_operator(
    desk: Desk, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def die(*_: object) -> None:
        raise BrokenProcessPool

    desk.session.begin(SETUP)
    name = put_recording(desk)
    monkeypatch.setattr(desk.reviewer, "in_worker", die)
    run(desk.reviewer.look_after())
    assert (
        desk.session.judgement is not None
        and desk.session.judgement.file == name
        and "killed twice" in desk.session.judgement.reasons[0]
    )


def test_a_mark_is_named_in_the_journal(desk: Desk) -> None:
    desk.session.begin(SETUP)
    name = put_recording(desk)
    desk.reviewer.name_mark(2, "coughed")
    assert desk.session.journal.marks == {name: {2: "coughed"}}


def test_a_broken_journal_is_not_among_the_sessions(desk: Desk) -> None:
    folder = desk.session.config.session.folder
    write_setup(folder / "sub-P01_ses-1", SETUP)
    (folder / "sub-P02_ses-1").mkdir()
    (folder / "sub-P02_ses-1" / "session.jsonl").write_text("what?\n")
    assert [listed.setup.subject for listed in list_sessions(desk.session.config.session.folder)] == ["P01"]


def test_devices_that_are_not_ready_are_a_sentence_on_the_page(desk: Desk) -> None:
    """Nothing listens at these ports: the trial does not begin, nothing is left, and arming again is possible."""
    data = desk.session.config.model_dump(mode="json")
    data["daq"]["grpc_target"], data["mocap"]["port"] = "127.0.0.1:9", 9
    desk.session.config = StationConfig(**data)

    async def whole() -> None:
        desk.session.begin(SETUP)
        await desk.runner.arm()
        with pytest.raises(CommandRefused, match="a trial is running"):
            desk.session.leave()
        await until(lambda: desk.runner.live is None)

    run(whole())
    assert "127.0.0.1" in desk.session.message and desk.session.message.count("\n") == 0
    assert desk.session.agenda is not None and desk.session.agenda.undecided is None
    assert desk.session.folder is not None and not list(desk.session.folder.glob("*.mcap"))


def test_a_mark_has_its_time_and_a_note_and_a_tare_its_force() -> None:
    live = Live(TrialSpec("hand", "static", 1), FreeStaticGuide(7.0))
    points = [(0.1 * i, 10.0 + 5.0 * (i > 15)) for i in range(30)]
    live.take(
        {"state": "recording", "recorded_s": 2.9, "force": points, "displacement": [], "words": []},
        Ceilings(150.0, 5e3),
    )
    assert (live.add_mark(), live.add_mark("STOP")) == (1, 2)
    assert live.marks == {1: 2.9, 2: 2.9} and live.mark_names == {2: "STOP"}
    live.tare()
    assert live.tare_n == pytest.approx(15.0)


def test_an_alarm_stays_until_it_was_seen_and_its_cause_is_gone() -> None:
    live = Live(TrialSpec("hand", "static", 1), FreeStaticGuide(7.0))

    def raised_by(start_s: float, newtons: float) -> bool:
        points = [(start_s + 0.1 * i, newtons) for i in range(12)]
        return live.take({"state": "armed", "force": points, "displacement": [], "words": []}, Ceilings(150.0, 5e3))

    assert not raised_by(0.0, 20.0) and live.alarm is None
    assert raised_by(2.0, 160.0) and live.unseen_alarm is not None
    assert not raised_by(4.0, 20.0) and live.unseen_alarm is not None, "nobody has seen it"
    assert not raised_by(6.0, 160.0)
    live.is_alarm_seen = True
    assert not raised_by(8.0, 160.0) and live.unseen_alarm is None and live.alarm is not None, "it still pulls"
    assert not raised_by(10.0, 20.0) and not raised_by(11.5, 20.0) and live.alarm is None
    assert raised_by(13.0, 160.0) and live.unseen_alarm is not None, "another one"


def test_practice_hands_hang_each_weight_when_the_page_asks_for_it_and_the_trial_tells_migration(
    tmp_path: Path,
) -> None:
    """The fit is the judge of the holds that the page asks for, the empty hook first."""
    config = load_config(write_config(tmp_path))
    seen: list[tuple[int, float]] = []
    with SimulatedBench(practice_settings(config), SPEED, 3) as bench:
        pointed = with_folder(bench.pointed_at(config), tmp_path / "sessions")
        desk = Desk(pointed, SPEED, bench)

        async def record() -> None:
            desk.session.begin(SETUP)
            await desk.runner.arm()
            live = desk.runner.live
            assert live is not None

            def has_ended() -> bool:
                if live.latest["state"] == "recording" and live.force:
                    seen.append((live.cue.step, live.force[-1][1]))
                return desk.runner.live is None

            await until(has_ended)
            await desk.reviewer.look_after()

        run(record())
        desk.close()
    assert desk.session.message == "the mocap capture ended"
    assert sorted({step for step, _ in seen}) == list(range(8)), "every step, and then the end"
    hook, weight = seen[0][1], 2 * g
    for step, newtons in seen:
        asked = hook + weight * min(step, max(6 - step, 0))
        assert newtons < asked + 0.4 * weight or step > 3, "no weight hangs before it was asked for"
        assert newtons > asked - 0.4 * weight or step <= 3, "none is taken off before it was asked for"
    judgement = desk.session.judgement
    assert judgement is not None and judgement.grade == "good", judgement


def test_a_trial_a_second_start_an_alarm_and_a_new_desk_that_goes_on(
    running: tuple[SimulatedBench, StationConfig], tmp_path: Path
) -> None:
    bench, config = running
    safety = config.safety.model_copy(update={"force_ceiling_n": 30.0})
    config = with_folder(config, tmp_path).model_copy(update={"safety": safety})
    first, second = (Desk(config, SPEED, bench) for _ in range(2))

    async def record() -> None:
        first.session.begin(SETUP)
        await first.runner.arm()
        with pytest.raises(CommandRefused, match="a trial is running; stop it or wait for its end"):
            await first.runner.arm()
        live = first.runner.live
        assert live is not None
        await until(lambda: live.alarm is not None)
        assert live.alarm is not None and live.alarm.startswith("STOP: ")
        first.runner.silence()
        await until(lambda: live.latest["state"] == "recording" and live.latest["recorded_s"] > 4)
        await first.runner.stop()
        await until(lambda: first.runner.live is None)

    run(record())
    first.close()
    assert first.session.message == "stopped by the operator"
    folder = tmp_path / "sub-P01_ses-1"
    (recorded,) = read_journal(folder).recorded
    assert TrialSpec("hand", "static", 1).test == recorded.test and recorded.accepted
    marks = [item for item in open_recording(folder / recorded.file).items() if isinstance(item, Event)]
    assert [event.text for event in marks if event.kind == "mark"][:1] == ["mark 1"]
    assert read_journal(folder).marks[recorded.file][1].startswith("STOP: ")

    async def go_on() -> None:
        second.session.begin(SETUP)
        await second.reviewer.look_after()

    run(go_on())
    second.close()
    plan = second.session.agenda
    assert plan is not None and plan.undecided == recorded
    assert second.session.judgement is not None and second.session.judgement.file == recorded.file
    assert second.session.judgement.marks == len([event for event in marks if event.kind == "mark"])
