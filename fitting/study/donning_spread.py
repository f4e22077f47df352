"""Relative spread of a quantity between donnings, common to all cuffs: an assessment draws the next donning from it."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from fitting.results.codes import FitOutcome
from fitting.study.cuff_study import DONNING, REPEAT, Observation, fit_model
from fitting.study.variance_components import Factor, MixedModel

LEAST_FREEDOM = 3.5  # degrees of freedom below which a spread is not used: 4, less the rounding of their estimate


class SpreadOutcome(StrEnum):
    """Outcome of the estimate.

    ESTIMATED      the spread can be used
    FEW_DONNINGS   fewer than 4 donnings more than cuffs
    UNRESOLVED     the noise of the fits hides it: fewer than 4 degrees of freedom, or zero
    NOT_CONVERGED  the REML iteration did not converge
    """

    ESTIMATED = "estimated"
    FEW_DONNINGS = "few_donnings"
    UNRESOLVED = "unresolved"
    NOT_CONVERGED = "not_converged"


@dataclass(frozen=True)
class DonningSpreadEstimate:
    """Standard deviation of the logarithm between donnings with its 95 % profile interval; NaN without an estimate.

    freedom   degrees of freedom of the variance: at most donnings less cuffs, fewer with noisy fits
    donnings  of cuffs that were donned more than once;  cuffs: of a volunteer each
    """

    outcome: SpreadOutcome
    donnings: int
    cuffs: int
    spread: float = math.nan
    ci95: tuple[float, float] = (math.nan, math.nan)
    freedom: float = math.nan


def estimate_donning_spread(measurements: Sequence[Observation]) -> DonningSpreadEstimate:
    """REML on logarithms, with a mean for every cuff of every volunteer, and the noise of the fits as known.

    Values that are not positive are left out. Of a single repeat in each donning, the spread includes that of repeats.
    """
    positive = [one for one in measurements if one.value > 0]
    donned = Counter(
        (volunteer, cuff) for volunteer, cuff, _ in {(m.volunteer, m.cuff, m.donning_key) for m in positive}
    )
    kept = [
        replace(one, value=math.log(one.value), noise=one.noise / one.value, shared=one.shared / one.value)
        for one in positive
        if donned[one.volunteer, one.cuff] > 1
    ]
    groups = Factor("cuff", [f"{one.volunteer} {one.cuff}" for one in kept])
    donnings = Factor(DONNING, [one.donning_key for one in kept])
    counted = DonningSpreadEstimate(SpreadOutcome.FEW_DONNINGS, donnings.levels, groups.levels)
    if donnings.levels - groups.levels < LEAST_FREEDOM:
        return counted
    model = fit_model(kept, [donnings, Factor(REPEAT, range(len(kept)))], groups.incidence())
    if model is None:
        return counted
    if model.outcome is not FitOutcome.CONVERGED:
        return replace(counted, outcome=SpreadOutcome.NOT_CONVERGED)
    return _estimate(model, counted)


def _estimate(model: MixedModel, counted: DonningSpreadEstimate) -> DonningSpreadEstimate:
    component = model.components[DONNING]
    freedom = 0.0
    if component.variance > 0:
        place = [found.name for found in model.estimated].index(DONNING)
        variance = float(model.theta_covariance()[place, place])
        freedom = min(2 * component.variance**2 / variance, counted.donnings - counted.cuffs)
    low, high = np.sqrt(np.maximum(component.ci95, 0.0)).tolist()
    return replace(
        counted,
        outcome=SpreadOutcome.ESTIMATED if freedom >= LEAST_FREEDOM else SpreadOutcome.UNRESOLVED,
        spread=math.sqrt(component.variance),
        ci95=(low, high),
        freedom=freedom,
    )
