"""Joint centres: of a simulated ball joint the truth, of a model's scapula the model's own centre."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from solver.coverage_code import CoverageCode
from solver.errors import SolverCode
from solver.inverse_kinematics.solve import assemble
from solver.model import PathPoint
from solver.multibody.postures import points_in_ground, postures
from solver.personalisation.coverage import check_coverage
from solver.personalisation.joint_centres import (
    functional_centre,
    glenohumeral_centre_below_acromion,
    in_segment,
    regression_glenohumeral_centre,
    sphere_centre,
)
from tests.solver.personalisation.simulated_person import MARKERS, MODEL
from tests.solver.refusals import raises_refusal

Array = np.ndarray


def circumduction(noise: float, size: float = 0.6) -> tuple[Array, Array, Array]:
    """Markers of a scapula and an upper arm (frames, 4, 3) [m] that turn about a true centre (frames, 3); own poses."""
    chance = np.random.default_rng(7)
    phase = np.linspace(0.0, 12.0, 150)
    first = Rotation.from_euler(
        "xyz", 0.2 * np.stack([np.sin(phase), np.cos(0.7 * phase), np.sin(0.3 * phase)], axis=1)
    )
    swing = size * np.stack([np.sin(3 * phase), 0.5 * np.cos(2 * phase), np.cos(3 * phase)], axis=1)
    second = first * Rotation.from_euler("xyz", swing)
    places = chance.uniform(-0.08, 0.08, (4, 3)), chance.uniform(-0.05, 0.05, (4, 3)) - np.array([0.0, 0.2, 0.0])
    origin = chance.normal(0.0, 0.03, 3) + 0.05 * np.stack([np.sin(phase), phase / 12, np.cos(phase)], axis=1)
    centre = origin + first.apply([0.04, -0.05, 0.01])
    one = np.stack([origin + first.apply(place) for place in places[0]], axis=1)
    two = np.stack([centre + second.apply(place) for place in places[1]], axis=1)
    skin = (noise * chance.standard_normal(part.shape) for part in (one, two))
    return one + next(skin), two + next(skin), centre


@pytest.mark.parametrize(("noise", "within"), [(0.0, 1e-9), (0.001, 0.002)])
def test_a_ball_joint_that_moves_shows_its_centre(noise: float, within: float) -> None:
    proximal, distal, truth = circumduction(noise)
    found = functional_centre(proximal, distal)
    assert np.linalg.norm(found.in_ground - truth, axis=1).mean() < within
    sphere = sphere_centre(in_segment(proximal, distal))
    assert np.linalg.norm(sphere - in_segment(proximal, truth[:, None])[:, 0].mean(axis=0)) < within
    assert found.residual <= 5.0 * noise + 1e-9


def test_frames_with_a_hidden_marker_are_left_out() -> None:
    proximal, distal, truth = circumduction(0.0)
    distal[5:20, 1] = np.nan
    found = functional_centre(proximal, distal)
    assert np.isnan(found.in_ground[10]).all()
    np.testing.assert_allclose(found.in_ground[30:], truth[30:], atol=1e-9)


def test_an_arm_that_hardly_moves_shows_no_centre() -> None:
    proximal, distal, _ = circumduction(0.001, size=0.02)
    with raises_refusal(SolverCode.CENTRE_TOO_LITTLE_MOTION):
        functional_centre(proximal, distal)
    with raises_refusal(SolverCode.CENTRE_TOO_FEW_MARKERS):
        functional_centre(proximal[:, :2], distal)


def test_the_regression_finds_the_humeral_head_of_a_modelled_scapula() -> None:
    """A model made from CT, which is not among the 36 cadavers; its coracoid is known by where the biceps begins, a
    centimetre from the tip. Moved and turned as a whole, the centre goes along.
    """
    biceps = next(muscle for muscle in MODEL.muscles if muscle.name == "BIC_brevis").path.points[0]
    assert isinstance(biceps, PathPoint)
    landmarks = {name.upper(): np.array(MODEL.marker(name).location) for name in ("ac", "aa", "ts", "ai")}
    landmarks["PC"] = np.array(biceps.location)
    centre = regression_glenohumeral_centre(landmarks)
    head = MODEL.joint("GlenoHumeral").frame_in_parent.translation
    assert np.linalg.norm(centre - head) < 0.012
    turned, shift = Rotation.from_euler("xyz", [0.4, -1.1, 2.0]), np.array([0.3, -1.0, 0.2])
    moved = {name: turned.apply(place) + shift for name, place in landmarks.items()}
    np.testing.assert_allclose(regression_glenohumeral_centre(moved), turned.apply(centre) + shift, atol=1e-12)
    with raises_refusal(SolverCode.CENTRE_MISSING_LANDMARK, naming="PC"):
        regression_glenohumeral_centre({name: place for name, place in landmarks.items() if name != "PC"})


def test_the_centre_lies_below_the_acromion_of_a_modelled_girdle() -> None:
    """With the other side as the mirror image about the plane of IJ and C7; a joint of the clavicle on the acromion."""
    posture = assemble(MODEL)[None]
    state = postures(MODEL, posture, np.zeros_like(posture))

    def place(name: str) -> Array:
        return points_in_ground(state, MODEL.marker(name).body, MODEL.marker(name).location)[0]

    landmarks = {name.upper(): place(name) for name in ("ij", "px", "c7", "t8", "ac")}
    middle = 0.5 * (landmarks["IJ"] + landmarks["C7"])
    landmarks["other"] = landmarks["AC"] - [0.0, 0.0, 2 * (landmarks["AC"] - middle)[2]]
    scapula, head = MODEL.body_index("scapula"), MODEL.joint("GlenoHumeral").frame_in_parent.translation
    centre = glenohumeral_centre_below_acromion(landmarks, ("AC", "other"))
    assert np.linalg.norm(centre - points_in_ground(state, scapula, head)[0]) < 0.03
    width = np.linalg.norm(landmarks["AC"] - landmarks["other"])
    assert np.linalg.norm(centre - landmarks["AC"]) == pytest.approx(0.17 * width)
    with raises_refusal(SolverCode.CENTRE_MISSING_LANDMARK, naming="left"):
        glenohumeral_centre_below_acromion({**landmarks, "AC": centre}, ("AC", "left"))


def test_a_marker_set_without_a_scapula_is_reported() -> None:
    """A sports set: chest, spine, shoulder top (on the clavicle), arm, elbow, wrist."""
    assert check_coverage(MODEL, MARKERS) == ()
    by_body = {MODEL.bodies[marker.body].name: marker for marker in MARKERS}
    arm = [marker for marker in MARKERS if marker.body != MODEL.body_index("scapula")]
    assert check_coverage(MODEL, arm) == (CoverageCode.NO_SCAPULA_MARKERS,)
    assert check_coverage(MODEL, [*arm, by_body["scapula"]]) == (CoverageCode.NO_SCAPULA_MARKERS,)
    assert check_coverage(MODEL, [*arm, *2 * [by_body["scapula"]]]) == (CoverageCode.FEW_SCAPULA_MARKERS,)
    few = [by_body["thorax"], by_body["humerus"]]
    assert check_coverage(MODEL, few) == (
        CoverageCode.THORAX_NOT_DETERMINED,
        CoverageCode.NO_SCAPULA_MARKERS,
        CoverageCode.AXIAL_ROTATION_UNCERTAIN,
        CoverageCode.NO_FOREARM_MARKERS,
    )
    assert CoverageCode.HUMERUS_NOT_DETERMINED in check_coverage(MODEL, [by_body["thorax"]])
