"""Total uncertainty as the plain data of assessment.json, and the drawn people as a table."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from solver.suit.quantity import Quantity
from solver.suit.readouts import FIGURES
from solver.suit.uncertainty import Place
from solver.uncertainty.cubes import CubesComparison
from solver.uncertainty.indices import SobolIndices
from solver.uncertainty.total import CostBand, TotalUncertainty
from station.assessment.assessment_json import CURVE_KEYS, known
from station.assessment.donning import DonningEntry, DonningSources
from station.assessment.number_entry import KnownNumberEntry, NumberEntry, StrictEntry

PEOPLE_FILE = "people.csv"
UNITS = {
    "at_reference": "effort_at_reference",
    "rest_length": "best_rest_length_m",
    "lowest_cost": "effort_at_best",
    "permissible_error": "permissible_error_m",
    "to_slack": "optimum_to_slack_m",
    "cord_force": "largest_cord_force_n",
    "cord_force_lost": "cord_force_lost_to_migration",
    "cost_per_arm_migration": "cost_per_arm_migration_per_m",
    "cost_per_waist_migration": "cost_per_waist_migration_per_m",
}
"""Field of CurveReadouts → column of people.csv."""

Plain = dict[str, Any]
Figures = Mapping[str, Quantity]


class GroupIndexEntry(StrictEntry):
    """Sobol indices of a group of sources: first order and total, each with its bootstrap interval."""

    first: NumberEntry
    total: NumberEntry


class IndicesEntry(StrictEntry):
    """Shares of the variance of a figure: of one arm cuff, or of the first less the second of two."""

    figure: str
    cuffs: list[str]
    variance: KnownNumberEntry
    blocks: KnownNumberEntry
    groups: dict[str, GroupIndexEntry]


class CostBandEntry(StrictEntry):
    """The effort at every one of rest_lengths_m, with its interval; null where too many people have none."""

    value: list[float | None]
    ci95: list[Annotated[list[float], Field(min_length=2, max_length=2)] | None]


class ExponentEntry(StrictEntry):
    """Change of a figure by an effort of cubes for the same people, and the share of the variance that the exponent
    explains if both are equally likely.
    """

    figure: str
    cuffs: list[str]
    change: KnownNumberEntry
    first: NumberEntry
    total: NumberEntry


class CubesEntry(StrictEntry):
    """People who were solved again with an effort of cubes; efforts are relative to that effort with a slack cord."""

    people: KnownNumberEntry
    solved: KnownNumberEntry
    at_rigid_optimum: dict[str, Any]
    optimum: dict[str, Any]
    changes: list[ExponentEntry] = Field(default_factory=list)


class TotalUncertaintyEntry(StrictEntry):
    """Figures with intervals of total uncertainty, under the keys of the figures with intervals of the fit only.

    people drawn, and solved in every condition; every N-th frame was solved for them
    """

    people: KnownNumberEntry
    seed: KnownNumberEntry | None = None
    solved: KnownNumberEntry
    every_frame: KnownNumberEntry
    at_rigid_optimum: dict[str, Any]
    optimum: dict[str, Any]
    optimum_to_slack_m: dict[str, Any]
    largest_cord_force_n: dict[str, Any]
    cord_force_lost_to_migration: dict[str, Any]
    cost_per_arm_migration_per_m: dict[str, Any]
    cost_per_waist_migration_per_m: dict[str, Any]
    muscle_reduction: dict[str, Any] = Field(default_factory=dict)
    cost: dict[str, dict[str, CostBandEntry]] = Field(default_factory=dict)
    indices: list[IndicesEntry] = Field(default_factory=list)
    cubes: CubesEntry | None = None
    donning: dict[str, DonningEntry] = Field(default_factory=dict)


def plain_total(total: TotalUncertainty, donning: DonningSources) -> Plain:
    """Numbers by arm cuff and condition, as in the rest of the file."""

    def numbers(name: str) -> Plain:
        return _by_place(total.figures, lambda figures: _number(figures[name]))

    return {
        "people": known(total.people),
        "seed": None if total.seed is None else known(total.seed),
        "solved": known(total.solved),
        "every_frame": known(total.every),
        "at_rigid_optimum": numbers("at_reference"),
        "optimum": _by_place(total.figures, _optimum),
        **{key: numbers(name) for name, key in CURVE_KEYS.items()},
        "muscle_reduction": _by_place(
            total.reduction, lambda reduction: {muscle: _number(figure) for muscle, figure in reduction.items()}
        ),
        "cost": {cuff: {condition: _band(band)} for (condition, cuff), band in total.bands.items() if cuff},
        "indices": [
            _indices(figure, cuffs, found) for (figure, cuffs), found in total.indices.items() if found is not None
        ],
        "cubes": None if total.cubes is None else _cubes(total.cubes),
        "donning": donning.plain(),
    }


def with_total_intervals(assessment: Mapping[str, Any]) -> Plain:
    """assessment.json with the intervals of total uncertainty where people were drawn, otherwise as it is."""
    total = assessment.get("total_uncertainty") or {}
    keys = ("at_rigid_optimum", "optimum", "muscle_reduction", *CURVE_KEYS.values())
    return {**assessment, **{key: total[key] for key in keys if total.get(key)}}


def people_table(total: TotalUncertainty) -> str:
    """CSV: person (0 is the assessed one, solved as the others are), condition, cuff, figures of the curve, outcome."""
    lines = [",".join(["person", "condition", "cuff", *(UNITS[name] for name in FIGURES), "outcome"])]
    for (condition, cuff), reading in total.readouts.items():
        for person, row in enumerate(zip(*(getattr(reading, name) for name in FIGURES), strict=True)):
            numbers = [f"{value:.8g}" for value in row]
            lines.append(",".join([str(person), condition, cuff or "", *numbers, str(reading.outcome[person])]))
    return "\n".join(lines) + "\n"


def _by_place(figures: Mapping[Place, Figures], entry: Callable[[Figures], Any]) -> Plain:
    """Entries by arm cuff and condition; those of rigid cuffs by the condition alone."""
    nested: Plain = {}
    for (condition, cuff), found in figures.items():
        parent = nested if cuff is None else nested.setdefault(cuff, {})
        parent[condition] = entry(found)
    return nested


def _cubes(cubes: CubesComparison) -> Plain:
    return {
        "people": known(cubes.people),
        "solved": known(cubes.solved),
        "at_rigid_optimum": _by_place(cubes.figures, lambda figures: _number(figures["at_reference"])),
        "optimum": _by_place(cubes.figures, _optimum),
        "changes": [
            {
                "figure": figure,
                "cuffs": list(cuffs),
                "change": _number(found.change),
                "first": _share(found.first),
                "total": _share(found.total),
            }
            for (figure, cuffs), found in cubes.changes.items()
            if found is not None
        ],
    }


def _share(value: float) -> Plain:
    return {"value": value if np.isfinite(value) else None, "ci95": None}


def _indices(figure: str, cuffs: tuple[str, ...], found: SobolIndices) -> Plain:
    def number(value: float, half_width: float) -> Plain:
        return {"value": float(value), "ci95": [float(value - half_width), float(value + half_width)]}

    rows = zip(found.groups, found.first, found.first_half_width, found.total, found.total_half_width, strict=True)
    return {
        "figure": figure,
        "cuffs": list(cuffs),
        "variance": known(found.variance),
        "blocks": known(found.blocks),
        "groups": {
            group: {"first": number(first, first_half), "total": number(total, total_half)}
            for group, first, first_half, total, total_half in rows
        },
    }


def _band(band: CostBand) -> Plain:
    ends = zip(band.low.tolist(), band.high.tolist(), strict=True)
    return {
        "value": [None if np.isnan(cost) else cost for cost in band.cost.tolist()],
        "ci95": [None if np.isnan(low) else [low, high] for low, high in ends],
    }


def _optimum(figures: Figures) -> Plain:
    return {
        "rest_length_m": _number(figures["rest_length"]),
        "normalised_cost": _number(figures["lowest_cost"]),
        "permissible_error_m": _number(figures["permissible_error"]),
    }


def _number(figure: Quantity) -> Plain:
    return {"value": figure.value, "ci95": list(figure.ci95) if figure.ci95 else None}
