"""Rigid pose of a cluster of markers in every frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MIN_ANCHOR_MARKERS = 3
MIN_ANCHOR_WIDTH = 5e-3
"""Second singular value [m] of the anchor cluster below which rotation about its line is not defined."""
NEWTON_STEPS, LEAST_RATIO = 2, 1e-3
"""Steps from a value that rounding moved by 1e-8 at most; least (s2 ± s3) / s1 of a matrix that is not decomposed."""


@dataclass(frozen=True)
class Pose:
    """p = R (reference − reference_centre) + centre, per frame; NaN if fewer than three markers were seen."""

    rotation: Array
    centre: Array
    reference_centre: Array
    residual: Array

    def to_reference(self, points: Array) -> Array:
        """Points (frames, points, 3) from the mocap frame to the frame of the body in its reference posture."""
        return np.asarray(
            np.einsum("fji,fpj->fpi", self.rotation, points - self.centre[:, None]) + self.reference_centre[:, None]
        )

    def to_laboratory(self, point: Array) -> Array:
        """A point (3,) of the body in its reference posture → (frames, 3) in the mocap frame."""
        return np.asarray(np.einsum("fij,fj->fi", self.rotation, point - self.reference_centre) + self.centre)


def fit_pose(reference: Array, points: Array) -> Pose:
    """Rigid pose, of least squares, of points (frames, markers, 3) [m] over the markers that are seen in a frame and in
    the reference (markers, 3) [m]; a marker that is not seen is NaN.
    """
    seen = is_seen(points) & is_seen(reference)
    weight = seen / np.maximum(seen.sum(axis=1), 1)[:, None]
    here = np.where(seen[..., None], points, 0.0)
    there = np.where(seen[..., None], reference, 0.0)
    centre = np.einsum("fm,fmi->fi", weight, here)
    reference_centre = np.einsum("fm,fmi->fi", weight, there)
    there = np.where(seen[..., None], there - reference_centre[:, None], 0.0)
    here = np.where(seen[..., None], here - centre[:, None], 0.0)
    rotation, width = _nearest_rotation(here.transpose(0, 2, 1) @ there)
    miss = here - there @ rotation.transpose(0, 2, 1)
    residual = np.sqrt(np.einsum("fm,fmi->f", weight, miss**2))
    # A coordinate frame needs three markers that are not collinear.
    is_frame = (seen.sum(axis=1) >= MIN_ANCHOR_MARKERS) & (width > MIN_ANCHOR_WIDTH**2)
    rotation = np.where(is_frame[:, None, None], rotation, np.nan)
    return Pose(rotation, centre, reference_centre, np.where(is_frame, residual, np.nan))


def _nearest_rotation(matrices: Array) -> tuple[Array, Array]:
    """Rotations R of most tr RᵀB for matrices B (n, 3, 3), and the middle one (n,) of their singular values s1 to s3.

    FOAM, in a few operations on all matrices at once (F. L. Markley, J. Astronaut. Sci. 41:261-280, 1993): λ is the
    largest root of (λ² − |B|²)² − 8 λ det B − 4 |adj B|² = 0, and is s1 + s2 ± s3 as det B is positive or negative.
    Rounding is magnified by s1 / (s2 ± s3): where that is large, R is from the singular value decomposition (Kabsch).
    """
    part = np.ascontiguousarray(matrices.transpose(1, 2, 0))
    cofactors, square = np.empty_like(part), np.empty_like(part)
    for i in range(3):
        low, high = part[(i + 1) % 3], part[(i + 2) % 3]
        for j in range(3):
            cofactors[i, j] = low[(j + 1) % 3] * high[(j + 2) % 3] - low[(j + 2) % 3] * high[(j + 1) % 3]
            square[i, j] = (part[:, i] * part[:, j]).sum(axis=0)
    determinant, sizes = (part[0] * cofactors[0]).sum(axis=0), (part**2).sum(axis=(0, 1))
    areas = (cofactors**2).sum(axis=(0, 1))
    with np.errstate(divide="ignore", invalid="ignore"):
        # s1² to s3² are the roots of x³ − |B|² x² + |adj B|² x − det² B = 0, by the cosine of a third of an angle.
        radius = np.sqrt(np.maximum(sizes**2 - 3 * areas, 0.0))
        cosine = (2 * sizes**3 - 9 * sizes * areas + 27 * determinant**2) / (2 * radius**3)
        angle = np.arccos(np.clip(cosine, -1.0, 1.0)) / 3
        longest, shortest = ((sizes + 2 * radius * np.cos(angle + turn)) / 3 for turn in (0.0, 2 * np.pi / 3))
        first, second = np.sqrt(longest), np.sqrt(np.maximum(sizes - longest - shortest, 0.0))
        third = determinant / (first * second)
        root = first + second + third
        for _ in range(NEWTON_STEPS):
            excess = root**2 - sizes
            root -= (excess**2 - 8 * root * determinant - 4 * areas) / (4 * (root * excess - 2 * determinant))
        sums = (root**2 - sizes) / 2
        cubes = (part[:, :, None] * square[None]).sum(axis=1)
        rotation = ((sums + sizes) * part + root * cofactors - cubes) / (sums * root - determinant)
        is_rough = ~((second + third) > LEAST_RATIO * first)
    rotations = rotation.transpose(2, 0, 1)
    left, values, right = np.linalg.svd(matrices[is_rough])
    left[:, :, 2] *= np.sign(np.linalg.det(left @ right))[:, None]
    rotations[is_rough], second[is_rough] = left @ right, values[:, 1]
    return rotations, second


def is_seen(points: Array) -> NDArray[np.bool_]:
    """Whether the points (..., 3) were seen: (...)."""
    is_finite = np.isfinite(points)
    return np.asarray(is_finite[..., 0] & is_finite[..., 1] & is_finite[..., 2])  # np.all takes three times as long
