"""assessment.json: every number as {"value", "ci95"}, its unit in the key; and the table of activations beside it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fitting.seal import Standing
from fitting.uncertainty import Estimate
from fitting.wearable_cuff import QUANTITIES, WearableCuff
from solver.suit.assessment import Assessment, EffortCurve, Quantity
from station.assessment.emg import MeasuredReduction

Plain = dict[str, Any]

ASSESSMENT_FILE, ACTIVATIONS_FILE = "assessment.json", "activations.csv"

CURVE_KEYS = {
    "to_slack": "optimum_to_slack_m",
    "cord_force": "largest_cord_force_n",
    "cord_force_lost": "cord_force_lost_to_migration",
    "cost_per_migration": "cost_per_arm_migration_per_m",
}
"""Field of Readings → key, for the numbers that stand beside the cost at the reference and the optimum."""


def plain_assessment(assessment: Assessment) -> Plain:
    """Numbers by arm cuff and condition; lists of numbers are one number each, {"value": […], "ci95": null}."""

    def by_cuff(entry: Callable[[EffortCurve], Any]) -> Plain:
        nested: Plain = {}
        for curve in assessment.curves:
            place = nested if curve.cuff is None else nested.setdefault(curve.cuff, {})
            place[curve.condition] = entry(curve)
        return nested

    return {
        "reference_rest_length_m": known(assessment.reference_rest_length),
        "at_rigid_optimum": by_cuff(lambda curve: _number(curve.figures["at_reference"])),
        "optimum": by_cuff(_optimum),
        **{key: by_cuff(lambda curve, name=name: _number(curve.figures[name])) for name, key in CURVE_KEYS.items()},  # type: ignore[misc]
        "bare_body_cost": known(assessment.bare_body_cost),
        "longest_cord_m": known(assessment.longest_cord),
        "muscle_reduction": by_cuff(
            lambda curve: {muscle: _number(figure) for muscle, figure in curve.reduction.items()}
        ),
        "comparisons": [
            {"cuffs": list(each.cuffs), "cost_difference": _number(each.cost_difference), "differ": each.differ}
            for each in assessment.comparisons
        ],
        "waist_cuff": assessment.waist_cuff,
        "rest_lengths_m": _list(assessment.rest_lengths),
        "cost": by_cuff(lambda curve: _list(curve.cost)),
        "reserve_cost": by_cuff(lambda curve: _list(curve.reserve_cost)),
        "uncertainty": _uncertainty(assessment),
        "frames": known(len(assessment.time)),
        "scenarios": known(assessment.scenarios),
        "unsolved": {
            "count": known(assessment.unsolved),
            "outcomes": {sentence: known(count) for sentence, count in assessment.outcomes.items()},
            "by_condition": by_cuff(lambda curve: known(curve.unsolved)),
        },
    }


def known(value: float) -> Plain:
    """A number that has no interval; null where it is not finite."""
    return {"value": value if np.isfinite(value) else None, "ci95": None}


def activations_table(assessment: Assessment) -> str:
    """CSV: condition, cuff, time, then a column per muscle, at the reference rest length; the slack cord first."""
    parts = [("slack", "", assessment.slack)]
    parts += [(curve.condition, curve.cuff or "", curve.activations) for curve in assessment.curves]
    lines = [",".join(["condition", "cuff", "time_s", *assessment.muscles])]
    for condition, cuff, activations in parts:
        for time, row in zip(assessment.time, activations, strict=True):
            lines.append(",".join([condition, cuff, f"{time:.10g}", *(f"{value:.6g}" for value in row)]))
    return "\n".join(lines) + "\n"


def plain_emg(measured: Sequence[MeasuredReduction]) -> list[Plain]:
    return [
        {"muscle": row.muscle, "reduction_percent": known(row.reduction_percent), "sd_percent": known(row.sd_percent)}
        for row in measured
    ]


def plain_cuffs(cuffs: Sequence[WearableCuff]) -> Plain:
    """What was worn, as it was measured; a figure that was given has no interval."""

    def number(estimate: Estimate | None) -> Plain:
        if estimate is None:
            return _number(Quantity(None))
        return _number(Quantity(estimate.value, estimate.ci95 if estimate.ci95[0] < estimate.ci95[1] else None))

    return {
        fit.name: {
            "site": fit.site,
            "origin": fit.origin,
            **{
                key: {**number(getattr(fit, name)), "source": Standing.BY_HAND if name in fit.given else "fit"}
                for name, key in QUANTITIES.items()
            },
            **_plain_assumed(fit),
        }
        for fit in cuffs
    }


def _plain_assumed(cuff: WearableCuff) -> Plain:
    """What was assumed to make the cuff wearable, in a sentence and by its codes."""
    if not cuff.assumed:
        return {}
    return {"assumed": "; ".join(map(str, cuff.assumed)), "assumed_codes": [note.code for note in cuff.assumed]}


def _optimum(curve: EffortCurve) -> Plain:
    return {
        "rest_length_m": _number(curve.figures["rest_length"]),
        "normalised_cost": _number(curve.figures["lowest_cost"]),
        "permissible_error_m": _number(curve.figures["permissible_error"]),
    }


def _uncertainty(assessment: Assessment) -> Plain | None:
    uncertainty = assessment.uncertainty
    if uncertainty is None:
        return None
    return {
        "draws": known(uncertainty.draws),
        "every_frame": known(uncertainty.every),
        "subsampling_difference": {
            "at_rigid_optimum": known(uncertainty.largest_difference["at_reference"]),
            "rest_length_m": known(uncertainty.largest_difference["rest_length"]),
            "normalised_cost": known(uncertainty.largest_difference["lowest_cost"]),
            "permissible_error_m": known(uncertainty.largest_difference["permissible_error"]),
        },
    }


def _number(figure: Quantity) -> Plain:
    return {"value": figure.value, "ci95": list(figure.ci95) if figure.ci95 else None}


def _list(values: NDArray[np.float64]) -> Plain:
    return {"value": [None if np.isnan(value) else float(value) for value in values], "ci95": None}
