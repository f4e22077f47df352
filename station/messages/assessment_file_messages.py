"""Messages on an assessment.json or activations.csv that cannot be used."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum


class AssessmentFileCode(StrEnum):
    """What is wrong with the file."""

    UNREADABLE = "assessment_file.unreadable"
    NOT_JSON = "assessment_file.not_json"
    NOT_AN_OBJECT = "assessment_file.not_an_object"
    INVALID_ENTRY = "assessment_file.invalid_entry"
    NO_RIGID_CUFFS = "assessment_file.no_rigid_cuffs"
    OTHER_CUFFS = "assessment_file.other_cuffs"
    OTHER_CONDITIONS = "assessment_file.other_conditions"
    COST_MISSING = "assessment_file.cost_missing"
    INTERVAL_MISSING = "assessment_file.interval_missing"
    WRONG_POSTURES = "assessment_file.wrong_postures"
    MUSCLE_MISSING = "assessment_file.muscle_missing"

    ACTIVATIONS_UNREADABLE = "activations_file.unreadable"
    ACTIVATIONS_COLUMNS = "activations_file.wrong_columns"
    ACTIVATIONS_NOT_NUMBERS = "activations_file.not_numbers"


_REMEDY = "; make it again with `station assess`"
_FOUND = "{path}: {where} is {found}, expected "

ASSESSMENT_FILE: Mapping[StrEnum, str] = {
    AssessmentFileCode.UNREADABLE: "{path} cannot be read: {reason}",
    AssessmentFileCode.NOT_JSON: "{path} {reason}" + _REMEDY,
    AssessmentFileCode.NOT_AN_OBJECT: "{path}: the document is {found}, expected an object" + _REMEDY,
    AssessmentFileCode.INVALID_ENTRY: "{path}: {reason}" + _REMEDY,
    AssessmentFileCode.NO_RIGID_CUFFS: _FOUND + "rigid cuffs among it" + _REMEDY,
    AssessmentFileCode.OTHER_CUFFS: _FOUND + "the cuffs {cuffs}" + _REMEDY,
    AssessmentFileCode.OTHER_CONDITIONS: _FOUND + "{conditions}" + _REMEDY,
    AssessmentFileCode.COST_MISSING: _FOUND + "a cost for every rest length" + _REMEDY,
    AssessmentFileCode.INTERVAL_MISSING: _FOUND + "an interval or null for every rest length" + _REMEDY,
    AssessmentFileCode.WRONG_POSTURES: "{path}: postures is a list of {count:.0f}, expected three" + _REMEDY,
    AssessmentFileCode.MUSCLE_MISSING: _FOUND + "{muscle} among them" + _REMEDY,
    AssessmentFileCode.ACTIVATIONS_UNREADABLE: "{path} cannot be read as a table: {reason}" + _REMEDY,
    AssessmentFileCode.ACTIVATIONS_COLUMNS: (
        "{path} has the columns {found}, expected condition, cuff, time_s and muscles" + _REMEDY
    ),
    AssessmentFileCode.ACTIVATIONS_NOT_NUMBERS: "{path}, column {column}, holds values that are not numbers" + _REMEDY,
}
