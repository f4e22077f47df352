"""A suit on muscles with elastic tendons: the same as its forces as external loads, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest

from solver.bundled import bundled_model, simulate_arm_raise
from solver.cuff import CuffParameters
from solver.errors import SolverCode
from solver.motion import differentiate
from solver.osim.suited import SuitedModel
from solver.redundancy.effort import RedundancyOptions
from solver.redundancy.motion_solution import LoadedMotion, MotionSolution, solve_motion
from solver.suit.assessment import assess
from solver.suit.optimise import optimise_suit
from solver.suit.suit import read_suit
from tests.refusals import raises_refusal

MODEL = bundled_model()
WHOLE = differentiate(simulate_arm_raise(MODEL), start=1.0, end=1.3)
ROWS = ("time", "positions", "speeds", "accelerations")
MOTION = replace(WHOLE, **{name: getattr(WHOLE, name)[:6] for name in ROWS})
SUIT = replace(read_suit(), rest_lengths=np.array([0.7, 0.75]), reference_rest_length=0.75)
HAND = CuffParameters("hand", "arm", 8520.0, 210.0, 0.015, np.diag([100.0, 10.0, 0.002]) ** 2)
ELASTIC = RedundancyOptions(tendons="elastic")


@pytest.fixture(scope="module")
def assessment():  # type: ignore[no-untyped-def]
    return assess(LoadedMotion(MODEL, MOTION, options=ELASTIC), SUIT, (HAND,))


def solved(*, has_cord: bool) -> MotionSolution:
    """The same body by solve_motion, which has the forces of the cord as external loads."""
    suited = SuitedModel(MODEL, SUIT, None, None)
    return solve_motion(suited.model, MOTION, ELASTIC, loads=suited.loads(MOTION) if has_cord else ())


def test_a_scenario_is_the_motion_with_the_forces_of_the_cord_as_loads(assessment) -> None:  # type: ignore[no-untyped-def]
    slack, worn = solved(has_cord=False), solved(has_cord=True)
    np.testing.assert_allclose(assessment.slack, slack.activations, rtol=0, atol=1e-7)
    rigid = assessment.curves[0]
    np.testing.assert_allclose(rigid.activations, worn.activations, rtol=0, atol=1e-6)
    effort, before = (float((solution.activations**2).sum()) for solution in (worn, slack))
    assert rigid.cost[1] == pytest.approx(effort / before, rel=1e-6)
    assert rigid.cost[1] != pytest.approx(1.0, abs=0.02)


def test_elastic_tendons_change_the_saved_effort(assessment) -> None:  # type: ignore[no-untyped-def]
    rigid = assess(LoadedMotion(MODEL, MOTION), SUIT, (HAND,))
    assert assessment.unsolved == rigid.unsolved == 0
    assert abs(assessment.curves[0].cost[0] - rigid.curves[0].cost[0]) > 1e-4


def test_single_frames_are_refused() -> None:
    motion = LoadedMotion(MODEL, MOTION, options=ELASTIC)
    with raises_refusal(SolverCode.UNSUPPORTED, naming="every 2-th"):
        assess(motion, SUIT, (HAND,), every=2)
    with raises_refusal(SolverCode.UNSUPPORTED, naming="fibre velocities"):
        optimise_suit(motion, SUIT, (None, HAND), every=20)
