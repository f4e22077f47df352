"""Faults of a recorded sync line are named, and the capture's edges are still found where they can be."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from fitting.errors import UnusableTrial
from fitting.results.codes import RejectionCode, TrialNoteCode
from fitting.results.rendering import Note
from fitting.trial.clocks import SyncEdges
from fitting.trial.sync_line import find_edges, find_fall
from tests.refusals import raises_refusal

Line = tuple[NDArray[np.float64], NDArray[np.float64], float]
CAPTURE = (2500, 6000)
STEP_SD = 1e-3 / np.sqrt(12)  # of a time known to lie between two samples of 1 kHz


def line(*pulses: tuple[int, int], low: tuple[tuple[int, int], ...] = (), start: int = 0, end: int = 8000) -> Line:
    """Time, level and threshold of a line sampled every millisecond from start to end: high in the pulses [ms].

    A difference from time 0 is exact, as the limits of a glitch and a bounce are.
    """
    number = np.arange(start, end)
    is_high = np.zeros(len(number), bool)
    for stretches, level in ((pulses, True), (low, False)):
        for first, after in stretches:
            is_high[(number >= first) & (number < after)] = level
    return number / 1000, np.where(is_high, 2.5, 0.1), 2.5


@pytest.mark.parametrize(
    ("recorded", "notes"),
    [
        (line(CAPTURE), []),
        (line(CAPTURE, (1000, 1002)), [(TrialNoteCode.SYNC_SPIKES, 1, "1.000 s")]),
        (line(CAPTURE, (1000, 1002), (7000, 7001)), [(TrialNoteCode.SYNC_SPIKES, 2, "1.000 s, 7.000 s")]),
        (
            line(CAPTURE, low=((3000, 3003), (4000, 4001), (5000, 5001))),
            [(TrialNoteCode.SYNC_DIPS, 3, "3.000 s, 4.000 s, 5.000 s")],
        ),
        (
            line(CAPTURE, low=((3000, 3003), (4000, 4001), (5000, 5001), (5500, 5519))),
            [(TrialNoteCode.SYNC_DIPS, 4, "3.000 s, 4.000 s, 5.000 s, …")],
        ),
        (
            line(CAPTURE, low=((2502, 2505), (2507, 2508))),
            [(TrialNoteCode.SYNC_BOUNCES, 2, "2.502 s, 2.507 s")],
        ),
        (line(CAPTURE, (6003, 6005), (6007, 6010)), [(TrialNoteCode.SYNC_BOUNCES, 2, "6.000 s, 6.005 s")]),
        (
            line(CAPTURE, (1000, 1002), low=((2502, 2505), (4000, 4001))),
            [
                (TrialNoteCode.SYNC_BOUNCES, 1, "2.502 s"),
                (TrialNoteCode.SYNC_DIPS, 1, "4.000 s"),
                (TrialNoteCode.SYNC_SPIKES, 1, "1.000 s"),
            ],
        ),
    ],
    ids=["clean", "spike", "two spikes", "three dips", "four dips", "bouncing start", "bouncing stop", "all"],
)
def test_glitches_and_bounces_are_named_and_leave_the_edges_where_they_are(
    recorded: Line, notes: list[tuple[TrialNoteCode, int, str]]
) -> None:
    edges = find_edges(*recorded)
    times = edges.rising, edges.rising_sd, edges.falling, edges.falling_sd
    assert times == pytest.approx((2.4995, STEP_SD, 5.9995, STEP_SD))
    assert edges.findings == tuple(Note(code, {"count": count, "at": at}) for code, count, at in notes)


def test_crossings_20_ms_apart_are_two_edges_and_not_a_bounce() -> None:
    with raises_refusal(RejectionCode.SYNC_RISES_AGAIN, count=2):
        find_edges(*line((0, 20), (2500, 6000), start=-2000))
    with raises_refusal(RejectionCode.SYNC_RISES_AGAIN, count=2):
        find_edges(*line((-2000, 0), (20, 6000), start=-4000))
    edges = find_edges(*line((0, 6000), low=((20, 23),), start=-2000))
    assert [note.code for note in edges.findings] == [TrialNoteCode.SYNC_BOUNCES]
    edges = find_edges(*line((-2000, 0), low=((-20, -10),), start=-4000, end=1000))
    assert [note.code for note in edges.findings] == [TrialNoteCode.SYNC_BOUNCES]
    assert edges.falling == pytest.approx(-0.0205)
    edges = find_edges(*line((0, 6000), (7000, 7010), low=((19, 21),), start=-2000))
    assert [note.code for note in edges.findings] == [TrialNoteCode.SYNC_BOUNCES, TrialNoteCode.SYNC_SPIKES]


@pytest.mark.parametrize(("rise", "is_early"), [(11499, True), (11500, False)])
def test_an_edge_before_one_and_a_half_seconds_of_low_line_is_early(rise: int, is_early: bool) -> None:
    edges = find_edges(*line((rise, 14000), start=10000, end=15000))
    assert edges.rising == pytest.approx(rise / 1000 - 0.0005)
    note = Note(TrialNoteCode.SYNC_EARLY, {"rest_s": pytest.approx(1.499)})  # type: ignore[dict-item]
    assert edges.findings == ((note,) if is_early else ())


def test_a_missing_stop_edge_is_named() -> None:
    edges = find_edges(*line((2500, 9000)))
    assert edges.falling is None
    assert edges.findings == (Note(TrialNoteCode.SYNC_NO_STOP),)


def test_a_trigger_pulse_gives_a_start_and_no_stop() -> None:
    edges = find_edges(*line((2500, 2510)))
    assert (edges.rising, edges.falling) == (pytest.approx(2.4995), None)
    assert edges.findings[0].code is TrialNoteCode.SYNC_SHORT
    assert edges.findings[0].figures["duration_s"] == pytest.approx(0.01)


TIME = np.arange(3) / 1000


@pytest.mark.parametrize(
    ("recorded", "code", "figures"),
    [
        (line(CAPTURE, (7000, 7500)), RejectionCode.SYNC_RISES_AGAIN, {"count": 2, "at": "2.50 s, 7.00 s"}),
        (line((1000, 1002), (2000, 2002)), RejectionCode.SYNC_RISES_AGAIN, {"count": 2}),
        (
            line(*((i * 1000, i * 1000 + 100) for i in range(1, 7))),
            RejectionCode.SYNC_RISES_AGAIN,
            {"count": 6, "at": "1.00 s, 2.00 s, 3.00 s, 4.00 s, 5.00 s"},
        ),
        (
            line((0, 2500), (6000, 8000)),
            RejectionCode.SYNC_INVERTED,
            {"gap_s": pytest.approx(3.5), "fell_s": pytest.approx(2.5), "level_v": 2.5, "threshold_v": 2.5},
        ),
        ((TIME, np.array([5.0, 4.8, 4.9]), 2.5), RejectionCode.SYNC_STARTS_HIGH, {"level_v": 5.0, "threshold_v": 2.5}),
        (line((0, 2500), (6000, 7000)), RejectionCode.SYNC_STARTS_HIGH, {}),
        (line((0, 2500), (3000, 4000), (6000, 8000)), RejectionCode.SYNC_STARTS_HIGH, {}),
        (
            (TIME, np.array([0.1, 1.2, 0.3]), 2.5),
            RejectionCode.SYNC_NEVER_RISES,
            {"highest_v": 1.2, "threshold_v": 2.5},
        ),
        ((TIME, np.array([0.1, np.nan, 5.0]), 2.5), RejectionCode.SYNC_NOT_FINITE, {}),
        ((TIME[:0], TIME[:0], 2.5), RejectionCode.SYNC_NOT_FINITE, {}),
    ],
    ids=[
        "double edge",
        "spikes alone",
        "six pulses",
        "inverted",
        "begun before arming",
        "begun before arming, and rises once more",
        "begun before arming, and rises twice",
        "silent",
        "NaN",
        "empty",
    ],
)
def test_a_line_without_a_single_start_is_refused(
    recorded: Line, code: RejectionCode, figures: dict[str, object]
) -> None:
    with raises_refusal(code, **figures):
        find_edges(*recorded)


@pytest.mark.parametrize(
    ("recorded", "falling", "codes"),
    [
        (
            line((0, 6000), (7000, 7002), low=((3000, 3002),)),
            5.9995,
            [TrialNoteCode.SYNC_DIPS, TrialNoteCode.SYNC_SPIKES],
        ),
        (
            line((-20, 6000), (7000, 7002), low=((0, 3),), start=-20),
            5.9995,
            [TrialNoteCode.SYNC_BOUNCES, TrialNoteCode.SYNC_SPIKES],
        ),
        (line((-6000, -3000), (0, 20), start=-6000), -3.0005, []),
        (line((0, 20)), 0.0195, []),
        (line((0, 19)), None, [TrialNoteCode.SYNC_SHORT]),
        (line((0, 8000)), None, [TrialNoteCode.SYNC_NO_STOP]),
        (line((1, 6000)), None, [TrialNoteCode.SYNC_LOW]),
        (line(), None, [TrialNoteCode.SYNC_LOW]),
    ],
    ids=["glitches", "bounce", "20 ms more", "20 ms", "19 ms", "stays high", "low at sample 0", "low"],
)
def test_a_line_that_started_the_acquisition_has_its_rise_at_time_0(
    recorded: Line, falling: float | None, codes: list[TrialNoteCode]
) -> None:
    edges = find_fall(*recorded)
    assert (edges.rising, edges.rising_sd) == (0.0, 0.0)
    assert (edges.falling, edges.falling_sd) == (
        (None, SyncEdges(0.0, 0.0, None).falling_sd)
        if falling is None
        else (pytest.approx(falling), pytest.approx(STEP_SD))
    )
    assert [note.code for note in edges.findings] == codes


@given(st.lists(st.tuples(st.booleans(), st.integers(1, 60)), max_size=12), st.booleans())
def test_whatever_the_line_does_two_edges_in_order_come_out_or_one_sentence(
    stretches: list[tuple[bool, int]], is_started_by_edge: bool
) -> None:
    level = np.concatenate([np.zeros(0), *(np.full(count, 5.0 * is_high) for is_high, count in stretches)])
    try:
        edges = (find_fall if is_started_by_edge else find_edges)(np.arange(len(level)) / 1000, level, 2.5)
    except UnusableTrial as error:
        assert str(error)
    else:
        assert edges.falling is None or edges.rising < edges.falling
        assert all(str(note) for note in edges.findings)
