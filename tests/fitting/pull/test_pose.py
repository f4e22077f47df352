"""Rigid poses of marker clusters beside those of SciPy."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fitting.pull.pose import fit_pose

PLACES = np.array([[0.0, 0.04, 0.0], [0.05, -0.03, 0.10], [-0.05, -0.02, 0.14], [0.02, 0.05, 0.22], [0.06, 0.0, 0.05]])


@pytest.mark.parametrize(("thickness", "width"), [(1.0, 1.0), (0.0, 1.0), (0.0, 0.02), (0.3, 0.1), (-1.0, 1.0)])
def test_a_pose_is_the_rotation_of_least_squares_of_flat_narrow_and_mirrored_clusters(
    thickness: float, width: float
) -> None:
    """SciPy decomposes every matrix. Negative: an exchanged pair of labels, which mirrors the cluster."""
    random = np.random.default_rng(4)
    reference = PLACES * [1.0, width, abs(thickness)] / [1.0, 1.0, 0.3]
    shown = reference[[1, 0, 2, 3, 4]] if thickness < 0 else reference
    turned = np.array([turn.apply(shown) for turn in Rotation.random(200, random_state=5)])
    points = turned + 0.5e-3 * random.standard_normal(turned.shape) + random.standard_normal((200, 1, 3))
    pose = fit_pose(reference, points)
    there = reference - reference.mean(axis=0)
    for rotation, residual, each in zip(pose.rotation, pose.residual, points, strict=True):
        least, _ = Rotation.align_vectors(each - each.mean(axis=0), there)
        missed = each - each.mean(axis=0) - least.apply(there)
        if np.linalg.svd(there, compute_uv=False)[1] > 5e-3:
            np.testing.assert_allclose(rotation, least.as_matrix(), atol=1e-11)
            assert residual == pytest.approx(np.sqrt(np.mean(np.sum(missed**2, axis=1))), rel=1e-9)
        else:
            assert np.isnan(rotation).all() and np.isnan(residual)
