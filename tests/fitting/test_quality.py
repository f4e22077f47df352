"""When not to believe a trial."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fitting.quality import (
    MarkerQuality,
    UnusableTrial,
    marker_notes,
    marker_quality,
    require_live_force,
    require_plausible_displacement,
    zero_drift,
    zero_notes,
)

TIME = np.arange(3000) / 100
FORCE = 25 + 12 * np.sin(2 * np.pi * TIME)
SOUND = MarkerQuality(0.0, {}, 2e-4, 0.0, 1e-3)


def _quality(residual: np.ndarray, body: np.ndarray) -> MarkerQuality:
    return marker_quality(np.zeros((len(TIME), 3)), residual, body, FORCE, {})


def test_skin_that_follows_the_pull_shows_in_the_anchor_s_residual() -> None:
    noise = np.abs(2e-4 * np.random.default_rng(1).standard_normal(len(TIME)))
    body = np.zeros((len(TIME), 3))
    still, follows = _quality(noise, body), _quality(noise + 2e-5 * FORCE, body)
    assert abs(still.anchor_follows_force) < 0.1
    assert marker_notes(still) == ()
    assert follows.anchor_follows_force > 0.3
    assert "skin moves under a marker" in marker_notes(follows)[0]


def test_a_body_that_leans_with_the_load_is_measured() -> None:
    sway = 2e-3 * np.sin(0.4 * TIME)
    body = np.column_stack((3e-4 * FORCE + sway, 4e-4 * FORCE, 0 * TIME))
    found = _quality(np.full(len(TIME), 1e-4) + 1e-6 * np.sin(9.1 * TIME), body)
    assert found.lean == pytest.approx(5e-4 * 24, rel=0.05)
    assert "leaned 12.0 mm" in marker_notes(found)[0]


def test_ghosts_and_hidden_frames_are_told() -> None:
    assert "anchor_3 in 12 frames" in marker_notes(replace(SOUND, ghosts={"anchor_3": 12}))[0]
    assert "hidden in 30 %" in marker_notes(replace(SOUND, hidden=0.3))[0]
    with pytest.raises(UnusableTrial, match="hidden in 60 %"):
        marker_notes(replace(SOUND, hidden=0.6))


def test_force_that_is_stuck_while_the_cuff_moves_is_refused() -> None:
    way = FORCE / 8000
    stuck = np.where((TIME > 10) & (TIME < 12), FORCE[1000], FORCE)
    with pytest.raises(UnusableTrial, match=r"without change for \d\.\d s from 10"):
        require_live_force(TIME, stuck, TIME, way)
    require_live_force(TIME, FORCE, TIME, way)


def test_a_held_load_may_read_one_code() -> None:
    held = np.where(TIME < 15, 2.0, 17.0)
    require_live_force(TIME, held, TIME, held / 8000 + 1e-5 * np.sin(9 * TIME))


@pytest.mark.parametrize("scale", [1e3, 1e-6])
def test_a_displacement_in_the_wrong_unit_is_refused(scale: float) -> None:
    require_plausible_displacement(FORCE / 8000)
    with pytest.raises(UnusableTrial, match="millimetres"):
        require_plausible_displacement(scale * FORCE / 8000)


def _pull(drift: float, rest: float = 2.0) -> np.ndarray:
    """60 N between a rest at 3 N and one that reads `drift` more; the zero drifts all the time."""
    pulled = np.abs(TIME - TIME[-1] / 2) < TIME[-1] / 2 - rest
    noise = 0.2 * np.random.default_rng(2).standard_normal(len(TIME))
    return 3.0 + 60.0 * pulled + drift * TIME / TIME[-1] + noise


@pytest.mark.parametrize("drift", [0.0, 0.9, 2.4, -2.4])
def test_the_zero_s_drift_between_both_rests_is_measured_and_told_beyond_its_limit(drift: float) -> None:
    found = zero_drift(TIME, _pull(drift))
    assert found == pytest.approx(drift, abs=0.15)
    notes = zero_notes(found, 60.0)
    assert len(notes) == (abs(drift) > 1.2)
    assert all("expected at most 1.20 N" in note for note in notes)


@pytest.mark.parametrize(
    "force",
    [_pull(0.0, rest=0.5), np.where(TIME > 15, 63.0, 3.0), 25 + 12 * np.sin(2 * np.pi * 0.1 * TIME), np.zeros(1)],
    ids=["short rest", "load left on", "never at rest", "one sample"],
)
def test_without_a_rest_at_both_ends_no_drift_is_told(force: np.ndarray) -> None:
    found = zero_drift(TIME[: len(force)], force)
    assert found is None
    assert zero_notes(found, 60.0) == ()
