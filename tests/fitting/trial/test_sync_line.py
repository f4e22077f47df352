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
from fitting.trial.sync_line import find_edges, find_fall
from tests.fitting.refusals import raises_refusal

time = np.arange(8000) / 1000
CAPTURE = (2.5, 6.0)


def _line(*pulses: tuple[float, float], low: tuple[tuple[float, float], ...] = ()) -> NDArray[np.float64]:
    """5 V in the pulses and 0 V in `low`, with a millivolt of noise."""
    level = np.zeros(len(time))
    for start, end in pulses:
        level[(time >= start - 1e-9) & (time < end - 1e-9)] = 5.0
    for start, end in low:
        level[(time >= start - 1e-9) & (time < end - 1e-9)] = 0.0
    return level + 1e-3 * np.random.default_rng(1).standard_normal(len(time))


def test_a_clean_capture_has_two_edges_and_no_finding() -> None:
    edges = find_edges(time, _line(CAPTURE), 2.5)
    assert (edges.rising, edges.falling) == (pytest.approx(2.4995), pytest.approx(5.9995))
    assert edges.findings == ()


@pytest.mark.parametrize(
    ("level", "code", "figures"),
    [
        (_line(CAPTURE, (1.0, 1.002)), TrialNoteCode.SYNC_SPIKES, {"count": 1, "at": "1.000 s"}),
        (_line(CAPTURE, (1.0, 1.002), (7.0, 7.001)), TrialNoteCode.SYNC_SPIKES, {"count": 2, "at": "1.000 s, 7.000 s"}),
        (_line(CAPTURE, low=((4.0, 4.003),)), TrialNoteCode.SYNC_DIPS, {"count": 1, "at": "4.000 s"}),
        (
            _line(CAPTURE, low=((2.502, 2.505), (2.507, 2.508))),
            TrialNoteCode.SYNC_BOUNCES,
            {"count": 2, "at": "2.502 s, 2.507 s"},
        ),
        (_line(CAPTURE, (6.003, 6.005)), TrialNoteCode.SYNC_BOUNCES, {"count": 1, "at": "6.000 s"}),
    ],
    ids=["spike", "two spikes", "dip", "bouncing start", "bouncing stop"],
)
def test_glitches_and_bounces_are_named_and_leave_the_edges_where_they_are(
    level: NDArray[np.float64], code: TrialNoteCode, figures: dict[str, object]
) -> None:
    edges = find_edges(time, level, 2.5)
    assert (edges.rising, edges.falling) == (pytest.approx(2.4995), pytest.approx(5.9995))
    assert edges.findings == (Note(code, figures),)  # type: ignore[arg-type]


def test_an_early_edge_is_named() -> None:
    edges = find_edges(time, _line((0.4, 6.0)), 2.5)
    assert edges.rising == pytest.approx(0.3995)
    assert edges.findings[0].code is TrialNoteCode.SYNC_EARLY
    assert edges.findings[0].figures["rest_s"] == pytest.approx(0.4)


def test_a_missing_stop_edge_is_named() -> None:
    edges = find_edges(time, _line((2.5, 9.0)), 2.5)
    assert edges.falling is None
    assert edges.findings == (Note(TrialNoteCode.SYNC_NO_STOP),)


def test_a_trigger_pulse_gives_a_start_and_no_stop() -> None:
    edges = find_edges(time, _line((2.5, 2.51)), 2.5)
    assert (edges.rising, edges.falling) == (pytest.approx(2.4995), None)
    assert edges.findings[0].code is TrialNoteCode.SYNC_SHORT
    assert edges.findings[0].figures["duration_s"] == pytest.approx(0.01)


@pytest.mark.parametrize(
    ("level", "code", "figures"),
    [
        (_line((2.5, 4.0), (5.0, 6.0)), RejectionCode.SYNC_RISES_AGAIN, {"count": 2, "at": "2.50 s, 5.00 s"}),
        (_line((1.0, 1.002), (2.0, 2.002)), RejectionCode.SYNC_RISES_AGAIN, {"count": 2}),
        (
            5.0 - _line(CAPTURE),
            RejectionCode.SYNC_INVERTED,
            {"gap_s": pytest.approx(3.5), "fell_s": pytest.approx(2.5)},
        ),
        (_line((-1.0, 6.0)), RejectionCode.SYNC_STARTS_HIGH, {"level_v": pytest.approx(5.0, abs=0.01)}),
        (_line(), RejectionCode.SYNC_NEVER_RISES, {"highest_v": pytest.approx(0.0, abs=0.01)}),
    ],
    ids=["double edge", "spikes alone", "inverted", "begun before arming", "silent"],
)
def test_a_line_without_a_single_start_is_refused(
    level: NDArray[np.float64], code: RejectionCode, figures: dict[str, object]
) -> None:
    with raises_refusal(code, **figures):
        find_edges(time, level, 2.5)


def test_a_line_that_started_the_acquisition_passes_glitches_over_too() -> None:
    edges = find_fall(time, _line((-1.0, 6.0), (7.0, 7.002), low=((3.0, 3.002),)), 2.5)
    assert edges.falling == pytest.approx(5.9995)
    assert [note.code for note in edges.findings] == [TrialNoteCode.SYNC_DIPS, TrialNoteCode.SYNC_SPIKES]


@given(st.lists(st.tuples(st.booleans(), st.integers(1, 60)), max_size=12), st.booleans())
def test_whatever_the_line_does_two_edges_in_order_come_out_or_one_sentence(
    stretches: list[tuple[bool, int]], is_started_by_edge: bool
) -> None:
    level = np.concatenate([np.zeros(0), *(np.full(count, 5.0 * is_high) for is_high, count in stretches)])
    try:
        edges = (find_fall if is_started_by_edge else find_edges)(time[: len(level)], level, 2.5)
    except UnusableTrial as error:
        assert str(error)
    else:
        assert edges.falling is None or edges.rising < edges.falling
        assert all(str(note) for note in edges.findings)
