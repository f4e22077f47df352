"""The results of an assessment in assessment.json, every number with its interval, and as the table activations.csv.

Outcomes of frames and muscles are sentences here.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Annotated, Any, Generic, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, WithJsonSchema

from documents.interval import counted
from fitting.cuffs.wearable_cuff import QUANTITIES, Cuff
from fitting.results.codes import Standing
from fitting.uncertainty import Estimate
from solver.model import Model
from solver.muscle import MuscleOutcome
from solver.redundancy.motion_solution import MotionSolution
from solver.redundancy.problem import FrameOutcome
from solver.suit.assessment import Assessment, EffortCurve
from solver.suit.quantity import Quantity

if TYPE_CHECKING:
    from solver.tendons.fiber import ElasticForces  # the compiler behind it takes long to import

IN_THE_GLENOID = " and keep the joint reaction inside the glenoid"
"""Further part of the sentence of an infeasible frame, with the glenoid constraint."""

FRAME_SENTENCES = {
    FrameOutcome.BEYOND_ACTIVATION_RATE: (
        "the muscles cannot change their activation fast enough since the last frame; solved without that limit"
    ),
    FrameOutcome.INFEASIBLE: (
        "no activations between 0 and 1 and controls within their limits give the accelerations" + IN_THE_GLENOID
    ),
    FrameOutcome.NOT_CONVERGED: "the solver stopped before its residuals were small; its last point is given",
    FrameOutcome.NOT_FINITE: "the model has no finite accelerations in this posture; the frame is left out",
}
MUSCLE_SENTENCES = {
    MuscleOutcome.PATH_NOT_CONVERGED: (
        "the path reached the limit of iterations, as in OpenSim, and its last point is used; compare with geodesics"
    ),
    MuscleOutcome.CURVE_NOT_CONVERGED: "the force did not converge on the curve of the fibre; its last point is used",
    MuscleOutcome.FIBER_NOT_CONVERGED: "fibre and elastic tendon did not come into balance; the last point is used",
}
UNSOLVED, UNCONVERGED = tuple(FRAME_SENTENCES), tuple(MUSCLE_SENTENCES)
ASSESSMENT_FILE, ACTIVATIONS_FILE = "assessment.json", "activations.csv"
CURVE_KEYS = {
    "to_slack": "optimum_to_slack_m",
    "cord_force": "largest_cord_force_n",
    "cord_force_lost": "cord_force_lost_to_migration",
    "cost_per_arm_migration": "cost_per_arm_migration_per_m",
    "cost_per_waist_migration": "cost_per_waist_migration_per_m",
}
"""Field of CurveReadouts → key, for the numbers other than the effort at the reference and the optimum."""
RIGID = "rigid"
Real = Annotated[int | float, WithJsonSchema({"type": "number"})]
"""A count stays a whole number in the file."""
Ends = Annotated[list[float], Field(strict=False, min_length=2, max_length=2)]


class StrictEntry(BaseModel):
    """An entry of a file of results, also from the attributes of a result; a number is not accepted as a text."""

    model_config = ConfigDict(strict=True, from_attributes=True)


class NumberEntry(StrictEntry):
    """A number with its 95 % interval; value is null where it is unknown."""

    value: Real | None
    ci95: Ends | None = None
    censored: Annotated[
        Literal["low", "high", "both"] | None,
        Field(description="end of ci95 that is a bound: it lies there or beyond, outside the rest lengths tried"),
    ] = None


class KnownNumberEntry(NumberEntry):
    """A number that is always known."""

    value: Real


class CountEntry(KnownNumberEntry):
    """A whole number, at least 0."""

    value: Annotated[int, Field(ge=0)]


class MeasuredReductionEntry(StrictEntry):
    """A measured reduction of muscle activity."""

    muscle: str
    reduction_percent: NumberEntry
    sd_percent: NumberEntry


class SeriesEntry(StrictEntry):
    """A number for every rest length; null where frames have no solution, or too many people have no interval."""

    value: Annotated[list[float | None], Field(min_length=1)]
    ci95: list[Ends | None] | None = None


class RestLengthsEntry(StrictEntry):
    """The rest lengths that were solved."""

    value: Annotated[list[float], Field(min_length=1)]
    ci95: None = None


class OptimumEntry(StrictEntry):
    """The best rest length, the effort there, and the width that keeps 90 % of the saving."""

    rest_length_m: NumberEntry
    normalised_cost: NumberEntry
    permissible_error_m: NumberEntry


Entry = TypeVar("Entry")


class CurveEntries(StrictEntry, Generic[Entry]):
    """An entry with rigid cuffs, and one with every arm cuff in every condition."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, dict[str, Entry]]

    rigid: Entry

    @property
    def arms(self) -> dict[str, dict[str, Entry]]:
        """Arm cuff → condition → entry."""
        return self.__pydantic_extra__

    def of(self, cuff: str, condition: str = "both") -> Entry:
        """The entry of an arm cuff, or of RIGID. Raises KeyError for a curve that was not solved."""
        return self.rigid if cuff == RIGID else self.arms[cuff][condition]


