"""Against what was published: activations of four motions, and the study of the passive suit on one of them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from solver.assessment import assess
from solver.cuff import CuffParameters
from solver.motion import differentiate, read_motion
from solver.osim.reader import read_osim
from solver.redundancy import RedundancyOptions, solve_motion
from solver.suit import read_suit

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


PUBLISHED_COSTS = {  # at a rest length of 0.74 m: shift, visco-elastic, both
    "hand": (0.829, 0.798, 0.858),
    "tube": (0.829, 0.803, 0.854),
    "elbow": (0.869, 0.818, 0.877),
}


def test_the_suit_saves_what_was_published_at_the_rigid_optimum():
    model, kinematics = trial("FLX01")
    cuffs = [
        CuffParameters("waist", "waist", 2140.0, 124.0, 0.012),
        CuffParameters("hand", "arm", 8520.0, 210.0, 0.012),
        CuffParameters("tube", "arm", 5510.0, 38.0, 0.009),
        CuffParameters("elbow", "arm", 2530.0, 139.0, 0.022),
    ]
    suit = replace(read_suit(), rest_lengths=np.linspace(0.66, 0.80, 5))
    table = assess(model, kinematics, suit, cuffs, every=30).to_json()["at_rigid_optimum"]
    assert table["rigid"]["value"] == pytest.approx(0.787, abs=0.02)
    for cuff, costs in PUBLISHED_COSTS.items():
        found = [table[cuff][condition]["value"] for condition in ("shift", "visco_elastic", "both")]
        np.testing.assert_allclose(found, costs, atol=0.02)
