"""The schema of assessment.json, which checks what is written and read; published in docs/schemas."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field, TypeAdapter, ValidationError

from documents.message import Message, because
from documents.plain_data import PlainDataError, read_json, shortened
from documents.regular_file import open_regular
from documents.validation import describe_error
from station.assessment.assessment_json import KnownNumberEntry, MeasuredReductionEntry, NumberEntry, StrictEntry
from station.assessment.drawn_postures import PostureEntry
from station.assessment.study_comparison import StudyComparisonEntry
from station.assessment.uncertainty_json import DecisionEntry, UncertaintyEntry
from station.errors import StationError
from station.messages.assessment_messages import AssessmentCode, AssessmentFileCode
from station.subject.subject_document import SubjectDocument

if TYPE_CHECKING:
    import pandas as pd

RIGID = "rigid"
FORMAT: Literal[1] = 1
"""It rises where a key changes its meaning, not where one is added."""
SHOWN: Literal["both"] = "both"
"""The condition that is drawn for every arm cuff."""


class AssessmentFileError(StationError):
    """An assessment.json or activations.csv that cannot be used."""


def read_activations(path: Path) -> pd.DataFrame:
    """activations.csv. Raises AssessmentFileError for a table that is incomplete, or another one."""
    import pandas as pd

    try:
        with open_regular(path) as file:
            table = pd.read_csv(file, keep_default_na=False, na_values=["nan"])
    except (OSError, ValueError) as error:
        raise _refusal(AssessmentFileCode.ACTIVATIONS_UNREADABLE, path, **because(error)) from error
    muscles = list(table.columns[3:])
    if list(table.columns[:3]) != ["condition", "cuff", "time_s"] or not muscles:
        found = shortened(", ".join(map(str, table.columns)))
        raise _refusal(AssessmentFileCode.ACTIVATIONS_COLUMNS, path, found=found)
    for name in ("time_s", *muscles):
        if not pd.api.types.is_numeric_dtype(table[name]):
            raise _refusal(AssessmentFileCode.ACTIVATIONS_NOT_NUMBERS, path, column=name)
    return table


class SeriesEntry(StrictEntry):
    """A number for every rest length; null where frames have no solution, or too many people have no interval."""

    value: Annotated[list[float | None], Field(min_length=1)]
    ci95: list[Annotated[list[float], Field(min_length=2, max_length=2)] | None] | None = None


class RestLengthsEntry(StrictEntry):
    """The rest lengths that were solved."""

    value: Annotated[list[float], Field(min_length=1)]


class OptimumEntry(StrictEntry):
    """The best rest length, the effort there, and the width that keeps 90 % of the saving."""

    rest_length_m: NumberEntry
    normalised_cost: NumberEntry
    permissible_error_m: NumberEntry


class UnsolvedEntry(StrictEntry):
    """Frames without a regular solution: their number, and by outcome in outcome_codes."""

    count: KnownNumberEntry
    outcome_codes: dict[str, KnownNumberEntry] = Field(default_factory=dict)


class AssessmentInputsEntry(StrictEntry):
    """Names of the input files, with their SHA-256."""

    model: str
    motion: str
    suit: str
    cuffs: str
    subject: str | None = None
    budget: str | None = None
    donnings: str | None = None
    effort: str | None = None
    cutoff_hz: str | None = None


class AssessedFindingEntry(StrictEntry):
    """A finding: its code, and the figures of its sentence."""

    code: Annotated[AssessmentCode, Field(strict=False)]
    figures: dict[str, float | str] = Field(default_factory=dict)


class AssessedMotionEntry(StrictEntry):
    """The results for one motion; figures by cuff and condition are checked separately."""

    reference_rest_length_m: KnownNumberEntry
    bare_body_cost: NumberEntry
    longest_cord_m: NumberEntry
    rest_lengths_m: RestLengthsEntry
    waist_cuff: str | None
    frames: KnownNumberEntry
    scenarios: KnownNumberEntry
    unsolved: UnsolvedEntry
    muscle_outcome_codes: dict[str, KnownNumberEntry] = Field(default_factory=dict)
    at_rigid_optimum: dict[str, Any]
    optimum: dict[str, Any]
    cost: dict[str, Any]
    muscle_reduction: dict[str, Any]
    optimum_to_slack_m: dict[str, Any]
    largest_cord_force_n: dict[str, Any]
    cord_force_lost_to_migration: dict[str, Any]
    cost_per_arm_migration_per_m: dict[str, Any]
    cost_per_waist_migration_per_m: dict[str, Any]


class OtherMotionEntry(AssessedMotionEntry):
    """A shorter assessment of another motion, for comparison."""

    motion: str


class AssessmentDocument(AssessedMotionEntry):
    """assessment.json: muscle effort in a suit with these cuffs. SI, with the unit in the key."""

    format: Literal[1]
    inputs: AssessmentInputsEntry
    findings: Annotated[list[str], Field(description="finding_codes in sentences")]
    finding_codes: list[AssessedFindingEntry] = Field(default_factory=list)
    decision: DecisionEntry | None = None
    uncertainty: UncertaintyEntry | None = None
    emg: list[MeasuredReductionEntry]
    cuffs: dict[str, dict[str, NumberEntry | str | list[str] | None]] = Field(default_factory=dict)
    beside: OtherMotionEntry | None = None
    subject: SubjectDocument | None = None
    against_study: StudyComparisonEntry | None = None
    postures: Annotated[list[PostureEntry], Field(description="for the picture of the body")] = Field(
        default_factory=list
    )
    suit_names: Annotated[
        dict[str, str] | None, Field(description="what waist, shoulder and arm are called in the suit's file")
    ] = None


_BY_CONDITION: dict[str, TypeAdapter[Any]] = {
    "cost": TypeAdapter(SeriesEntry),
    "optimum": TypeAdapter(OptimumEntry),
    "muscle_reduction": TypeAdapter(dict[str, NumberEntry]),
    **{
        key: TypeAdapter(NumberEntry)
        for key in (
            "at_rigid_optimum",
            "optimum_to_slack_m",
            "largest_cord_force_n",
            "cord_force_lost_to_migration",
            "cost_per_arm_migration_per_m",
            "cost_per_waist_migration_per_m",
        )
    },
}
"""Key → type of the entry for "rigid", and for every condition of every arm cuff."""


def read_assessment(path: Path) -> dict[str, Any]:
    """The file as plain data. Raises AssessmentFileError, with the key, for any other file."""
    try:
        plain = read_json(path)
    except OSError as error:
        raise _refusal(AssessmentFileCode.UNREADABLE, path, **because(error)) from error
    except PlainDataError as error:
        raise _refusal(AssessmentFileCode.NOT_JSON, path, **because(error)) from error
    if not isinstance(plain, dict):
        raise _refusal(AssessmentFileCode.NOT_AN_OBJECT, path, found=shortened(plain))
    try:
        document = AssessmentDocument.model_validate(plain)
    except ValidationError as error:
        raise _refusal(AssessmentFileCode.INVALID_ENTRY, path, reason=describe_error(error)) from error
    for part, where in ((plain, ""), (plain.get("beside"), "beside.")):
        if part is not None:
            _check_conditions(path, part, where)
    if len(document.postures) not in (0, 3):
        raise _refusal(AssessmentFileCode.WRONG_POSTURES, path, count=len(document.postures))
    _check_muscles(path, plain, [row.muscle for row in document.emg])
    return plain


def _check_conditions(path: Path, plain: dict[str, Any], where: str) -> None:
    """All keys must have the same arm cuffs in the same conditions, and a cost for every rest length."""
    conditions = {cuff: _conditions(cuff, entry) for cuff, entry in plain["cost"].items()}
    if RIGID not in conditions:
        raise _wrong_entry(AssessmentFileCode.NO_RIGID_CUFFS, path, f"{where}cost", plain["cost"])
    for key, kind in _BY_CONDITION.items():
        if plain[key].keys() != conditions.keys():
            code, cuffs = AssessmentFileCode.OTHER_CUFFS, ", ".join(conditions)
            raise _wrong_entry(code, path, where + key, list(plain[key]), cuffs=cuffs)
        for cuff, expected in conditions.items():
            place = f"{where}{key}.{cuff}"
            entry = plain[key].get(cuff)
            entries = {"": entry} if cuff == RIGID else entry
            if (
                not isinstance(entries, dict)
                or entries.keys() != set(expected)
                or (cuff != RIGID and SHOWN not in entries)
            ):
                named = ", ".join(expected or (SHOWN,)) or "an entry"
                raise _wrong_entry(AssessmentFileCode.OTHER_CONDITIONS, path, place, entry, conditions=named)
            for condition in expected:
                try:
                    kind.validate_python(entries[condition])
                except ValidationError as error:
                    fault = describe_error(error, context=f"{place}.{condition}".strip("."))
                    raise _refusal(AssessmentFileCode.INVALID_ENTRY, path, reason=fault) from error
                if key == "cost":
                    _check_cost(path, place, entries[condition], len(plain["rest_lengths_m"]["value"]))


def _check_cost(path: Path, place: str, entry: dict[str, Any], lengths: int) -> None:
    """The cost, and its intervals where there are any, must be of every rest length."""
    if len(entry["value"]) != lengths:
        raise _wrong_entry(AssessmentFileCode.COST_MISSING, path, place, entry)
    if entry.get("ci95") is not None and len(entry["ci95"]) != lengths:
        raise _wrong_entry(AssessmentFileCode.INTERVAL_MISSING, path, place, entry)


def _conditions(cuff: str, entry: Any) -> tuple[str, ...]:
    return ("",) if cuff == RIGID else tuple(entry) if isinstance(entry, dict) else ()


def _check_muscles(path: Path, plain: dict[str, Any], measured: list[str]) -> None:
    """Every reduction must have the muscles that are drawn: those of the EMG file, or all muscles of the rigid case."""
    reductions = plain["muscle_reduction"]
    names = measured or list(reductions[RIGID])
    for cuff in plain["cost"]:
        reduction = reductions[cuff] if cuff == RIGID else reductions[cuff][SHOWN]
        if missing := [name for name in names if name not in reduction]:
            code, where = AssessmentFileCode.MUSCLE_MISSING, f"muscle_reduction.{cuff}"
            raise _wrong_entry(code, path, where, list(reduction), muscle=missing[0])


def _wrong_entry(
    code: AssessmentFileCode, path: Path, where: str, found: Any, **figures: str | float
) -> AssessmentFileError:
    return _refusal(code, path, where=where, found=shortened(found), **figures)


def _refusal(code: AssessmentFileCode, path: Path, **figures: str | float) -> AssessmentFileError:
    return AssessmentFileError(Message(code, {"path": str(path), **figures}))