class UnsolvedEntry(StrictEntry):
    """Frames without a regular solution: their number, by outcome in outcome_codes, and by curve."""

    count: CountEntry
    outcomes: Annotated[dict[str, CountEntry], Field(description="outcome_codes in sentences")] = Field(
        default_factory=dict
    )
    outcome_codes: dict[str, CountEntry] = Field(default_factory=dict)
    by_condition: CurveEntries[CountEntry] | None = None


class EffortComparisonEntry(StrictEntry):
    """Effort at the reference rest length with the first arm cuff less that with the second."""

    cuffs: Annotated[list[str], Field(min_length=2, max_length=2)]
    cost_difference: NumberEntry
    differ: bool | None


class AssessedMotionEntry(StrictEntry):
    """The results for one motion."""

    reference_rest_length_m: KnownNumberEntry
    at_rigid_optimum: CurveEntries[NumberEntry]
    optimum: CurveEntries[OptimumEntry]
    optimum_to_slack_m: CurveEntries[NumberEntry]
    largest_cord_force_n: CurveEntries[NumberEntry]
    cord_force_lost_to_migration: CurveEntries[NumberEntry]
    cost_per_arm_migration_per_m: CurveEntries[NumberEntry]
    cost_per_waist_migration_per_m: CurveEntries[NumberEntry]
    bare_body_cost: NumberEntry
    longest_cord_m: NumberEntry
    muscle_reduction: CurveEntries[dict[str, NumberEntry]]
    comparisons: list[EffortComparisonEntry] = Field(default_factory=list)
    waist_cuff: str | None
    rest_lengths_m: RestLengthsEntry
    cost: CurveEntries[SeriesEntry]
    reserve_cost: CurveEntries[SeriesEntry] | None = None
    frames: CountEntry
    scenarios: CountEntry
    unsolved: UnsolvedEntry
    muscle_outcome_codes: dict[str, CountEntry] = Field(default_factory=dict)


class WornFigureEntry(NumberEntry):
    """A parameter of a worn cuff, with the origin of its value."""

    source: str


class WornCuffEntry(StrictEntry):
    """A worn cuff; assumed are the assumptions that were needed to wear it."""

    site: str
    origin: str | None = None
    stiffness_n_per_m: WornFigureEntry
    damping_n_s_per_m: WornFigureEntry
    migration_m: WornFigureEntry
    assumed: Annotated[str, Field(description="assumed_codes in sentences")] = ""
    assumed_codes: list[str] = Field(default_factory=list)


