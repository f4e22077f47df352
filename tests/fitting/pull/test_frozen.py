"""Markers that keep their places while the force moves are no measurement."""

from __future__ import annotations

import numpy as np
import pytest

from fitting.errors import UnusableTrial
from fitting.pull.plausibility import require_live_markers
from fitting.results.codes import RejectionCode
from tests.fitting.refusals import raises_refusal

TIME = np.arange(2000) / 100
FORCE = 25 + 12 * np.sin(TIME)


def _markers(still: slice, hidden: bool = False) -> np.ndarray:
    markers = np.random.default_rng(3).standard_normal((len(TIME), 5, 3))
    markers[still] = markers[still][:1]
    markers[still, 0] = np.nan if hidden else markers[still, 0]
    return markers


def _is_refused(markers: np.ndarray, force: np.ndarray = FORCE) -> bool:
    try:
        require_live_markers(TIME, markers, TIME, force)
    except UnusableTrial:
        return True
    return False


@pytest.mark.parametrize("hidden", [False, True])
def test_markers_that_stand_still_while_the_force_swings_are_refused(hidden: bool) -> None:
    with raises_refusal(
        RejectionCode.MARKERS_FROZEN, duration_s=pytest.approx(4.0, abs=0.05), start_s=pytest.approx(5.0, abs=0.05)
    ):
        require_live_markers(TIME, _markers(slice(500, 900), hidden), TIME, FORCE)


@pytest.mark.parametrize(
    ("still", "force"),
    [(slice(500, 590), FORCE), (slice(500, 900), np.where(TIME < 10, 0.0, FORCE)), (slice(0, 0), FORCE)],
)
def test_for_less_than_a_second_or_under_a_force_that_rests_they_may(still: slice, force: np.ndarray) -> None:
    assert not _is_refused(_markers(still), force)


def test_a_stretch_without_any_marker_is_no_standing_still() -> None:
    markers = _markers(slice(0, 0))
    markers[500:900] = np.nan
    assert not _is_refused(markers)
