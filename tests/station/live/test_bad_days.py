"""What goes wrong on a bad day has a code that the views show, and never ends the stream."""

import errno
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from recordings.samples import Samples
from recordings.topics import MARKERS
from solver.stream.stream_frame import StreamOutcome, StreamSuitOutcome
from station.live.body import live_body
from station.live.engine import DROP_LATENCY_S
from station.live.pipeline import CycleEffort, PreparedTrial
from station.messages.live_messages import LiveCode
from station.subject.subject_file import SUBJECT_FILE
from tests.station.live.trials import engine_of, generic_plan, outcomes, part_of, solve, without_glenoid
from tests.station.wearer import WearerSession

FRAMES = 100
Values = NDArray[np.float32]
LENGTHS = {"0.66 m": 0.66, "0.69 m": 0.69, "worn": 0.72, "0.75 m": 0.75}
PERIOD_S, RATE_HZ = 4.0, 50.0


@pytest.fixture(scope="module")
def plan(wearer: WearerSession, tmp_path_factory: pytest.TempPathFactory) -> PreparedTrial:
    return generic_plan(wearer.config, tmp_path_factory.mktemp("generic"))


def test_exchanged_labels_are_named_and_a_good_day_has_no_codes(wearer: WearerSession, plan: PreparedTrial) -> None:
    labels = next(stream.labels for stream in part_of(wearer, 1).streams if stream.name == MARKERS)
    one, other = labels.index("EpL"), labels.index("ac")

    def exchange(frame: int, values: Values) -> Values:
        if 40 <= frame < 50:
            values[[one, other]] = values[[other, one]]
        return values

    _, kept = solve(plan, part_of(wearer, FRAMES, exchange))
    exchanged = {pair for values in kept.values for pair in map(frozenset, values.exchanged)}
    assert exchanged == {frozenset({"EpL", "ac"})}
    assert LiveCode.MARKERS_EXCHANGED in kept.codes
    plain = solve(plan, part_of(wearer, FRAMES))[1]
    assert LiveCode.MARKERS_EXCHANGED not in plain.codes
    assert LiveCode.GENERIC_BODY in plain.codes and plain.setup is not None, "the session has no body of its own"
    assert not plain.setup.subject.is_scaled and plain.setup.subject.name == "thoracoscapular"
    assert LiveCode.NO_GLENOID not in plain.codes


def test_values_resume_after_a_wearer_has_left_the_volume(wearer: WearerSession, plan: PreparedTrial) -> None:
    def leave(frame: int, values: Values) -> Values:
        return np.full_like(values, np.nan) if 20 <= frame < 100 else values

    _, kept = solve(plan, part_of(wearer, 160, leave))
    assert len(kept.values) == 160
    assert set(outcomes(kept.values[40:80])) == {StreamOutcome.NO_MARKERS}
    assert all(np.isnan(scenario.effort) for values in kept.values[40:80] for scenario in values.scenarios)
    left = [LiveCode.WEARER_LEFT in {found.code for found in update.findings} for update in kept.updates]
    first, last = left.index(True), len(left) - 1 - left[::-1].index(True)
    assert 68 <= first <= 74 and 98 <= last <= 101  # half a second after frame 20, until the markers are back
    assert set(outcomes(kept.values[140:])) == {StreamOutcome.SOLVED}
    assert all(np.isfinite(values.scenarios[0].effort) for values in kept.values[140:])


def test_cameras_at_300_hz_are_decimated_to_100(wearer: WearerSession, plan: PreparedTrial) -> None:
    part = replace(part_of(wearer, 90), rate_hz=300.0)
    engine, kept = solve(plan, part)
    assert engine.pipeline.every == 3
    assert [values.frame for values in kept.values] == [
        int(block.sample_numbers[0]) for block in part.blocks() if _is_frame(block) and block.sample_numbers[0] % 3 == 0
    ]
    assert LiveCode.DECIMATED in kept.codes
    assert all(update.delivery.every == 3 for update in kept.updates)


def test_a_slow_computer_leaves_out_frames_and_counts_them(wearer: WearerSession, plan: PreparedTrial) -> None:
    """Solving muscles takes 60 ms and a posture 1 ms of a clock by hand; every frame is late for the next one."""
    now = [0.0]
    part = part_of(wearer, 150)
    engine, kept = engine_of(plan, part.streams, now_s=lambda: now[0])
    blocks = [block for block in part.blocks() if _is_frame(block)]
    for number, block in enumerate(blocks):
        arrival = 0.01 * number
        now[0] = max(now[0], arrival)
        before = sum(one.outcome == "not_solved" for values in kept.values for one in values.scenarios)
        count = len(kept.values)
        engine.take(block, arrival, is_newest=now[0] < arrival + 0.01)
        skipped = sum(one.outcome == "not_solved" for values in kept.values for one in values.scenarios) - before
        now[0] += 0.001 + 0.06 * (len(kept.values) > count and skipped == 0)
    engine.finish()
    assert engine.solved + engine.dropped == len(blocks)
    assert engine.pace.every > 1 and LiveCode.OVERLOADED in kept.codes
    assert kept.updates[-1].delivery.latency_s < DROP_LATENCY_S  # it has caught up


