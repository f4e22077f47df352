"""Force and displacement that are not on one clock: the loads step in one and later in the other."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import pytest

from fitting.pull.pull import make_pulls
from fitting.results.codes import RejectionCode
from fitting.trial.trial import Trial, build_trial
from tests.fitting.defects import Law, OddSession, Rig
from tests.fitting.experiment import PUBLISHED, Session, Truth, published


@cache
def _static(cuff: str, hold: float, force_rate: float) -> Trial:
    return build_trial(*Session(published(cuff, hold=hold, force_rate=force_rate), 1).static(1), "s", "s")


@pytest.mark.parametrize("cuff", PUBLISHED)
@pytest.mark.parametrize(("hold", "force_rate"), [(8.0, 1000.0), (4.0, 1000.0), (8.0, 20.0)])
@pytest.mark.parametrize("late", [0.0, 0.3, 1.0, 2.0, -3.0])
def test_loads_that_step_apart_are_rejected_with_their_distance(
    cuff: str, hold: float, force_rate: float, late: float
) -> None:
    trial = _static(cuff, hold, force_rate)
    pulls, reasons = make_pulls([replace(trial, force_time=trial.force_time - late)])
    if abs(late) < 0.5:
        assert len(pulls) == 1
        return
    assert reasons["s"].code is RejectionCode.STEPS_APART
    assert reasons["s"].figures["offset_s"] == pytest.approx(late, abs=0.15)


@pytest.mark.parametrize("unloads_at_once", [False, True])
@pytest.mark.parametrize(
    "law", [Law(friction=4.0), Law(slip_from=20.0), Law(slow=(0.5, 15.0)), Law(slow=(2.0, 30.0)), Law(fast=(0.4, 0.3))]
)
def test_a_cuff_that_creeps_slips_or_has_friction_is_on_the_clock_of_its_force(law: Law, unloads_at_once: bool) -> None:
    truth = Truth(friction=1e9, migration=0.0, hold=6.0, unloads_at_once=unloads_at_once)
    pulls, _ = make_pulls([build_trial(*OddSession(law, Rig(), 1, truth).static(1), "s", "s")])
    assert len(pulls) == 1
