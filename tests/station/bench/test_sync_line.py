"""Faults of the sync line on a simulated bench: found by the recorder or by the certificate of the fit."""

import json
import re
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from documents.message import Message
from drivers.simulators.faults import FAULTS, Fault, Faults, fault_from_dict
from drivers.simulators.settings import settings_from_dict
from drivers.simulators.simulated_bench import Bench
from fitting.errors import UnusableTrial
from fitting.trial.decimation import decimate
from fitting.trial.timeline import certify
from recordings.reader import open_recording
from recordings.samples import Event, Loss, Samples
from station.bench.bench_clock import BenchClock
from station.bench.sync_line import Edge, FallingEdges, PreRoll, SyncLine
from station.bench.trial_recorder import TrialRecorder, TrialResult
from station.bench.view import Snapshot, TrialState
from station.messages.bench_messages import TrialCode
from station.protocol import TrialSpec
from tests.station.fake_devices import view
from tests.station.session.benched import config_at

ARMED_FOR_S = 2.0
"""Station seconds after which a fault that concerns an armed station happens."""


@dataclass(frozen=True)
class Case:
    """One fault of the sync line, and what must be seen of it.

    event     of the station, while it happens; "" where nothing can be known before the trial is over
    accepted  whether the daemon accepts the trial
    words     of the trial's result, of the certificate's findings, or of the reason why there is none
    """

    fault: str
    when: dict[str, Any]
    event: str
    accepted: bool
    words: str
    while_armed: bool = False


CASES = (
    Case("glitch", {"at_s": 0.3}, "sync_glitch", True, r"start and stop edge: offset", while_armed=True),
    Case("glitch", {"at_s": 2.0}, "sync_glitch", True, r"glitch: the sync line is low during the capture 1 time"),
    Case("early_edge", {"for_s": 0.4}, "", True, r"early edge: the sync line rose 0\.40 s before the first frame"),
    Case("double_edge", {"at_s": 0.5}, "sync_double_edge", False, r"the sync line rises 2 times"),
    Case("no_stop_edge", {}, "no_stop_edge", True, r"start edge alone.*has not fallen when the recording ends"),
    Case("wrong_polarity", {"capture": 0}, "", False, r"the sync line fell from 5\.\d\d V .* active high"),
)


def meddler(fault: Fault, faults: Faults) -> SimpleNamespace:
    """A view that lets a fault happen once the station has been armed for a while."""
    left = [fault]

    def show(snapshot: Snapshot) -> None:
        if left and snapshot.state is TrialState.ARMED and snapshot.waited_s > ARMED_FOR_S:
            faults.inject(left.pop())

    return view(show)


def suffer(case: Case, folder: Path) -> tuple[TrialResult, set[str], str]:
    """Result, kinds of events and words of one short capture in which the fault happens."""
    plan = fault_from_dict({"device": "sync", "fault": case.fault, **case.when})
    with Bench(settings_from_dict(SETTINGS), None, seed=3, fault_plan=() if case.while_armed else [plan]) as bench:
        views = [meddler(plan, bench.world.faults)] if case.while_armed else []
        with BenchClock(bench.ports["clock"]) as clock:
            config = config_at(bench.ports, sync={"stop_edge": "end_of_frame"})
            result = TrialRecorder(config, clock, views).record(folder, TrialSpec("waist", "static", 1))
    if result.path is None:
        return result, set(), result.sentence
    recording = open_recording(result.path)
    kinds = {item.kind for item in recording.items() if isinstance(item, Event)}
    try:
        tracks = {stream.name: recording.load(stream.name) for stream in recording.streams}
        certificate = certify(recording.manifest, decimate(recording.manifest, tracks))
    except UnusableTrial as error:
        return result, kinds, str(error)
    return result, kinds, "; ".join(map(str, (certificate.summary, *certificate.findings)))


SETTINGS = {
    "ports": {"serial": None},
    "operator": {"delay_s": 2 * ARMED_FOR_S},
    "protocol": {"static": {"lead_in_s": 1.0, "hold_s": 2.0, "step_masses_kg": [3.0]}},
    "mocap": {"occlusions_per_minute": 0},
}


MILLISECOND = 1_000_000  # ns between two samples
THRESHOLD = 2.5
FELL = Edge(False, 7, 7 * MILLISECOND, 4.9, 0.1)


