"""Whether one trial can be used, from that trial alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fitting.results.codes import RejectionCode
from fitting.results.rendering import Note
from fitting.session import find_rejection
from fitting.trial.reader import TrialReading
from fitting.trial.trial import RejectedTrial, Trial, build_bounce, build_trial
from tests.fitting.bouncing import Bounce
from tests.fitting.bouncing import recorded as bounce
from tests.fitting.experiment import Session, published


@pytest.fixture(scope="module")
def session() -> Session:
    return Session(published("hand", hold=4.0, duration=12.0), 3)


@pytest.fixture(scope="module")
def static(session: Session) -> Trial:
    return build_trial(*session.static(), "static", "s")


def _until(trial: Trial, end: float) -> Trial:
    forces, frames = trial.force_time < end, trial.marker_time < end
    return replace(
        trial,
        force_time=trial.force_time[forces],
        force=trial.force[forces],
        marker_time=trial.marker_time[frames],
        markers=trial.markers[frames],
    )


def _code(reading: TrialReading) -> object:
    reason = find_rejection(reading)
    return reason and reason.code


def test_a_whole_static_trial_can_be_used(static: Trial) -> None:
    assert find_rejection(static) is None


def test_a_static_trial_that_ends_under_load_leaves_migration_unknown(static: Trial) -> None:
    assert _code(_until(static, 0.6 * static.end)) is RejectionCode.NOT_UNLOADED


def test_a_static_trial_of_two_loads_has_too_few(static: Trial) -> None:
    assert _code(_until(static, 9.0)) is RejectionCode.FEW_LOADS


def test_a_dynamic_trial_can_be_used_unless_its_force_does_not_swing(session: Session) -> None:
    dynamic = build_trial(*session.dynamic(), "dynamic", "s")
    assert find_rejection(dynamic) is None
    assert _code(replace(dynamic, force=np.full(len(dynamic.force), 20.0))) is RejectionCode.NO_MOTION


def test_what_could_not_be_read_has_its_reason() -> None:
    reason = Note(RejectionCode.UNREADABLE, {"problem": "empty"})
    assert find_rejection(RejectedTrial("a.mcap", reason)) == reason


def test_a_bounce_can_be_used_where_it_calibrates() -> None:
    whole = build_bounce(*bounce(Bounce(), 1), "bounce", "s")
    assert find_rejection(whole) is None
    hidden = replace(whole, position=np.full(whole.position.shape, np.nan))
    assert _code(hidden) is RejectionCode.BOUNCE_HIDDEN
