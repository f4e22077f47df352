"""Centres of joints for marker sets that show only some of the landmarks: by regression, and from a motion.

Regression is for the glenohumeral joint: from five landmarks of the scapula (Meskers et al. 1998, J. Biomech. 31:93),
with 2.3 to 3.0 mm (RMS) along each axis on 36 cadavers; or from both acromions and the thorax alone (Rab, Petuskey,
Bagley 2002, Gait Posture 15:113), for marker sets without a scapula and arms that hang. Functional methods are for any
ball joint that moves enough: SCoRE (Ehrig et al. 2006, J. Biomech. 39:2798) and the closed form of Gamage and Lasenby
(2002, J. Biomech. 35:87). In five patients with a prosthesis, SCoRE was 21 mm and the helical axis 15 mm from the
centre in CT (2011, PLoS ONE 6:e18488).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.errors import SolverCode, SolverError

Array = NDArray[np.float64]

LANDMARKS = ("AC", "PC", "AA", "TS", "AI")
THORAX = ("IJ", "PX", "C7", "T8")
BELOW_ACROMION = 0.17
"""Depth of the centre below the acromion, in distances between the acromions."""
LEAST_MOTION = 0.05
"""Smallest singular value of the equations over the largest. Below it the segments hardly turn against each other about
some axis, and the centre along it is noise.
"""
LEAST_MARKERS = 3


class JointCentreError(SolverError):
    """Markers that do not determine a centre; the message has the reason."""

    general_code = SolverCode.NO_JOINT_CENTRE


@dataclass(frozen=True, eq=False)
class JointCentre:
    """A centre in two segments, each in the frame of its reference markers [m].

    in_proximal, in_distal  (3,);  in_ground (frames, 3) mean of the estimates of both segments
    residual                RMS distance of the two [m];  conditioning  smallest over largest singular value
    """

    in_proximal: Array
    in_distal: Array
    in_ground: Array
    residual: float
    conditioning: float


def regression_glenohumeral_centre(landmarks: Mapping[str, Array]) -> Array:
    """Centre of the humeral head (…, 3) [m] of a right shoulder, from AC, PC, AA, TS and AI (…, 3) [m].

    The frame is that of the source: origin AC, x from TS to AC, z backward off the plane of AC, TS and AI. Raises
    JointCentreError for a landmark that is missing.
    """
    ac, pc, aa, ts, ai = (1e3 * point for point in _points(landmarks, LANDMARKS))
    x = _unit(ac - ts)
    z = _unit(np.cross(x, ac - ai))
    axes = np.stack([x, np.cross(z, x), z], axis=-1)
    pc_local, ai_local = (np.einsum("...ji,...j->...i", axes, point - ac) for point in (pc, ai))
    apart = {name: np.linalg.norm(one - two, axis=-1) for name, one, two in _pairs(ac, pc, aa, ts, ai)}
    local = np.stack(
        [
            18.9743
            + 0.2434 * pc_local[..., 0]
            + 0.2341 * ai_local[..., 0]
            + 0.1590 * apart["AI AA"]
            + 0.0558 * pc_local[..., 1],
            -3.8791
            - 0.1002 * apart["AC PC"]
            + 0.1732 * pc_local[..., 1]
            - 0.3940 * apart["AC AA"]
            + 0.1205 * ai_local[..., 0],
            9.2629 - 0.2403 * pc_local[..., 1] + 1.0255 * pc_local[..., 2] + 0.1720 * apart["TS PC"],
        ],
        axis=-1,
    )
    centre: Array = 1e-3 * (ac + np.einsum("...ij,...j->...i", axes, local))
    return centre


def glenohumeral_centre_below_acromion(landmarks: Mapping[str, Array], acromions: tuple[str, str]) -> Array:
    """Centre of the humeral head (…, 3) [m] below the first of both acromions, along the axis of the thorax (Wu et al.
    2005) from IJ, PX, C7 and T8; landmarks (…, 3) [m], the arms hanging. Of either side.

    The source has 17 % of the distance between the acromions. Raises JointCentreError for a landmark that is missing.
    """
    own, other, ij, px, c7, t8 = _points(landmarks, (*acromions, *THORAX))
    depth = BELOW_ACROMION * np.linalg.norm(own - other, axis=-1, keepdims=True)
    centre: Array = own - depth * _unit((ij + c7) - (px + t8))
    return centre


def functional_centre(proximal: Array, distal: Array) -> JointCentre:
    """Centre of rotation between two segments by SCoRE: the two points, one in each, that stay nearest to each other.

    proximal, distal (frames, markers, 3) [m] of at least three markers each; frames with a hidden one do not count.
    Raises JointCentreError for too few markers, or a motion that does not determine the centre.
    """
    poses = [_poses(markers) for markers in (proximal, distal)]
    is_seen = np.isfinite(poses[0][1]).all(axis=1) & np.isfinite(poses[1][1]).all(axis=1)
    (rotation, origin), (turned, moved) = ((turn[is_seen], at[is_seen]) for turn, at in poses)
    if len(rotation) < LEAST_MARKERS:
        raise JointCentreError(
            f"a centre of rotation needs at least {LEAST_MARKERS} frames with all markers",
            SolverCode.CENTRE_TOO_FEW_FRAMES,
        )
    matrix = np.concatenate([rotation, -turned], axis=2).reshape(-1, 6)
    solved, _, _, singular = np.linalg.lstsq(matrix, (moved - origin).reshape(-1), rcond=None)
    conditioning = float(singular[-1] / singular[0])
    if conditioning < LEAST_MOTION:
        raise JointCentreError(
            "the segments turn too little relative to each other to determine their centre of rotation: "
            f"conditioning {conditioning:.3f}, at least {LEAST_MOTION}; record circumduction, flexion and abduction",
            SolverCode.CENTRE_TOO_LITTLE_MOTION,
        )
    one = origin + rotation @ solved[:3]
    two = moved + turned @ solved[3:]
    in_ground = np.full(poses[0][1].shape, np.nan)
    in_ground[is_seen] = 0.5 * (one + two)
    residual = float(np.sqrt(np.mean(np.sum((one - two) ** 2, axis=1))))
    return JointCentre(solved[:3], solved[3:], in_ground, residual, conditioning)


def sphere_centre(points: Array) -> Array:
    """Common centre (3,) [m] of the spheres on which points (frames, markers, 3) [m] of the other segment move.

    Closed form of Gamage and Lasenby: A c = b with A = 2 Σ_markers (⟨v vᵀ⟩ − ⟨v⟩⟨v⟩ᵀ), b = Σ (⟨v³⟩ − ⟨v⟩⟨v²⟩).
    """
    seen = points[np.isfinite(points).all(axis=(1, 2))]
    if len(seen) < LEAST_MARKERS:
        raise JointCentreError(
            f"a centre of rotation needs at least {LEAST_MARKERS} frames with all markers",
            SolverCode.CENTRE_TOO_FEW_FRAMES,
        )
    mean = seen.mean(axis=0)
    away = seen - mean
    square = np.sum(away**2, axis=2)
    matrix = 2.0 * np.einsum("fmi,fmj->ij", away, away) / len(seen)
    vector = np.einsum("fmi,fm->mi", away, square).sum(axis=0) / len(seen)
    # About each marker's mean the equations are exact for its own centre; together they need the means back.
    shift = 2.0 * np.einsum("fmi,fmj,mj->i", away, away, mean) / len(seen)
    values = np.linalg.eigvalsh(matrix)
    if values[0] < LEAST_MOTION**2 * values[-1]:
        raise JointCentreError(
            "the markers stay too close to a plane or a line to determine the centre of their spheres",
            SolverCode.CENTRE_TOO_LITTLE_MOTION,
        )
    centre: Array = np.linalg.solve(matrix, vector + shift)
    return centre


def in_segment(markers: Array, points: Array) -> Array:
    """points (frames, points, 3) in the frame of a segment's markers (frames, markers, 3), both in ground [m]."""
    rotation, origin = _poses(markers)
    local: Array = np.einsum("fji,fpj->fpi", rotation, points - origin[:, None])
    return local


