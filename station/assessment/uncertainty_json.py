"""Drawn people in assessment.json: what its intervals are from; and the people as a table."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field

from solver.suit.assessment import UncertaintySummary
from solver.suit.quantity import TAIL
from solver.suit.readouts import FIGURES
from solver.uncertainty.indices import SobolIndices
from solver.uncertainty.sources import Group
from solver.uncertainty.total import DrawnPeople
from station.assessment.assessment_json import known
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


class UncertaintyEntry(StrictEntry):
    """Where the intervals are from: the number of people drawn, of those solved in every condition, in every N-th
    frame, and of those left out because their muscles cannot do the motion. content is the part of all people inside
    an interval, with the bounds that so many people give.
    """

    people: KnownNumberEntry
    seed: KnownNumberEntry
    solved: KnownNumberEntry
    infeasible: KnownNumberEntry
    every_frame: KnownNumberEntry
    sources: Annotated[list[Group], Field(min_length=1)]
    content: KnownNumberEntry
    subsampling_difference: dict[str, NumberEntry]
    index_blocks: KnownNumberEntry
    indices: list[IndicesEntry] = Field(default_factory=list)
    donning: dict[str, DonningEntry] = Field(default_factory=dict)


def plain_uncertainty(summary: UncertaintySummary, people: DrawnPeople, donning: DonningSources | None) -> Plain:
    """The block "uncertainty" of the file."""
    difference = summary.largest_difference
    return {
        "people": known(summary.people),
        "seed": known(people.seed),
        "solved": known(summary.solved),
        "infeasible": known(summary.infeasible),
        "every_frame": known(summary.every),
        "sources": list(summary.sources),
        "content": {"value": 1 - 2 * TAIL, "ci95": list(summary.content)},
        "subsampling_difference": {
            "at_rigid_optimum": known(difference["at_reference"]),
            "rest_length_m": known(difference["rest_length"]),
            "normalised_cost": known(difference["lowest_cost"]),
            "permissible_error_m": known(difference["permissible_error"]),
        },
        "index_blocks": known(people.index_blocks),
        "indices": [
            _indices(figure, cuffs, found) for (figure, cuffs), found in people.indices.items() if found is not None
        ],
        "donning": {} if donning is None else donning.plain(),
    }


def people_table(people: DrawnPeople) -> str:
    """CSV: person (0 is the assessed one, solved as the others are), condition, cuff, figures of the curve, outcome."""
    lines = [",".join(["person", "condition", "cuff", *(UNITS[name] for name in FIGURES), "outcome"])]
    for (condition, cuff), reading in people.readouts.items():
        for person, row in enumerate(zip(*(getattr(reading, name) for name in FIGURES), strict=True)):
            numbers = [f"{value:.8g}" for value in row]
            lines.append(",".join([str(person), condition, cuff or "", *numbers, str(reading.outcome[person])]))
    return "\n".join(lines) + "\n"


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
