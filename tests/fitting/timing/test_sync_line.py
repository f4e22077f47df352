"""What is odd about a recorded sync line is named, and the capture's edges are found all the same where they can be."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from fitting.quality import UnusableTrial
from fitting.timing.sync_line import find_edges, find_fall

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
    ("level", "finding"),
    [
        (_line(CAPTURE, (1.0, 1.002)), r"glitch: .* high beside the capture 1 time\(s\).*1\.000 s"),
        (_line(CAPTURE, (1.0, 1.002), (7.0, 7.001)), r"glitch: .* 2 time\(s\).*1\.000 s, 7\.000 s"),
        (_line(CAPTURE, low=((4.0, 4.003),)), r"glitch: .* low during the capture 1 time\(s\).*4\.000 s"),
        (_line(CAPTURE, low=((2.502, 2.505), (2.507, 2.508))), r"bounce: .* at an edge 2 time\(s\)"),
        (_line(CAPTURE, (6.003, 6.005)), r"bounce: .* at an edge 1 time\(s\).*6\.000 s"),
    ],
    ids=["spike", "two spikes", "dip", "bouncing start", "bouncing stop"],
)
def test_glitches_and_bounces_are_named_and_leave_the_edges_where_they_are(
    level: NDArray[np.float64], finding: str
) -> None:
    edges = find_edges(time, level, 2.5)
    assert (edges.rising, edges.falling) == (pytest.approx(2.4995), pytest.approx(5.9995))
    assert len(edges.findings) == 1
    assert re.search(finding, edges.findings[0])


def test_an_early_edge_is_named() -> None:
    edges = find_edges(time, _line((0.4, 6.0)), 2.5)
    assert edges.rising == pytest.approx(0.3995)
    assert edges.findings[0].startswith("early edge: the sync line rises 0.40 s after its first sample, expected 2 s")


def test_a_missing_stop_edge_is_named() -> None:
    edges = find_edges(time, _line((2.5, 9.0)), 2.5)
    assert edges.falling is None
    assert "has not fallen when the recording ends" in edges.findings[0]


def test_a_trigger_pulse_gives_a_start_and_no_stop() -> None:
    edges = find_edges(time, _line((2.5, 2.51)), 2.5)
    assert (edges.rising, edges.falling) == (pytest.approx(2.4995), None)
    assert "high for 10 ms only" in edges.findings[0]


@pytest.mark.parametrize(
    ("level", "sentence"),
    [
        (_line((2.5, 4.0), (5.0, 6.0)), r"rises 2 times \(at 2\.50 s, 5\.00 s\), expected once"),
        (_line((1.0, 1.002), (2.0, 2.002)), "rises 2 times"),
        (5.0 - _line(CAPTURE), r"wrong polarity: .* is low for 3\.50 s from 2\.50 s on; set QTM's output to active"),
        (_line((-1.0, 6.0)), r"starts at 5\.00 V.*armed before the capture"),
        (_line(), "never rises above"),
    ],
    ids=["double edge", "spikes alone", "inverted", "begun before arming", "silent"],
)
def test_a_line_without_a_single_start_is_refused_in_words(level: NDArray[np.float64], sentence: str) -> None:
    with pytest.raises(UnusableTrial, match=sentence):
        find_edges(time, level, 2.5)


def test_a_line_that_started_the_acquisition_passes_glitches_over_too() -> None:
    edges = find_fall(time, _line((-1.0, 6.0), (7.0, 7.002), low=((3.0, 3.002),)), 2.5)
    assert edges.falling == pytest.approx(5.9995)
    assert [finding.split(":")[0] for finding in edges.findings] == ["glitch", "glitch"]


@given(st.lists(st.tuples(st.booleans(), st.integers(1, 60)), max_size=12), st.booleans())
def test_whatever_the_line_does_two_edges_in_order_come_out_or_one_sentence(
    stretches: list[tuple[bool, int]], is_started_by_edge: bool
) -> None:
    level = np.concatenate([np.zeros(0), *(np.full(count, 5.0 * is_high) for is_high, count in stretches)])
    try:
        edges = (find_fall if is_started_by_edge else find_edges)(time[: len(level)], level, 2.5)
    except UnusableTrial as error:
        assert "\n" not in str(error)
    else:
        assert edges.falling is None or edges.rising < edges.falling
        assert all("\n" not in finding for finding in edges.findings)