def motion_entries(assessment: Assessment) -> dict[str, Any]:
    """Fields of AssessedMotionEntry."""

    def by_curve(entry: Callable[[EffortCurve], object]) -> dict[str, Any]:
        nested: dict[str, Any] = {}
        for curve in assessment.curves:
            place = nested if curve.cuff is None else nested.setdefault(curve.cuff, {})
            place[curve.condition] = entry(curve)
        return nested

    return {
        "reference_rest_length_m": exact_number(assessment.reference_rest_length),
        "at_rigid_optimum": by_curve(lambda curve: number(curve.figures["at_reference"])),
        "optimum": by_curve(_optimum),
        **{key: by_curve(lambda curve, name=name: number(curve.figures[name])) for name, key in CURVE_KEYS.items()},  # type: ignore[misc]
        "bare_body_cost": finite(assessment.bare_body_cost),
        "longest_cord_m": finite(assessment.longest_cord),
        "muscle_reduction": by_curve(
            lambda curve: {muscle: number(figure) for muscle, figure in curve.reduction.items()}
        ),
        "comparisons": [
            EffortComparisonEntry(cuffs=list(one.cuffs), cost_difference=number(one.cost_difference), differ=one.differ)
            for one in assessment.comparisons
        ],
        "waist_cuff": assessment.waist_cuff,
        "rest_lengths_m": RestLengthsEntry(value=assessment.rest_lengths.tolist(), ci95=None),
        "cost": by_curve(_cost),
        "reserve_cost": by_curve(lambda curve: SeriesEntry(value=_nulls(curve.reserve_cost), ci95=None)),
        "frames": count(len(assessment.time)),
        "scenarios": count(assessment.scenarios),
        "unsolved": {
            "count": count(assessment.unsolved),
            "outcomes": {FRAME_SENTENCES[outcome]: count(found) for outcome, found in assessment.outcomes.items()},
            "outcome_codes": {outcome: count(found) for outcome, found in assessment.outcomes.items()},
            "by_condition": by_curve(lambda curve: count(curve.unsolved)),
        },
        "muscle_outcome_codes": {outcome: count(found) for outcome, found in assessment.muscle_outcomes.items()},
    }


def exact_number(value: float) -> KnownNumberEntry:
    """A number without an interval."""
    return KnownNumberEntry(value=value, ci95=None)


def count(value: int) -> CountEntry:
    """A count."""
    return CountEntry(value=value, ci95=None)


def finite(value: float) -> NumberEntry:
    """A number without an interval; null if it is not finite."""
    return NumberEntry(value=value if np.isfinite(value) else None, ci95=None)


def number(figure: Quantity) -> NumberEntry:
    """A figure of the assessment."""
    bound = {"censored": figure.censored.value} if figure.censored else {}
    return NumberEntry.model_validate({"value": figure.value, "ci95": figure.ci95, **bound})


def activations_table(assessment: Assessment) -> str:
    """CSV: condition, cuff, time, then a column per muscle, at the reference rest length; first with a slack cord."""
    parts = [("slack", "", assessment.slack)]
    parts += [(curve.condition, curve.cuff or "", curve.activations) for curve in assessment.curves]
    lines = [",".join(["condition", "cuff", "time_s", *assessment.muscles])]
    for condition, cuff, activations in parts:
        for time, row in zip(assessment.time, activations, strict=True):
            lines.append(",".join([condition, cuff, f"{time:.10g}", *(f"{value:.6g}" for value in row)]))
    return "\n".join(lines) + "\n"


def cuff_entries(cuffs: Sequence[Cuff]) -> dict[str, WornCuffEntry]:
    """Parameters of the cuffs; a figure that was given by hand has no interval."""
    entries = {}
    for cuff in cuffs:
        values = {key: _quantity(cuff, name) for name, key in QUANTITIES.items()}
        entry: dict[str, object] = {"site": cuff.site, "origin": cuff.origin, **values}
        if cuff.assumed:
            entry |= {"assumed": "; ".join(map(str, cuff.assumed)), "assumed_codes": [one.code for one in cuff.assumed]}
        entries[cuff.name] = WornCuffEntry.model_validate(entry)
    return entries


def _quantity(cuff: Cuff, name: str) -> WornFigureEntry:
    estimate: Estimate | None = getattr(cuff, name)
    value, ends = (None, None) if estimate is None else (estimate.value, estimate.ci95)
    ci95 = list(ends) if ends and ends[0] < ends[1] else None
    return WornFigureEntry(value=value, ci95=ci95, source=Standing.BY_HAND if name in cuff.given else "fit")


def _optimum(curve: EffortCurve) -> OptimumEntry:
    return OptimumEntry(
        rest_length_m=number(curve.figures["rest_length"]),
        normalised_cost=number(curve.figures["lowest_cost"]),
        permissible_error_m=number(curve.figures["permissible_error"]),
    )


def _cost(curve: EffortCurve) -> SeriesEntry:
    ends = None if curve.cost_ci95 is None else curve.cost_ci95.tolist()
    bands = None if ends is None else [None if np.isnan(pair).any() else pair for pair in ends]
    return SeriesEntry(value=_nulls(curve.cost), ci95=bands)


