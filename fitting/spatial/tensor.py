"""A symmetric 3 × 3 stiffness or damping: its entries, eigenvalues and axes with their errors, and when there is none.

Pulls along one direction know three of the six entries, along a plane five. So at least three directions that span
space are needed, by far more than sway turns a rope: numerically even one direction has full rank.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from fitting.errors import FitError
from fitting.outcome import FitOutcome
from fitting.uncertainty import NORMAL_95, Estimate

LEAST_SPREAD = 0.15
"""Third singular value of the unit vectors over the first from which directions count as spanning space."""
APART = 10.0
"""Degrees from which two pulls count as two directions."""
ENTRIES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
"""The order of the six entries in a covariance."""


class NoTensor(FitError):
    """The trials tell no tensor; one sentence says what is missing. outcome is that of an iteration that failed."""

    def __init__(self, sentence: str, outcome: FitOutcome | None = None) -> None:
        super().__init__(sentence)
        self.outcome = outcome


@dataclass(frozen=True)
class Tensor:
    """A symmetric tensor [N/m or N s/m] in the reference posture's frame of the donning.

    value       (3, 3)
    covariance  (6, 6) of ENTRIES
    factor      standard errors in half of a 95 % interval
    directions  pulls that were told apart
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
        return _errors(self.covariance)

    @property
    def ci95(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lower and upper ends (3, 3) of the entries' 95 % intervals."""
        half = self.factor * self.standard_error
        return self.value - half, self.value + half

    @property
    def eigenvalues(self) -> tuple[Estimate, ...]:
        """Three, smallest first, to first order in the entries' errors."""
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
        """(3, 3) unit vectors as rows, in the eigenvalues' order; the largest component is positive."""
        rows = np.linalg.eigh(self.value)[1].T
        signs = np.sign(rows[np.arange(3), np.argmax(np.abs(rows), axis=1)])
        return np.asarray(rows * signs[:, None])

    @property
    def axis_ci95(self) -> tuple[float, ...]:
        """Half the opening [rad] of the cone that holds each axis with 95 %; π/2 where its eigenvalue has a double."""
        values, axes = np.linalg.eigh(self.value)
        cones = []
        for i in range(3):
            others = [j for j in range(3) if j != i]
            pairs = [np.outer(axes[:, j], axes[:, i]) / (values[i] - values[j]) for j in others]
            slopes = np.array([entries_of((pair + pair.T) / 2) * _TWICE for pair in pairs])
            wide = float(np.linalg.eigvalsh(slopes @ self.covariance @ slopes.T)[-1])
            cones.append(min(math.pi / 2, self.factor / NORMAL_95 * math.sqrt(_CONE_95 * wide)))
        return tuple(cones)

    def scaled_error(self, relative: float) -> NDArray[np.float64]:
        """(6, 6) covariance that a relative error common to all entries adds."""
        return relative**2 * np.outer(entries_of(self.value), entries_of(self.value))

    def widened(self, causes: Mapping[str, NDArray[np.float64]]) -> Tensor:
        """With covariances (6, 6) by cause that the tensor did not hold; what it held is its "noise"."""
        parts = {"noise": self.covariance, **causes}
        return replace(self, covariance=np.sum(list(parts.values()), axis=0), parts=parts)


@dataclass(frozen=True)
class Tensors:
    """K and C of one donning in three dimensions; None where the sentences say why."""

    stiffness: Tensor | None
    damping: Tensor | None
    no_stiffness: str = ""
    no_damping: str = ""


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
    """(6, 3, 3): what each entry adds to the tensor."""
    return np.array([symmetric(row) for row in np.eye(6)])


def require_span(directions: NDArray[np.float64], what: str, test: str) -> int:
    """How many of the unit vectors (n, 3) differ. Raises NoTensor unless they span space."""
    kinds = _told_apart(directions)
    _, singular, rows = np.linalg.svd(kinds)
    spans = int(np.count_nonzero(singular > LEAST_SPREAD * singular[0]))
    if spans == 3:
        return len(kinds)
    where = {1: "along one line", 2: "in one plane"}[spans]
    missing = 3 - spans
    away = " and ".join("(" + ", ".join(f"{part:.2f}" for part in row) + ")" for row in rows[spans:])
    more = "one more direction" if missing == 1 else "two more directions"
    raise NoTensor(
        f"{what} in three dimensions needs pulls that span space, and the {test} trials pull {where} "
        f"({len(kinds)} direction{'s' if len(kinds) > 1 else ''}), which tells "
        f"{3 if spans == 1 else 5} of six entries; record {more}, 30° or more towards {away}"
    )


def require_positive(tensor: Tensor, what: str) -> Tensor:
    """The tensor. Raises NoTensor if an eigenvalue is not above 0 by its interval."""
    lowest = tensor.eigenvalues[0]
    if lowest.ci95[0] <= 0:
        raise NoTensor(
            f"{what} in three dimensions is not told: its smallest eigenvalue is {lowest.value:.0f} ± "
            f"{tensor.factor * lowest.standard_error:.0f}, expected above 0; pull farther apart or with more weight"
        )
    return tensor


def plain_tensor(tensor: Tensor | None, reason: str) -> dict[str, Any]:
    """For cuffs.json; value null and the reason where there is none."""
    if tensor is None:
        return {"value": None, "reason": reason}
    return {
        "value": tensor.value.tolist(),
        "standard_error": tensor.standard_error.tolist(),
        "ci95": [end.tolist() for end in tensor.ci95],
        "parts": {cause: _errors(covariance).tolist() for cause, covariance in tensor.parts.items()},
        "covariance": tensor.covariance.tolist(),
        "eigenvalues": [
            {"value": each.value, "standard_error": each.standard_error, "ci95": list(each.ci95)}
            for each in tensor.eigenvalues
        ],
        "axes": tensor.axes.tolist(),
        "axes_ci95_rad": list(tensor.axis_ci95),
        "directions": tensor.directions,
    }


def _errors(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Standard errors (3, 3) of entries with a covariance (6, 6)."""
    return symmetric(np.sqrt(np.diag(covariance)))


_TWICE = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])
_CONE_95 = float(stats.chi2.ppf(0.95, 2))


def _told_apart(directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """One of each kind: (kinds, 3), a kind being all within APART of its first, pulled forth or back."""
    kinds: list[NDArray[np.float64]] = []
    for each in directions:
        if not any(angle_between(each, kind) < APART for kind in kinds):
            kinds.append(each)
    return np.array(kinds)


def angle_between(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """Degrees between the lines of two unit vectors (3,)."""
    return math.degrees(math.acos(min(1.0, abs(float(one @ other)))))


def half_width_factor(inflation: float, dof: int) -> float:
    """Standard errors in half of a 95 % interval: Student's where the scatter itself had to tell the errors."""
    return float(stats.t.ppf(0.975, dof)) if inflation > 1 else NORMAL_95


def joined(blocks: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Columns of nuisance parameters, each block's its own, below each other."""
    rows, columns = (sum(block.shape[axis] for block in blocks) for axis in (0, 1))
    whole = np.zeros((rows, columns))
    row = column = 0
    for block in blocks:
        whole[row : row + block.shape[0], column : column + block.shape[1]] = block
        row, column = row + block.shape[0], column + block.shape[1]
    return whole
