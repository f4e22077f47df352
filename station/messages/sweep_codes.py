"""Codes of messages of sweeps and of the viewer."""

from __future__ import annotations

from enum import StrEnum


class SweepCode(StrEnum):
    """Reason why a sweep does not start, why a case of it is not solved, or a finding on its plan."""

    UNREADABLE = "plan.unreadable"
    WRONG_TABLE = "plan.wrong_table"
    TOO_MANY_POINTS = "plan.too_many_points"
    SPAN_OF_GRID = "plan.span_of_grid"
    EMPTY_AXIS = "plan.empty_axis"
    WRONG_VALUE = "plan.wrong_value"
    WORN_CUFFS = "plan.worn_cuffs"
    FILE_UNREADABLE = "plan.file_unreadable"
    FEW_FRAMES = "plan.few_frames"
    NO_SCHEDULER = "cluster.no_scheduler"
    CASE_FAILED = "cluster.case_failed"
    NO_VIEWER = "viewer.not_started"
