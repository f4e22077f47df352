"""The same frames give the same values to the bit: live through the pipe, and in a replay from the file."""

from pathlib import Path

import numpy as np
import pytest

from fitting.wearer.wearer_trial import read_wearer_trial
from recordings.reader import open_recording
from recordings.samples import Event, Samples
from station.live.engine import LiveEngine, LiveRefused, prepare_replay, replay_live
from station.live.pipeline import PreparedTrial
from station.live.process import FedMessages, run
from station.live.published import NAN, UPDATE, LiveDelivery, LiveUpdate
from station.live.tap import encode_message, encode_request
from station.messages.live_messages import LiveCode
from station.subject.assessed_subject import read_wearer_trials
from tests.refusals import raises_refusal
from tests.station.live.trials import TIGHT, Collected, engine_of, generic_plan, part_of, without_glenoid
from tests.station.wearer import SPECS, WearerSession

FRAMES = 120
GOLDEN = Path(__file__).parents[2] / "recordings" / "golden"
SAME_DELIVERY = LiveDelivery(0.0, NAN, NAN, 0, 0, 1, NAN)


@pytest.fixture(scope="module")
def plan(wearer: WearerSession, tmp_path_factory: pytest.TempPathFactory) -> PreparedTrial:
    return generic_plan(wearer.config, tmp_path_factory.mktemp("generic"))


@pytest.fixture(scope="module")
def replayed(wearer: WearerSession, plan: PreparedTrial) -> Collected:
    kept = Collected()
    replay_live(part_of(wearer, FRAMES), plan, sinks=[kept])  # type: ignore[arg-type]
    return kept


def bits(kept: Collected) -> list[bytes]:
    return [UPDATE.dump_json(LiveUpdate(values, SAME_DELIVERY)) for values in kept.values]


def test_live_and_replay_give_equal_values(wearer: WearerSession, plan: PreparedTrial, replayed: Collected) -> None:
    """The live side passes through the pipe of the recorder; the sync edge restarts both."""
    part = part_of(wearer, FRAMES)
    messages = [encode_message(stream, 0, 0.0) for stream in part.streams]
    for item in part.items():
        if isinstance(item, Event) and item.kind == "sync_edge":
            messages.append(encode_request({"begins": True, "recording": str(part.path)}))
        elif isinstance(item, Samples):
            messages.append(encode_message(item, item.host_time_ns, 0.0))
    live, inbox = Collected(), FedMessages()
    assert inbox.open() == 0
    inbox.fill(messages)
    run(LiveEngine(plan, sinks=[live], now_s=lambda: 0.0), inbox)
    assert len(live.values) == len(replayed.values) > 0.8 * FRAMES
    assert bits(live) == bits(replayed)


def test_a_rest_length_acts_from_the_next_frame(
    wearer: WearerSession, plan: PreparedTrial, replayed: Collected
) -> None:
    """A cord of stiffness k that is 10 mm shorter pulls k × 10 mm more (solver/suit/suit.toml: 1000 N/m)."""
    kept = Collected()
    rest = plan.scenarios[1].rest_length_m
    asked: list[int] = []

    def shorten(engine: LiveEngine) -> None:
        if not asked and engine.solved == 60:
            asked.append(engine.solved)
            engine.set_rest_length("rigid", rest - 0.01)

    replay_live(part_of(wearer, FRAMES), plan, sinks=[kept], commands=shorten)  # type: ignore[arg-type]
    stiffness = plan.plan.body.suit.stiffness
    more = [
        other.scenarios[1].cord_force_n - one.scenarios[1].cord_force_n
        for one, other in zip(replayed.values, kept.values, strict=True)
    ]
    np.testing.assert_allclose(more[:60], 0.0)
    np.testing.assert_allclose(more[62:], 0.01 * stiffness, rtol=1e-6)
    assert kept.notes == [("rest_length", f"rigid: {rest - 0.01:.4f} m")]


def test_a_rest_length_and_the_notices_last_over_the_sync_edge(wearer: WearerSession, plan: PreparedTrial) -> None:
    """What a view has set while the trial was armed holds in the recording, and the file says so."""
    without = without_glenoid(plan)
    part = part_of(wearer, 60)
    engine, kept = engine_of(without, part.streams)
    engine.set_rest_length("rigid", 0.7)
    blocks = part.blocks()
    for block in blocks[: len(blocks) // 2]:
        engine.take(block, 0.0)
    engine.begin_recording(part.path)
    before = len(kept.updates)
    for block in blocks[len(blocks) // 2 :]:
        engine.take(block, 0.0)
    engine.finish()
    assert kept.notes == [("rest_length", "rigid: 0.7000 m")] * 2
    assert kept.updates[-1].scenarios[1].rest_length_m == engine.pipeline.rest_lengths["rigid"] == 0.7
    after = {finding.code for update in kept.updates[before:] for finding in update.findings}
    assert LiveCode.NO_GLENOID in after


def test_wrong_commands_of_a_view_change_nothing(plan: PreparedTrial) -> None:
    engine = LiveEngine(plan, now_s=lambda: 0.0)
    for scenario, length in (("slack", 0.7), ("unknown", 0.7), ("rigid", -1.0), ("rigid", float("nan"))):
        engine.set_rest_length(scenario, length)
    assert engine.pipeline.rest_lengths == {name: one.rest_length for name, one in plan.plan.scenarios.items()}


def test_the_measured_cord_force_is_that_of_the_offline_reader(wearer: WearerSession, replayed: Collected) -> None:
    """The offline reader finds the clocks by the sync edges; live it is the arrival, good to some milliseconds."""
    trial = read_wearer_trial(wearer.path(TIGHT))
    measured = np.array([values.cord_force_measured_n for values in replayed.values])
    offline = np.interp(trial.time, trial.force_time, trial.force)
    known = np.isfinite(measured)
    assert known.mean() > 0.8
    assert abs(np.median(measured[known]) - np.median(offline[: len(measured)])) < 0.5


def test_frames_that_come_while_the_body_is_prepared_are_counted(wearer: WearerSession) -> None:
    inbox = FedMessages()
    blocks = part_of(wearer, 7).blocks()
    inbox.fill(encode_message(block, block.host_time_ns, 0.0) for block in blocks)
    assert inbox.open() == 7
    assert inbox.get() is None


def test_the_body_is_that_of_the_trials_before_and_one_without_markers_is_refused(wearer: WearerSession) -> None:
    with raises_refusal(LiveCode.NO_BODY, kind=LiveRefused):
        prepare_replay(GOLDEN / "format_1.mcap")
    # A later trial must not change what a replay gives.
    before = open_recording(wearer.path(TIGHT)).manifest.start_utc_ns
    assert [trial.manifest.test for trial in read_wearer_trials(wearer.folder, before)] == ["pose", "motion"]
    assert len(read_wearer_trials(wearer.folder)) == len(SPECS)