def _poses(markers: Array) -> tuple[Array, Array]:
    """Rotation (frames, 3, 3) and origin (frames, 3) of a segment, NaN where a marker is hidden: least squares on the
    mean shape of its markers (Söderkvist and Wedin 1993, J. Biomech. 26:1473), in the frame of the first whole one.
    """
    if markers.ndim != 3 or markers.shape[1] < LEAST_MARKERS:
        raise JointCentreError(
            f"a segment needs at least {LEAST_MARKERS} markers for its pose", SolverCode.CENTRE_TOO_FEW_MARKERS
        )
    is_seen = np.isfinite(markers).all(axis=(1, 2))
    rotation, origin = np.full((len(markers), 3, 3), np.nan), np.full((len(markers), 3), np.nan)
    if not is_seen.any():
        return rotation, origin
    seen = markers[is_seen]
    shape = seen[0] - seen[0].mean(axis=0)
    for _ in range(2):  # the first frame's shape has its noise; the mean of all, turned back, has less
        turned = _rotations(shape, seen)
        shape = np.einsum("fji,fmj->fmi", turned, seen - seen.mean(axis=1, keepdims=True)).mean(axis=0)
    rotation[is_seen] = _rotations(shape, seen)
    origin[is_seen] = seen.mean(axis=1)
    return rotation, origin


def _rotations(shape: Array, seen: Array) -> Array:
    """(frames, 3, 3) that turn the shape (markers, 3) nearest to the markers (frames, markers, 3)."""
    centred = seen - seen.mean(axis=1, keepdims=True)
    left, _, right = np.linalg.svd(np.einsum("fmi,mj->fij", centred, shape))
    sign = np.ones((len(seen), 3))
    sign[:, 2] = np.linalg.det(left @ right)
    rotations: Array = (left * sign[:, None]) @ right
    return rotations


def _points(landmarks: Mapping[str, Array], names: Sequence[str]) -> list[Array]:
    missing = [name for name in names if name not in landmarks]
    if missing:
        raise JointCentreError(
            f"the regression of the glenohumeral centre needs {', '.join(missing)}; point them in",
            SolverCode.CENTRE_MISSING_LANDMARK,
        )
    return [np.asarray(landmarks[name], dtype=np.float64) for name in names]


def _pairs(ac: Array, pc: Array, aa: Array, ts: Array, ai: Array) -> list[tuple[str, Array, Array]]:
    return [("AI AA", ai, aa), ("AC PC", ac, pc), ("AC AA", ac, aa), ("TS PC", ts, pc)]


def _unit(vector: Array) -> Array:
    unit: Array = vector / np.linalg.norm(vector, axis=-1, keepdims=True)
    return unit
