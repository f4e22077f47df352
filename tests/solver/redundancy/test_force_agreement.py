"""Agreement of joint forces against SciPy, and the axes of the measured force."""

import numpy as np
import pytest
from scipy import stats

from solver.bundled import bundled_model
from solver.redundancy.force_agreement import angle_between, force_agreement, glenoid_axes
from solver.redundancy.glenoid import glenoid_cone, with_rim

MODEL = bundled_model()


@pytest.mark.parametrize("seed", range(5))
def test_the_figures_are_those_of_scipy_over_the_known_frames(seed: int) -> None:
    generator = np.random.default_rng(seed)
    reference = generator.uniform(100, 900, 80)
    predicted = reference + generator.normal(30, 60, 80)
    gaps = generator.choice(80, 7, replace=False)
    with_gaps = predicted.copy()
    with_gaps[gaps] = np.nan
    found = force_agreement(with_gaps, reference)
    ours, theirs = np.delete(predicted, gaps), np.delete(reference, gaps)
    assert found.correlation == pytest.approx(stats.pearsonr(ours, theirs).statistic, abs=1e-12)
    assert found.rmse == pytest.approx(stats.tmean((ours - theirs) ** 2) ** 0.5, rel=1e-12)
    assert found.peak_ratio == max(ours) / max(theirs)


def test_a_constant_force_has_no_correlation_and_a_lost_one_no_figures() -> None:
    rising = np.arange(5.0)
    assert np.isnan(force_agreement(np.ones(5), rising).correlation)
    assert np.isnan(force_agreement(np.full(5, np.nan), rising).rmse)


def test_angles_are_those_of_the_cosine() -> None:
    generator = np.random.default_rng(0)
    first, second = generator.normal(size=(2, 50, 3))
    cosine = (first * second).sum(axis=1) / (np.linalg.norm(first, axis=1) * np.linalg.norm(second, axis=1))
    np.testing.assert_allclose(angle_between(first, second), np.arccos(cosine), atol=1e-12)


def test_the_glenoids_axes_are_right_handed_and_a_compressive_force_is_medial() -> None:
    cone = glenoid_cone(MODEL)
    axes = glenoid_axes(cone.axis, cone.edge)
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    np.testing.assert_allclose(axes @ cone.axis, [0, 0, -1], atol=1e-12)
    up_in_scapula = axes[1]
    assert up_in_scapula[1] > 0.5, "the scapula's y axis points up"


@pytest.mark.parametrize("tangent", [0.34, 0.5, 1.2])
def test_a_rim_of_a_given_tangent_leaves_axis_and_direction_of_the_edge(tangent: float) -> None:
    before, after = glenoid_cone(MODEL), glenoid_cone(with_rim(MODEL, tangent))
    assert np.tan(after.half_angle) == pytest.approx(tangent, rel=1e-12)
    np.testing.assert_allclose(after.axis, before.axis, atol=1e-12)
    np.testing.assert_allclose(after.edge, before.edge, atol=1e-12)
