"""A symmetric 3 × 3 stiffness or damping tensor: entries, eigenvalues and axes with their errors, and requirements.

Pulls along one direction determine three of the six entries, pulls in a plane five. So at least three directions that
span space are needed. The numerical rank does not show this, because sway rotates the rope slightly.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from documents.results import EqualByFields
from fitting.errors import CodedError
from fitting.pull.cuff_motion import APART, angle_between
from fitting.results.codes import TensorCode
from fitting.results.outcome import FitOutcome
from fitting.results.rendering import Figures
from fitting.uncertainty import NORMAL_95, Estimate, chi_square_limit, student_half_width

LEAST_SPREAD = 0.15
"""Least third singular value of the unit vectors, over the first, for directions that span space."""
ENTRIES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
"""The order of the six entries in a covariance."""


class NoTensor(CodedError):
    """The trials determine no tensor; outcome is that of an iteration that failed."""

    def __init__(self, code: TensorCode, figures: Figures | None = None, outcome: FitOutcome | None = None) -> None:
        super().__init__(code, figures)
        self.outcome = outcome


@dataclass(frozen=True, eq=False)
class Tensor(EqualByFields):
    """A symmetric tensor [N/m or N s/m] in the reference posture's frame of the donning.

    value       (3, 3)
    covariance  (6, 6) of ENTRIES
    factor      half width of a 95 % interval over the standard error
    directions  number of different directions of the pulls
    parts       covariances (6, 6) by cause ("noise", "lag", "gain", "posture") that add up to the whole
    """

    value: NDArray[np.float64]
    covariance: NDArray[np.float64]
    factor: float
    directions: int
    parts: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)

    @property
    def standard_error(self) -> NDArray[np.float64]:
        """(3, 3) of the entries."""
        return entry_errors(self.covariance)

    @property
    def ci95(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lower and upper ends (3, 3) of the entries' 95 % intervals."""
        half = self.factor * self.standard_error
        return self.value - half, self.value + half

    @property
    def eigenvalues(self) -> tuple[Estimate, ...]:
        """The three eigenvalues, smallest first, with errors to first order."""
        values, axes = np.linalg.eigh(self.value)
        found = []
        for value, axis in zip(values, axes.T, strict=True):
            slope = entries_of(np.outer(axis, axis)) * _TWICE
            error = math.sqrt(float(slope @ self.covariance @ slope))
            half = self.factor * error
            found.append(Estimate(float(value), error, (float(value) - half, float(value) + half)))
        return tuple(found)

    @property
    def axes(self) -> NDArray[np.float64]:
        """Unit vectors (3, 3) as rows, in the order of the eigenvalues; the largest component is positive."""
        rows = np.linalg.eigh(self.value)[1].T
        signs = np.sign(rows[np.arange(3), np.argmax(np.abs(rows), axis=1)])
        return np.asarray(rows * signs[:, None])

    @property
    def axis_ci95(self) -> tuple[float, ...]:
        """Half angle [rad] of the 95 % cone of every axis; π/2 if its eigenvalue is not distinct."""
        values, axes = np.linalg.eigh(self.value)
        cones = []
        for i in range(3):
            others = [j for j in range(3) if j != i]
            pairs = [np.outer(axes[:, j], axes[:, i]) / (values[i] - values[j]) for j in others]
            slopes = np.array([entries_of((pair + pair.T) / 2) * _TWICE for pair in pairs])
            largest = float(np.linalg.eigvalsh(slopes @ self.covariance @ slopes.T)[-1])
            cones.append(min(math.pi / 2, self.factor / NORMAL_95 * math.sqrt(chi_square_limit(2, 0.95) * largest)))
        return tuple(cones)

    def scaled_error(self, relative: float) -> NDArray[np.float64]:
        """Covariance (6, 6) due to a relative error common to all entries."""
        return relative**2 * np.outer(entries_of(self.value), entries_of(self.value))

    def widened(self, causes: Mapping[str, NDArray[np.float64]]) -> Tensor:
        """The tensor with additional covariances (6, 6) by cause; its own covariance becomes the part "noise"."""
        parts = {"noise": self.covariance, **causes}
        return replace(self, covariance=np.sum(list(parts.values()), axis=0), parts=parts)