def _nulls(values: NDArray[np.float64]) -> list[float | None]:
    return [None if np.isnan(value) else float(value) for value in values]


def describe_unsolved(solution: MotionSolution) -> list[str]:
    """A sentence for each outcome of frames that are not solved; of infeasible ones, with the smallest violation."""
    sentences = []
    for outcome in UNSOLVED:
        frames = [index for index, found in enumerate(solution.outcomes) if found is outcome]
        if not frames:
            continue
        has_glenoid = bool(np.isfinite(solution.cone_slack[frames]).any())  # infinite where it was not asked for
        meaning = FRAME_SENTENCES[outcome] if has_glenoid else FRAME_SENTENCES[outcome].replace(IN_THE_GLENOID, "")
        if outcome is FrameOutcome.INFEASIBLE:
            meaning += _violation(solution, frames, has_glenoid=has_glenoid)
        sentences.append(f"{_count(solution, frames)}: {meaning}")
    return sentences


def describe_unconverged(solution: MotionSolution) -> list[str]:
    """A sentence for each outcome of muscles that did not converge, with their names."""
    sentences = []
    for outcome in UNCONVERGED:
        frames = np.flatnonzero(solution.frames_with(outcome)).tolist()
        if frames:
            names = ", ".join(muscles_with(solution, outcome))
            sentences.append(f"{_count(solution, frames)}, {names}: {MUSCLE_SENTENCES[outcome]} ({outcome})")
    return sentences


def note_unconverged(solution: MotionSolution) -> str:
    """For a table: each code with its number of frames and its muscles; "converged" where there is none."""
    notes = [
        f"{outcome} in {counted(solution.frames_with(outcome).sum(), 'frame')} of "
        f"{' '.join(muscles_with(solution, outcome))}"
        for outcome in UNCONVERGED
        if solution.frames_with(outcome).any()
    ]
    return "; ".join(notes) or MuscleOutcome.CONVERGED


def describe_tendons(model: Model, fibers: ElasticForces | None) -> str:
    """Elastic tendons with their strain, and fibres held at their least length."""
    if fibers is None:
        return "rigid"
    tendons = [model.muscles[index].tendon for index in fibers.elastic]
    strains = sorted({tendon.strain for tendon in tendons if tendon is not None})
    described = (
        f"elastic in {len(tendons)} of {counted(len(model.muscles), 'muscle')}, strain at the greatest isometric force "
        f"{' to '.join(f'{strain:g}' for strain in strains[:1] + strains[1:][-1:])}"
    )
    held = np.flatnonzero(fibers.is_shortest.any(axis=0))
    if not len(held):
        return described
    names = " ".join(model.muscle_names[index] for index in held)
    frames = int(fibers.is_shortest.any(axis=1).sum())
    return f"{described}; fibre held at its least length in {counted(frames, 'frame')} of {names}"


def muscles_with(solution: MotionSolution, outcome: MuscleOutcome) -> list[str]:
    """Names of the muscles that ended so in any frame."""
    is_ended_so = (solution.muscle_outcomes == outcome).any(axis=0)
    return [name for name, is_named in zip(solution.muscles, is_ended_so, strict=True) if is_named]


def _count(solution: MotionSolution, frames: list[int]) -> str:
    return f"{len(frames)} of {counted(len(solution.time), 'frame')}, the first at {solution.time[frames[0]]:g} s"


def _violation(solution: MotionSolution, frames: list[int], *, has_glenoid: bool) -> str:
    known = [frame for frame in frames if np.isfinite(solution.equality_residual[frame])]
    if not known:  # Clarabel stopped at a point that is not finite
        return ""
    outside = np.maximum(-solution.cone_slack[known], 0.0)
    leaves = f"leaves it by up to {outside.max():.3g} N and " if has_glenoid else ""
    worst = max(known, key=lambda frame: float(solution.equality_residual[frame]))
    missed, coordinate = solution.equality_residual[worst], solution.residual_coordinates[worst]
    return (
        f"; the smallest violation {leaves}misses accelerations by up to {missed:.3g} rad/s² or m/s², "
        f"the most that of {coordinate}"
    )