def block(volts: list[float], first: int = 0) -> Samples:
    """Samples of 1 kHz from the number `first` on."""
    numbers = np.arange(first, first + len(volts), dtype=np.uint64)
    return Samples("/sync", numbers, numbers.astype(np.int64) * MILLISECOND, 0, np.array(volts)[:, None])


def rise(number: int, from_v: float = 0.0, to_v: float = 5.0, *, is_glitch: bool = False) -> Edge:
    return Edge(True, number, number * MILLISECOND, from_v, to_v, is_glitch)


def fall(number: int, *, is_glitch: bool = False) -> Edge:
    return Edge(False, number, number * MILLISECOND, 5.0, 0.0, is_glitch)


@pytest.mark.parametrize(
    ("volts", "edges", "has_settled"),
    [
        ([0.0, 2.4, THRESHOLD, *[5.0] * 5], [rise(2, 2.4, THRESHOLD)], True),
        ([0.0, *[5.0] * 5], [], False),
        ([0.0, *[5.0] * 6], [rise(1)], True),
        ([0.0, *[5.0] * 4, *[0.0] * 9], [rise(1, is_glitch=True)], True),
        ([0.0, *[5.0] * 5, *[0.0] * 6], [rise(1), fall(6)], True),
        ([*[5.0] * 9, 0.0, *[5.0] * 9], [fall(9, is_glitch=True)], True),
        ([5.0, *[0.0] * 6], [fall(1)], True),
        ([THRESHOLD, 5.0, THRESHOLD], [], True),
    ],
    ids=["rise", "5 ms less a sample", "5 ms", "glitch", "pulse", "dip", "starts high", "at the threshold"],
)
def test_a_level_counts_from_5_ms_on_whatever_the_blocks(
    volts: list[float], edges: list[Edge], has_settled: bool
) -> None:
    for size in (1, 3, len(volts)):
        line = SyncLine(THRESHOLD)
        starts = range(0, len(volts), size)
        assert [edge for i in starts for edge in line.update(block(volts[i : i + size], i))] == edges
        assert line.has_settled is has_settled
        assert line.level_v == volts[-1] and line.is_high is (volts[-1] >= THRESHOLD)


@pytest.mark.parametrize("lost", [np.nan, np.inf])
@pytest.mark.parametrize("size", [1, 3, 30])
def test_a_sample_that_is_no_number_keeps_the_level_of_the_sample_before(lost: float, size: int) -> None:
    """At both levels for longer than a glitch, and at the edge, which is at the first number."""
    volts = [lost, 0.0, *[lost] * 8, 0.0, lost, *[5.0] * 2, *[lost] * 8, 5.0]
    line = SyncLine(THRESHOLD)
    assert [edge for i in range(0, 22, size) for edge in line.update(block(volts[i : i + size], i))] == [rise(12)]
    assert line.level_v == 5.0


def test_an_empty_block_changes_nothing() -> None:
    line = SyncLine(THRESHOLD)
    assert line.update(block([])) == [] and line.level_v is None and not line.is_high
    line.update(block([0.0, 5.0]))
    assert line.update(block([])) == [] and line.is_high and not line.has_settled


def test_edges_at_a_low_sample_rate_are_not_glitches() -> None:
    samples = block([0.0, 5.0, 0.0])
    slow = Samples("/sync", samples.sample_numbers, samples.device_time_ns * 50, 0, samples.values)
    line = SyncLine(THRESHOLD)
    assert [(edge.rising, edge.is_glitch) for edge in line.update(slow)] == [(True, False)]
    assert not line.has_settled


@pytest.mark.parametrize(
    ("volts", "fell", "message"),
    [
        ([0.2], FELL, Message(TrialCode.NO_SYNC_EDGE_FELL, {"timeout_s": 30.0, "from_v": 4.9, "to_v": 0.1})),
        ([], None, Message(TrialCode.NO_SYNC_EDGE_NO_SAMPLES, {"timeout_s": 30.0})),
        ([4.8], None, Message(TrialCode.NO_SYNC_EDGE_HIGH, {"timeout_s": 30.0, "level_v": 4.8, "threshold_v": 2.5})),
        ([0.2], None, Message(TrialCode.NO_SYNC_EDGE_LOW, {"timeout_s": 30.0, "level_v": 0.2, "threshold_v": 2.5})),
    ],
    ids=["fell", "no samples", "high", "low"],
)
def test_a_missing_edge_is_reported_with_what_the_line_did(
    volts: list[float], fell: Edge | None, message: Message[TrialCode]
) -> None:
    line = SyncLine(THRESHOLD)
    line.update(block(volts))
    assert line.missing_edge(30.0, fell) == message
    assert str(message)


