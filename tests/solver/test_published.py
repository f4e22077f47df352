"""Against what was published: activations of four motions, and the study of the passive suit on one of them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from solver.assessment import assess
from solver.cuff import CuffParameters
from solver.motion import differentiate, read_motion, thin
from solver.osim.reader import read_osim
from solver.redundancy import (
    FrameOutcome,
    RedundancyOptions,
    build_redundancy,
    go_through,
    solve_motion,
    solve_redundancy,
)
from solver.suit import read_suit
from solver.worn import CUFF_CONDITIONS

SHARED = Path(__file__).parents[2].parent / "shared" / "data"

pytestmark = pytest.mark.shared


def trial(name, weight="noWeight"):
    model = read_osim(SHARED / "models" / f"TSM_subject_{weight}.osim")
    return model, differentiate(read_motion(SHARED / "motions" / f"{name}.mot", model))


@pytest.mark.parametrize(
    ("name", "weight", "cone", "free"),
    [
        ("FLX01", "noWeight", True, ()),
        ("FLX01", "noWeight", False, ()),
        ("FLX21", "2kgWeight", True, ()),
        ("ABD02", "noWeight", True, ()),
        ("SHRUG01", "noWeight", True, ("plane_elv", "axial_rot")),
    ],
)
def test_activations_are_the_published_ones(name, weight, cone, free):
    # all frames: each one's bounds come from the one before
    model, kinematics = trial(name, weight)
    result = solve_motion(model, kinematics, RedundancyOptions(has_glenoid_cone=cone, free_coordinates=free))
    published = SHARED / "published" / f"{name}_{'gh' if cone else 'nogh'}.csv"
    assert published.read_text().splitlines()[0].split(",")[1:] == list(model.muscle_names)
    activations = np.loadtxt(published, delimiter=",", skiprows=1)[:, 1:]
    assert result.unsolved == 0
    assert len(result.activations) == len(activations)
    assert np.abs(result.activations - activations).mean() < 3e-4


@pytest.mark.parametrize(
    ("name", "weight", "free"),
    [
        ("FLX01", "noWeight", ()),
        ("FLX21", "2kgWeight", ()),
        ("ABD02", "noWeight", ()),
        ("SHRUG01", "noWeight", ("plane_elv", "axial_rot")),
    ],
)
def test_our_solver_finds_clarabels_optimum_in_every_frame(name, weight, free):
    # every tenth frame for itself: an interval this long leaves activations their whole range
    model, kinematics = trial(name, weight)
    problem = build_redundancy(model, go_through(model, thin(kinematics, 10)), RedundancyOptions(free_coordinates=free))
    problem = replace(problem, interval=1e3)
    found, known = (solve_redundancy(replace(problem, solver=s)) for s in ("interior_point", "clarabel"))
    assert {*found.outcomes.ravel(), *known.outcomes.ravel()} == {FrameOutcome.SOLVED}
    effort, reference = ((problem.weights * s.controls[0] ** 2).sum(axis=1) for s in (found, known))
    np.testing.assert_allclose(effort, reference, rtol=2e-6)
    assert (effort <= reference * (1 + 1e-6)).all()
    assert found.cone_slack.min() > -1e-5  # N, of some hundreds
    np.testing.assert_allclose(found.equality_residual, known.equality_residual, atol=1e-5)


# at a rest length of 0.74 m: shift, visco-elastic, both
PUBLISHED_COSTS = {
    "hand": (0.829, 0.798, 0.858),
    "tube": (0.829, 0.803, 0.854),
    "elbow": (0.869, 0.818, 0.877),
}
# best rest length [m], cost there, permissible error [cm]
PUBLISHED_OPTIMA = {
    ("rigid", None): (0.74, 0.79, 3.9),
    ("shift", "hand"): (0.71, 0.79, 4.1),
    ("shift", "tube"): (0.72, 0.79, 3.9),
    ("shift", "elbow"): (0.71, 0.78, 3.7),
    ("visco_elastic", "hand"): (0.72, 0.79, 5.2),
    ("visco_elastic", "tube"): (0.72, 0.79, 5.4),
    ("visco_elastic", "elbow"): (0.70, 0.79, 6.0),
    ("both", "hand"): (0.70, 0.79, 5.3),
    ("both", "tube"): (0.70, 0.79, 5.4),
    ("both", "elbow"): (0.68, 0.79, 5.8),
}
EVERY = 4  # frames; docs/assessment.md has the table of all of them


@pytest.fixture(scope="module")
def study():
    model, kinematics = trial("FLX01")
    cuffs = [
        CuffParameters("waist", "waist", 2140.0, 124.0, 0.012),
        CuffParameters("hand", "arm", 8520.0, 210.0, 0.012),
        CuffParameters("tube", "arm", 5510.0, 38.0, 0.009),
        CuffParameters("elbow", "arm", 2530.0, 139.0, 0.022),
    ]
    return assess(model, kinematics, read_suit(), cuffs, every=EVERY)


def test_every_frame_of_the_published_study_is_solved(study):
    assert study.unsolved == 0
    assert study.longest_cord == pytest.approx(0.866, abs=1e-3)


def test_costs_at_the_rigid_optimum_are_the_published_ones(study):
    found = {(curve.condition, curve.cuff): curve.figures["at_reference"].value for curve in study.curves}
    assert found["rigid", None] == pytest.approx(0.787, abs=0.02)
    for cuff, costs in PUBLISHED_COSTS.items():
        assert [found[condition, cuff] for condition in CUFF_CONDITIONS] == pytest.approx(costs, abs=0.02)


@pytest.mark.parametrize("place", PUBLISHED_OPTIMA)
def test_optima_are_the_published_ones(study, place):
    (figures,) = [curve.figures for curve in study.curves if (curve.condition, curve.cuff) == place]
    length, cost, width = PUBLISHED_OPTIMA[place]
    assert figures["rest_length"].value == pytest.approx(length, abs=0.012)
    assert figures["lowest_cost"].value == pytest.approx(cost, abs=0.02)
    assert figures["permissible_error"].value == pytest.approx(width / 100, abs=0.005)
