"""Codes of reasons why an assessment.json or activations.csv cannot be used."""

from __future__ import annotations

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