@pytest.mark.parametrize(
    ("started_s", "stopped_s", "fell_s", "is_unexplained"),
    [
        (None, None, 10.0, True),
        (None, 9.1, 10.0, False),
        (None, 10.9, 10.0, False),
        (None, 9.0, 10.0, True),
        (None, 11.0, 10.0, True),
        (10.0, None, 10.0, True),
    ],
    ids=["no event", "stop before", "stop after", "stop long before", "stop long after", "start"],
)
def test_the_end_of_a_capture_explains_a_falling_edge_within_a_second(
    started_s: float | None, stopped_s: float | None, fell_s: float, is_unexplained: bool
) -> None:
    edges = FallingEdges()
    assert edges.unexplained is None
    for kind, at_s in (("capture_started", started_s), ("capture_stopped", stopped_s), ("mark", fell_s)):
        if at_s is not None:
            edges.handle_event(kind, at_s)
    edges.add(FELL, fell_s)
    assert edges.unexplained == (FELL if is_unexplained else None)


@pytest.mark.parametrize(("started_s", "fell_s"), [(10.0, 10.5), (10.5, 10.0)])
def test_a_falling_edge_at_the_start_of_a_capture_is_one_once_neither_can_arrive_late(
    started_s: float, fell_s: float
) -> None:
    edges = FallingEdges()
    edges.add(FELL, fell_s)
    assert edges.inverted_start(100.0) is None
    edges.handle_event("capture_started", started_s)
    assert edges.inverted_start(11.5) is None and edges.inverted_start(11.51) == FELL
    edges.handle_event("capture_started", fell_s + 1.0)
    assert edges.inverted_start(100.0) is None


SECOND = 1_000_000_000  # ns


