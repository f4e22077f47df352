"""Rules that choose among variants of the joint force in one direction of lift, judged in the other.

A rule gives weights to variants from their errors in the lifts that it sees; the force predicted in the lift that it
does not see is the weighted mean of their forces.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from benchmarks.joint_force_variants import ContactVariant, Lift

Array = NDArray[np.float64]
Rule = Callable[[Array, Array], Array]
"""Weights (variants,) from errors (variants, repeats seen) [%] and numbers of changes from the published circle."""

BEST_SHARE = 0.05
LIKELY_ERROR = 10.0  # % of body weight, standard deviation of the force of a good variant
CHANGE_COST = 1.0  # % of body weight


@dataclass(frozen=True, eq=False)
class Predictions:
    """Forces of variants in lifts: of each lift (variants, frames) [N]; errors (variants, repeats of all lifts) [%]."""

    lifts: Sequence[Lift]
    variants: Sequence[ContactVariant]
    forces: Sequence[Array]
    errors: Array

    @property
    def changes(self) -> Array:
        """Number of assumptions (variants,) in which a variant differs from the published circle."""
        names = [field.name for field in fields(ContactVariant)]
        published = ContactVariant()
        found = [sum(getattr(v, name) != getattr(published, name) for name in names) for v in self.variants]
        return np.array(found, dtype=float)

    def mean_errors(self, weights: Array) -> Array:
        """RMSE of the weighted mean force in every repeat (repeats,) [%]."""
        is_used = weights > 0
        shares = weights[is_used] / weights.sum()
        pairs = zip(self.lifts, self.forces, strict=True)
        return np.concatenate([lift.errors_of(shares @ force[is_used]) for lift, force in pairs])

    def bias_correlation(self) -> float:
        """Between the first two lifts, over the variants: r of the mean signed errors of the force."""
        sizes = zip(self.lifts[:2], self.forces[:2], strict=True)
        biases = [np.nanmean(force - lift.measured, axis=1) for lift, force in sizes]
        return float(np.corrcoef(biases)[0, 1])

    def transferred_errors(self, rule: Rule) -> Array:
        """RMSE in every repeat (repeats,) [%] with the weights that the rule gives from the other lifts."""
        lift = np.repeat(np.arange(len(self.lifts)), [len(lift.repeats) for lift in self.lifts])
        found = np.empty(len(lift))
        for place in np.unique(lift):
            weights = rule(self.errors[:, lift != place], self.changes)
            found[lift == place] = self.mean_errors(weights)[lift == place]
        return found


def predictions(lifts: Sequence[Lift], variants: Sequence[ContactVariant]) -> Predictions:
    """Solve all lifts in all variants; best in an order in which neighbours share a body."""
    forces = [[lift.predicted(variant) for lift in lifts] for variant in variants]
    per_lift = [np.array(column) for column in zip(*forces, strict=True)]
    errors = [np.concatenate([lift.errors_of(force) for lift, force in zip(lifts, row, strict=True)]) for row in forces]
    return Predictions(lifts, variants, per_lift, np.array(errors))


def choose_best(errors: Array, _changes: Array) -> Array:
    """The variant of least mean error."""
    return _only(int(errors.mean(axis=1).argmin()), len(errors))


def choose_best_share(errors: Array, _changes: Array) -> Array:
    """The best BEST_SHARE of the variants alike, at least one."""
    means = errors.mean(axis=1)
    return (means <= np.sort(means)[max(int(BEST_SHARE * len(means)), 1) - 1]).astype(float)


def weight_by_likelihood(errors: Array, _changes: Array) -> Array:
    """exp(−½ Σ (error / LIKELY_ERROR)²): a repeat counts as one observation, since errors within it are correlated."""
    squares = ((errors / LIKELY_ERROR) ** 2).sum(axis=1)
    weights: Array = np.exp(-0.5 * (squares - squares.min()))
    return weights


def choose_fewest_changes(errors: Array, changes: Array) -> Array:
    """One-standard-error rule: the fewest changes among variants within one standard error of the best."""
    means = errors.mean(axis=1)
    best = int(means.argmin())
    limit = means[best] + errors[best].std(ddof=1) / np.sqrt(errors.shape[1])
    within = np.flatnonzero(means <= limit)
    order = np.lexsort((means[within], changes[within]))
    return _only(int(within[order[0]]), len(errors))


def choose_penalised(errors: Array, changes: Array) -> Array:
    """Least mean error plus CHANGE_COST for each change."""
    return _only(int((errors.mean(axis=1) + CHANGE_COST * changes).argmin()), len(errors))


def weight_equally(errors: Array, _changes: Array) -> Array:
    """All variants alike: nothing is chosen."""
    return np.ones(len(errors))


RULES: Mapping[str, Rule] = {
    "the best": choose_best,
    f"mean force of the best {BEST_SHARE:.0%}": choose_best_share,
    "mean force, weights by likelihood": weight_by_likelihood,
    "fewest changes within one standard error": choose_fewest_changes,
    f"{CHANGE_COST:g} % a change": choose_penalised,
    "mean force of all, no choice": weight_equally,
}


def _only(place: int, count: int) -> Array:
    weights = np.zeros(count)
    weights[place] = 1.0
    return weights
