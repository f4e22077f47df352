"""The schema of assessment.json, which checks what is written and read; published in docs/schemas."""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

from pydantic import AfterValidator, Field, ValidationError

from documents.message import Message, because
from documents.plain_data import PlainDataError, read_json, shortened
from documents.regular_file import open_regular
from documents.validation import describe_error
from solver.muscle import PathMode
from solver.redundancy.effort import Tendons
from station.assessment.assessment_json import (
    RIGID,
    AssessedMotionEntry,
    CurveEntries,
    MeasuredReductionEntry,
    Real,
    StrictEntry,
    WornCuffEntry,
)
from station.assessment.drawn_postures import PostureEntry
from station.assessment.study_comparison import StudyComparisonEntry
from station.assessment.uncertainty_json import DecisionEntry, UncertaintyEntry
from station.defaults import CUTOFF_HZ
from station.errors import StationError
from station.messages.assessment_messages import AssessmentCode, AssessmentFileCode
from station.subject.subject_document import SubjectDocument

if TYPE_CHECKING:
    import pandas as pd

FORMAT: Literal[1] = 1
"""It rises where a key changes its meaning, not where one is added."""
INPUTS = ("model", "motion", "suit", "cuffs")
"""Roles that every assessment has."""
OPTIONS: dict[str, tuple[str, ...]] = {"tendons": get_args(Tendons), "paths": get_args(PathMode)}
"""Values of the inputs that choose a method."""
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


def _ensure_usable(inputs: dict[str, str]) -> dict[str, str]:
    if missing := [role for role in INPUTS if role not in inputs]:
        raise ValueError(f"{missing[0]} is missing")
    for option, values in OPTIONS.items():
        if (value := inputs.get(option, values[0])) not in values:
            raise ValueError(f"{option} is {shortened(value)}, expected {' or '.join(values)}")
    read_cutoff(inputs)
    return inputs


def read_cutoff(inputs: Mapping[str, str]) -> float | None:
    """The cut-off [Hz] of the low-pass filter of the motion, None for no filter. Raises ValueError."""
    text = inputs.get("cutoff_hz", f"{CUTOFF_HZ:g}")
    with suppress(ValueError):
        if text == "none" or 0 < float(text) < math.inf:
            return None if text == "none" else float(text)
    raise ValueError(f"cutoff_hz is {shortened(text)}, expected a number above zero or none")


class AssessedFindingEntry(StrictEntry):
    """A finding: its code, and the figures of its sentence."""

    code: Annotated[AssessmentCode, Field(strict=False)]
    figures: dict[str, Real | str] = Field(default_factory=dict)


class _OtherMotion(StrictEntry):
    motion: str


class OtherMotionEntry(AssessedMotionEntry, _OtherMotion):
    """A shorter assessment of another motion, for comparison."""


class _Head(StrictEntry):
    format: Literal[1]
    origin: str | None = None
    cuffs: dict[str, WornCuffEntry] = Field(default_factory=dict)


class AssessmentDocument(AssessedMotionEntry, _Head):
    """assessment.json: muscle effort in a suit with these cuffs. SI, with the unit in the key."""

    beside: OtherMotionEntry | None = None
    findings: Annotated[list[str], Field(description="finding_codes in sentences")]
    finding_codes: list[AssessedFindingEntry] = Field(default_factory=list)
    decision: DecisionEntry | None = None
    uncertainty: UncertaintyEntry | None = None
    against_study: StudyComparisonEntry | None = None
    emg: list[MeasuredReductionEntry]
    postures: Annotated[list[PostureEntry], Field(description="for the picture of the body")] = Field(
        default_factory=list
    )
    suit_names: Annotated[
        dict[str, str] | None, Field(description="what waist, shoulder and arm are called in the suit's file")
    ] = None
    subject: SubjectDocument | None = None
    inputs: Annotated[
        dict[str, str],
        AfterValidator(_ensure_usable),
        Field(
            description="names of the input files, with their SHA-256, and options that are not the default",
            json_schema_extra={"required": list(INPUTS)},
        ),
    ]
    inputs_checked: dict[str, str] = Field(default_factory=dict)
    versions: dict[str, str] = Field(default_factory=dict)

    @property
    def parts(self) -> dict[str, AssessedMotionEntry]:
        """Place in the document → assessment of one motion."""
        return {"": self} | ({"beside.": self.beside} if self.beside else {})


def read_assessment(path: Path) -> AssessmentDocument:
    """Raises AssessmentFileError, with the key, for any other file."""
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
    for where, part in document.parts.items():
        _check_curves(path, part, where)
    if len(document.postures) not in (0, 3):
        raise _refusal(AssessmentFileCode.WRONG_POSTURES, path, count=len(document.postures))
    _check_muscles(path, document)
    return document


def _check_curves(path: Path, part: AssessedMotionEntry, where: str) -> None:
    """All keys must have the same arm cuffs in the same conditions, SHOWN among them, and a cost for every length."""
    arms = part.cost.arms
    for key in type(part).model_fields:
        entries = getattr(part, key)
        if not isinstance(entries, CurveEntries):
            continue
        if entries.arms.keys() != arms.keys():
            code, cuffs = AssessmentFileCode.OTHER_CUFFS, ", ".join((RIGID, *arms))
            raise _wrong_entry(code, path, where + key, [RIGID, *entries.arms], cuffs=cuffs)
        for cuff, curves in entries.arms.items():
            if curves.keys() != arms[cuff].keys() or SHOWN not in curves:
                code, conditions = AssessmentFileCode.OTHER_CONDITIONS, ", ".join(arms[cuff]) or SHOWN
                raise _wrong_entry(code, path, f"{where}{key}.{cuff}", list(curves), conditions=conditions)
    lengths = len(part.rest_lengths_m.value)
    costs = [(RIGID, part.cost.rigid), *((name, series) for name, curves in arms.items() for series in curves.values())]
    for cuff, series in costs:
        if len(series.value) != lengths:
            raise _wrong_entry(AssessmentFileCode.COST_MISSING, path, f"{where}cost.{cuff}", series.value)
        if series.ci95 is not None and len(series.ci95) != lengths:
            raise _wrong_entry(AssessmentFileCode.INTERVAL_MISSING, path, f"{where}cost.{cuff}", series.ci95)


def _check_muscles(path: Path, document: AssessmentDocument) -> None:
    """Every reduction must have the muscles that are drawn: those of the EMG file, or all muscles of the rigid case."""
    reductions = document.muscle_reduction
    names = [row.muscle for row in document.emg] or list(reductions.rigid)
    for cuff in (RIGID, *reductions.arms):
        reduction = reductions.of(cuff, SHOWN)
        if missing := [name for name in names if name not in reduction]:
            code, where = AssessmentFileCode.MUSCLE_MISSING, f"muscle_reduction.{cuff}"
            raise _wrong_entry(code, path, where, list(reduction), muscle=missing[0])


def _wrong_entry(
    code: AssessmentFileCode, path: Path, where: str, found: Any, **figures: str | float
) -> AssessmentFileError:
    return _refusal(code, path, where=where, found=shortened(found), **figures)


def _refusal(code: AssessmentFileCode, path: Path, **figures: str | float) -> AssessmentFileError:
    return AssessmentFileError(Message(code, {"path": str(path), **figures}))