def arrived(stream: str, first_s: float, last_s: float, host_s: float) -> Samples:
    """Samples every tenth of a second."""
    numbers = np.arange(round(10 * first_s), round(10 * last_s) + 1, dtype=np.uint64)
    times = numbers.astype(np.int64) * (SECOND // 10)
    return Samples(stream, numbers, times, round(host_s * SECOND), numbers.astype(float)[:, None])


def lost(stream: str, last_s: float) -> Loss:
    return Loss(stream, "skipped", 1, 1, round(last_s * SECOND), 0)


def test_items_of_the_last_three_seconds_are_kept() -> None:
    pre_roll = PreRoll()
    items = [arrived("/emg", host_s, host_s, host_s) for host_s in (1.9, 2.0, 5.0)]
    for item in items:
        pre_roll.append(item)
    assert pre_roll.take_from(0) == items[1:] and pre_roll.take_from(0) == []


def test_daq_blocks_that_end_two_seconds_before_the_edge_are_left_out_and_other_items_are_not() -> None:
    early, last, frames = (arrived("/force", 0, 2.9, 5), arrived("/force", 0, 3.0, 5), arrived("/markers", 0, 1, 5))
    one_sample = arrived("/force", 2.9, 2.9, 5)
    kept = [last, frames, lost("/force", 1.0), arrived("/force", 1.0, 0.9, 5), Event("mark", "", 0, "")]
    pre_roll = PreRoll()
    for item in (early, one_sample, *kept):
        pre_roll.append(item)
    assert pre_roll.take_from(5 * SECOND) == kept


def test_what_the_daq_measured_before_the_line_fell_is_dropped() -> None:
    pre_roll = PreRoll()
    before, after = arrived("/sync", 1.0, 2.9, 5), arrived("/sync", 3.0, 4.0, 5)
    others = [arrived("/markers", 1.0, 2.0, 5), Event("mark", "", 0, "")]
    for item in (before, arrived("/force", 2.0, 4.0, 5), after, *others, lost("/force", 2.9), lost("/force", 3.0)):
        pre_roll.append(item)
    pre_roll.drop_before(3 * SECOND)
    cut, whole, *rest = pre_roll.take_from(0)
    for item in (cut, whole):  # the sync block is whole, the force from 3 s on
        assert isinstance(item, Samples)
        assert item.sample_numbers.tolist() == item.values[:, 0].tolist() == list(range(30, 41))
        assert (item.device_time_ns * 10 // SECOND).tolist() == list(range(30, 41))
    assert rest == [*others, lost("/force", 3.0)]


def test_frames_of_an_earlier_capture_are_dropped_with_their_losses() -> None:
    pre_roll = PreRoll()
    kept = [arrived("/force", 1.0, 2.0, 5), lost("/force", 2.0), Event("mark", "", 0, "")]
    for item in (arrived("/markers", 1.0, 2.0, 5), *kept, lost("/markers", 2.0)):
        pre_roll.append(item)
    pre_roll.drop_frames()
    assert pre_roll.take_from(0) == kept


# Every fault of the sync line, through the real wires: its message, and the outcome of the trial.


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.fault + case.while_armed * " while armed")
def test_a_fault_of_the_sync_line_is_reported_by_recorder_or_certificate(case: Case, tmp_path: Path) -> None:
    result, kinds, words = suffer(case, tmp_path)
    assert result.accepted is case.accepted, result.sentence
    assert re.search(case.words, words), words
    assert kinds & {"sync_glitch", "sync_double_edge", "no_stop_edge"} == ({case.event} if case.event else set())
    assert (result.path is None) is (case.fault == "wrong_polarity"), "nothing of an inverted line is kept"


def test_every_fault_of_the_sync_line_has_a_test_case() -> None:
    assert {case.fault for case in CASES} == set(FAULTS["sync"])


# A sync line that falls within the last frame, through the real wires: the certificate covers the true clock ratio.


def _record(folder: Path, before_frame_end_s: float, ppm: float, sync: dict[str, Any], hold_s: float = 12.0) -> Path:
    """One trial of three holds, which the wire's own devices time."""
    settings = {
        **{key: SETTINGS[key] for key in ("ports", "mocap")},
        "sync": {"before_frame_end_s": before_frame_end_s},
        "daq_clock": {"offset_ppm": ppm, "drift_ppm_per_hour": 0},
        "protocol": {"static": {"lead_in_s": 1.0, "hold_s": hold_s, "step_masses_kg": [3.0]}},
    }
    with Bench(settings_from_dict(settings), None, seed=3) as bench, BenchClock(bench.ports["clock"]) as clock:
        result = TrialRecorder(config_at(bench.ports, sync=sync), clock, []).record(
            folder, TrialSpec("waist", "static", 1)
        )
    assert result.accepted
    assert result.path is not None
    return result.path


@pytest.mark.parametrize(
    ("before_frame_end_s", "ppm", "sync", "is_identified"),
    [
        (0.003, 0, {}, True),
        pytest.param(0.0, 50, {}, True, marks=pytest.mark.slow),
        (0.0096, -300, {}, False),
        (0.0096, 50, {"stop_edge": "end_of_exposure", "exposure_s": 0.0004}, True),
        pytest.param(0.0, -300, {"stop_edge": "end_of_frame"}, True, marks=pytest.mark.slow),
    ],
)
def test_the_interval_of_info_contains_the_clock_ratio(
    station, tmp_path: Path, before_frame_end_s: float, ppm: float, sync: dict[str, Any], is_identified: bool
) -> None:
    ran = station("info", _record(tmp_path, before_frame_end_s, ppm, sync), "--format", "json")
    assert ran.code == 0
    found = json.loads(ran.out)["sync"]
    low, high = found["clock_ratio_ci95_ppm"]
    assert low <= ppm <= high
    assert high - low < (60 if sync else 600)
    assert found["clock_ratio_is_identified"] == is_identified
    assert found["time_standard_error_s"] > (2e-4 if sync else 1.5e-3)


def test_the_clock_ratio_of_a_short_capture_is_not_identified(station, tmp_path: Path) -> None:
    ran = station("info", _record(tmp_path, 0.003, 20, {}, hold_s=2.0))
    assert "clock ratio not identified, between " in ran.out
    assert "the capture is too short" in ran.out
