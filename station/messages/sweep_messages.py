"""Messages of sweeps and of the viewer."""

from __future__ import annotations

from collections.abc import Mapping
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


SWEEPS: Mapping[StrEnum, str] = {
    SweepCode.UNREADABLE: "{path} cannot be read as a plan in TOML ({reason}); correct it",
    SweepCode.WRONG_TABLE: "the plan {path}: {reason}",
    SweepCode.TOO_MANY_POINTS: (
        "the grid of the plan has {points:.0f} points, expected at most {most:.0f}; vary fewer values, or draw a sample"
    ),
    SweepCode.SPAN_OF_GRID: (
        "{axis} of the plan has first and last, expected a list of values; only numbers of a sample have first and last"
    ),
    SweepCode.EMPTY_AXIS: "{axis} of the plan is empty, expected at least one value; add one, or remove the key",
    SweepCode.WRONG_VALUE: "the plan: {reason}; correct it",
    SweepCode.WORN_CUFFS: (
        "{cuff} of {file} gives the cuffs {worn}, expected one arm cuff and at most one waist cuff; name an arm cuff"
    ),
    SweepCode.FILE_UNREADABLE: (
        "vary.{axis} of the plan names {file}, which cannot be read ({reason}); paths are relative to the plan"
    ),
    SweepCode.FEW_FRAMES: (
        "every = {every} keeps fewer than {least} frames in {cases} cases, as few as {fewest:.0f}: efforts and best "
        "rest lengths depend on which frames these are. Choose a smaller every in the plan"
    ),
    SweepCode.NO_SCHEDULER: (
        "no Dask scheduler answers at {address} ({reason}); start one with `dask scheduler`, or omit --scheduler"
    ),
    SweepCode.CASE_FAILED: "the case was not solved ({reason}); run the sweep again to repeat it",
    SweepCode.NO_VIEWER: (
        "the viewer of Rerun did not start; it needs a display: write a file with --rrd, and open it on a computer "
        "with a display"
    ),
}