def symmetric(entries: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, 3) of six entries."""
    matrix = np.zeros((3, 3))
    for (i, j), entry in zip(ENTRIES, entries, strict=True):
        matrix[i, j] = matrix[j, i] = entry
    return matrix


def entries_of(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """The six entries of a symmetric (3, 3)."""
    return np.array([matrix[i, j] for i, j in ENTRIES])


def unit_tensors() -> NDArray[np.float64]:
    """Basis (6, 3, 3) of symmetric tensors, in the order of ENTRIES."""
    return np.array([symmetric(row) for row in np.eye(6)])


def require_span(directions: NDArray[np.float64], quantity: str, test: str) -> int:
    """Number of different directions among unit vectors (n, 3). Raises NoTensor unless they span space."""
    kinds = _different_directions(directions)
    _, singular, rows = np.linalg.svd(kinds)
    spans = int(np.count_nonzero(singular > LEAST_SPREAD * singular[0]))
    if spans == 3:
        return len(kinds)
    missing = " and ".join("(" + ", ".join(f"{part:.2f}" for part in row) + ")" for row in rows[spans:])
    code = {1: TensorCode.ONE_LINE, 2: TensorCode.ONE_PLANE}[spans]
    raise NoTensor(code, {"quantity": quantity, "test": test, "directions": len(kinds), "missing": missing})


def require_positive(tensor: Tensor, quantity: str) -> Tensor:
    """The tensor. Raises NoTensor if the interval of an eigenvalue includes values below 0."""
    lowest = tensor.eigenvalues[0]
    if lowest.ci95[0] <= 0:
        half_width = tensor.factor * lowest.standard_error
        figures: Figures = {"quantity": quantity, "eigenvalue": lowest.value, "half_width": half_width}
        raise NoTensor(TensorCode.NOT_POSITIVE, figures)
    return tensor


def entry_errors(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Standard errors (3, 3) of entries with a covariance (6, 6)."""
    return symmetric(np.sqrt(np.diag(covariance)))


_TWICE = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])


def _different_directions(directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Different directions (kinds, 3): those within APART of the line of a previous one are left out."""
    kinds: list[NDArray[np.float64]] = []
    for direction in directions:
        if not any(angle_between(direction, kind) < APART for kind in kinds):
            kinds.append(direction)
    return np.array(kinds)


def half_width_factor(inflation: float, dof: int) -> float:
    """Half width of a 95 % interval over the standard error: Student's t if the error is from the scatter."""
    return student_half_width(dof) if inflation > 1 else NORMAL_95


def block_diagonal(blocks: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Block-diagonal matrix."""
    rows, columns = (sum(block.shape[axis] for block in blocks) for axis in (0, 1))
    whole = np.zeros((rows, columns))
    row = column = 0
    for block in blocks:
        whole[row : row + block.shape[0], column : column + block.shape[1]] = block
        row, column = row + block.shape[0], column + block.shape[1]
    return whole


def posture_error(tensor: NDArray[np.float64], anchor: NDArray[np.float64], anchor_rms: float) -> NDArray[np.float64]:
    """Covariance (6, 6) of a tensor (3, 3) due to noise of the reference posture, which rotates the tensor.

    anchor (markers, 3) [m] are the marker positions, NaN if not seen. anchor_rms [m] is the residual of the rigid fit,
    which has six degrees of freedom.

    A small rotation θ adds θ× T − T θ×. Its covariance is s² (Σ |r|² − r rᵀ)⁻¹ for anchor markers at r from their
    centre, with noise s of the single frame to which the others are aligned.
    """
    positions = anchor[np.isfinite(anchor).all(axis=1)]
    positions = positions - positions.mean(axis=0)
    count = len(positions)
    noise = anchor_rms**2 * 3 * count / max(3 * count - 6, 1) / 3
    inertia = np.sum(positions**2) * np.eye(3) - positions.T @ positions
    turns = [np.cross(np.eye(3), axis) for axis in -np.eye(3)]
    slopes = np.array([entries_of(turn @ tensor - tensor @ turn) for turn in turns]).T
    return np.asarray(slopes @ np.linalg.inv(inertia) @ slopes.T * noise)