def test_a_model_without_glenoid_is_solved_without_its_constraint(wearer: WearerSession, plan: PreparedTrial) -> None:
    _, kept = solve(without_glenoid(plan), part_of(wearer, 40))
    assert LiveCode.NO_GLENOID in kept.codes and kept.setup is not None and not kept.setup.has_glenoid
    assert {one.outcome for values in kept.values for one in values.scenarios} == {StreamSuitOutcome.SOLVED}


def test_markers_of_another_set_are_refused_with_their_names(wearer: WearerSession, plan: PreparedTrial) -> None:
    part = part_of(wearer, 5)
    other = {stream.name: tuple(f"M{k}" for k in range(len(stream.labels))) for stream in part.streams}
    streams = (replace(one, labels=other[MARKERS]) if one.name == MARKERS else one for one in part.streams)
    engine, kept = engine_of(plan, streams)
    engine.take(next(block for block in part.blocks() if _is_frame(block)), 0.0)
    assert LiveCode.UNKNOWN_MARKERS in kept.codes and engine.solved == 0


def test_the_generic_body_is_named_where_the_session_has_none(plan: PreparedTrial, wearer: WearerSession) -> None:
    _, kept = solve(plan, part_of(wearer, 20))
    assert LiveCode.GENERIC_BODY in kept.codes and kept.setup is not None
    (finding,) = (one for one in plan.plan.body.findings if one.code is LiveCode.GENERIC_BODY)
    assert finding.figures["reason_code"] == LiveCode.NO_SUBJECT
    assert not kept.setup.subject.is_scaled and kept.setup.subject.name == "thoracoscapular"


def test_a_file_that_keeps_the_body_of_the_wearer_from_being_read_is_named(
    wearer: WearerSession, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "pose.mcap"

    def fail(*_: object) -> None:
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))

    (tmp_path / SUBJECT_FILE).write_text("mass_kg = 80.0\n")
    monkeypatch.setattr("station.live.body.read_wearer_trials", fail)
    (finding,) = live_body(tmp_path, wearer.config.live, 0).findings
    assert str(path) in finding.figures["reason"]


def _is_frame(block: Samples) -> bool:
    return block.stream == MARKERS


# Effort per cycle and the best rest length, on curves whose answers are known.


def run(best_of_cycle: list[float], *, with_gap: bool = False) -> CycleEffort:
    """Raises of the arm by 90 deg; effort is 1 for the slack suit, and 0.8 + 40 (L − best)² for a length L."""
    effort = CycleEffort(["slack", *LENGTHS])
    for k in range(round((len(best_of_cycle) + 1) * PERIOD_S * RATE_HZ)):
        time = k / RATE_HZ
        cycle = min(len(best_of_cycle) - 1, max(0, int((time - PERIOD_S / 2) // PERIOD_S)))
        efforts = {name: 0.8 + 40 * (length - best_of_cycle[cycle]) ** 2 for name, length in LENGTHS.items()}
        solved = {} if with_gap and k % 3 else {"slack": 1.0, **efforts}
        effort.add(time, np.pi / 4 * (1 - np.cos(2 * np.pi * time / PERIOD_S)), solved)
    return effort


def test_effort_and_best_rest_length_are_those_of_the_cycles() -> None:
    best = run([0.70, 0.71, 0.72]).best(LENGTHS)
    assert best is not None and best.cycles == 3 and best.edge == 0
    assert best.rest_length_m == pytest.approx(0.71, abs=1e-6)
    assert best.sd_m == pytest.approx(np.std([0.70, 0.71, 0.72], ddof=1), abs=1e-6)
    assert best.effort == pytest.approx(0.8 + 40 * np.mean([0.01**2, 0.0, 0.01**2]), abs=1e-6)
    for length, bound in ((0.80, (1, 0.75)), (0.60, (-1, 0.66))):
        best = run([length, length]).best(LENGTHS)
        assert best is not None and (best.edge, best.rest_length_m) == bound, length
    recent = run([0.80, 0.72, 0.72, 0.72]).recent()
    assert recent is not None and recent.cycles == 3
    assert recent.effort["worn"] == pytest.approx(0.8) and recent.effort["slack"] == pytest.approx(1.0)
    effort = run([0.70, 0.70], with_gap=True)
    assert effort.cycles == [] and effort.recent() is None and effort.best(LENGTHS) is None
    assert run([0.70]).best({"worn": 0.72, "0.75 m": 0.75}) is None, "nor have two lengths a best one"
