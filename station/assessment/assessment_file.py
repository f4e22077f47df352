"""The schema of assessment.json, and its reader: complete and of the types that the report draws, or refused."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import pandas as pd
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from documents.plain_data import PlainDataError, read_json, shortened
from documents.regular_file import open_regular
from documents.validation import describe_error
from station.errors import StationError

RIGID = "rigid"
FORMAT = 1


class AssessmentFileError(StationError):
    """An assessment.json that cannot be used; one sentence says where and what was expected."""


def read_activations(path: Path) -> pd.DataFrame:
    """The table beside it. Raises AssessmentFileError for one that is cut, or is another."""
    try:
        with open_regular(path) as file:
            table = pd.read_csv(file, keep_default_na=False, na_values=["nan"])
    except (OSError, ValueError) as error:
        raise AssessmentFileError(f"{path} cannot be read as a table: {error}; make it again") from error
    muscles = list(table.columns[3:])
    if list(table.columns[:3]) != ["condition", "cuff", "time_s"] or not muscles:
        found = shortened(", ".join(map(str, table.columns)))
        raise AssessmentFileError(f"{path} has the columns {found}, expected condition, cuff, time_s and muscles")
    for name in ("time_s", *muscles):
        if not pd.api.types.is_numeric_dtype(table[name]):
            raise AssessmentFileError(f"{path} holds something else than numbers under {name}; make it again")
    return table


class _Strict(BaseModel):
    model_config = ConfigDict(strict=True)


class _Number(_Strict):
    value: float | None
    ci95: Annotated[list[float], Field(min_length=2, max_length=2)] | None = None


class _Known(_Number):
    value: float


class _Series(_Strict):
    value: Annotated[list[float | None], Field(min_length=1)]


class _Lengths(_Strict):
    value: Annotated[list[float], Field(min_length=1)]


class _Optimum(_Strict):
    rest_length_m: _Number
    normalised_cost: _Number
    permissible_error_m: _Number


class _Unsolved(_Strict):
    count: _Known


class _Emg(_Strict):
    muscle: str
    reduction_percent: _Number
    sd_percent: _Number


class _Inputs(_Strict):
    model: str
    motion: str
    suit: str
    cuffs: str


class _Suited(_Strict):
    """What an assessment and the one beside it share; figures that stand by cuff and condition are checked apart."""

    reference_rest_length_m: _Known
    bare_body_cost: _Number
    longest_cord_m: _Number
    rest_lengths_m: _Lengths
    waist_cuff: str | None
    frames: _Known
    scenarios: _Known
    unsolved: _Unsolved
    at_rigid_optimum: dict[str, Any]
    optimum: dict[str, Any]
    cost: dict[str, Any]
    muscle_reduction: dict[str, Any]
    optimum_to_slack_m: dict[str, Any]
    largest_cord_force_n: dict[str, Any]
    cord_force_lost_to_migration: dict[str, Any]
    cost_per_arm_migration_per_m: dict[str, Any]


class _Beside(_Suited):
    motion: str


class AssessmentDocument(_Suited):
    """assessment.json: what the suit with these cuffs does for the muscles. SI, with the unit in the key.

    A file without "format" is of an older station; it is read as format 1, whose keys mean the same.
    """

    format: Literal[1] = 1
    inputs: _Inputs
    findings: list[str]
    emg: list[_Emg]
    cuffs: dict[str, dict[str, _Number | str | list[str] | None]] = Field(default_factory=dict)
    beside: _Beside | None = None


_BY_CONDITION: dict[str, TypeAdapter[Any]] = {
    "cost": TypeAdapter(_Series),
    "optimum": TypeAdapter(_Optimum),
    "muscle_reduction": TypeAdapter(dict[str, _Number]),
    **{
        key: TypeAdapter(_Number)
        for key in (
            "at_rigid_optimum",
            "optimum_to_slack_m",
            "largest_cord_force_n",
            "cord_force_lost_to_migration",
            "cost_per_arm_migration_per_m",
        )
    },
}
"""Key → what stands under "rigid", and under every condition of every arm cuff."""
SHOWN: Literal["both"] = "both"
"""The condition that every arm cuff is drawn in."""


def read_assessment(path: Path) -> dict[str, Any]:
    """The file as plain data. Raises AssessmentFileError, with the key, for what `station assess` would not write."""
    try:
        plain = read_json(path)
    except OSError as error:
        raise AssessmentFileError(f"{path} cannot be read: {error.strerror or error}") from error
    except PlainDataError as error:
        raise AssessmentFileError(f"{path} {error}; make it again with `station assess`") from error
    if not isinstance(plain, dict):
        raise _refusal(path, "", plain, "expected an object")
    try:
        read = AssessmentDocument.model_validate(plain)
    except ValidationError as error:
        raise _malformed(path, describe_error(error)) from error
    for part, where in ((plain, ""), (plain.get("beside"), "beside.")):
        if part is not None:
            _check_conditions(path, part, where)
    _check_muscles(path, plain, [row.muscle for row in read.emg])
    return plain


def _check_conditions(path: Path, plain: dict[str, Any], where: str) -> None:
    """All keys have the same arm cuffs in the same conditions, and a cost for every rest length."""
    conditions = {cuff: _conditions(cuff, entry) for cuff, entry in plain["cost"].items()}
    if RIGID not in conditions:
        raise _refusal(path, f"{where}cost", plain["cost"], "expected rigid cuffs among it")
    for key, kind in _BY_CONDITION.items():
        if plain[key].keys() != conditions.keys():
            raise _refusal(path, where + key, list(plain[key]), f"expected the cuffs {', '.join(conditions)}")
        for cuff, its in conditions.items():
            place = f"{where}{key}.{cuff}"
            entry = plain[key].get(cuff)
            found = {"": entry} if cuff == RIGID else entry
            if not isinstance(found, dict) or found.keys() != set(its) or (cuff != RIGID and SHOWN not in found):
                raise _refusal(path, place, entry, f"expected {', '.join(its or (SHOWN,)) or 'an entry'}")
            for condition in its:
                try:
                    kind.validate_python(found[condition])
                except ValidationError as error:
                    fault = describe_error(error, context=f"{place}.{condition}".strip("."))
                    raise _malformed(path, fault) from error
                if key == "cost" and len(found[condition]["value"]) != len(plain["rest_lengths_m"]["value"]):
                    raise _refusal(path, place, found[condition], "expected a cost for every rest length")


def _conditions(cuff: str, entry: Any) -> tuple[str, ...]:
    return ("",) if cuff == RIGID else tuple(entry) if isinstance(entry, dict) else ()


def _check_muscles(path: Path, plain: dict[str, Any], measured: list[str]) -> None:
    """Every reduction has the muscles that are drawn: those of EMG, or all of the rigid cuffs'."""
    reductions = plain["muscle_reduction"]
    names = measured or list(reductions[RIGID])
    for cuff in plain["cost"]:
        found = reductions[cuff] if cuff == RIGID else reductions[cuff][SHOWN]
        if missing := [name for name in names if name not in found]:
            raise _refusal(path, f"muscle_reduction.{cuff}", list(found), f"expected {missing[0]} among them")


def _refusal(path: Path, where: str, found: Any, expected: str) -> AssessmentFileError:
    what = f"{where} is {shortened(found)}" if where else f"the document is {shortened(found)}"
    return _malformed(path, f"{what}, {expected}")


def _malformed(path: Path, fault: str) -> AssessmentFileError:
    return AssessmentFileError(f"{path}: {fault}; make it again with `station assess`")
