"""Messages on the validation with measured joint forces."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum


class ValidationCode(StrEnum):
    """Reason why a folder is not validated, and the verdict."""

    NOT_A_FOLDER = "validation.not_a_folder"
    NO_LIFT = "validation.no_lift"
    FILES_MISSING = "validation.files_missing"
    NO_BODY_WEIGHT = "validation.no_body_weight"
    DIFFERENT_FORCES = "validation.different_forces"
    NOT_COVERED = "validation.not_covered"
    TIMES_DIFFER = "validation.times_differ"
    WITHIN_LIMITS = "validation.within_limits"
    BEYOND_LIMITS = "validation.beyond_limits"
    NOTHING_PUBLISHED = "validation.nothing_published"
    LIFT_LEFT_OUT = "validation.lift_left_out"
    PARTLY_PUBLISHED = "validation.partly_published"
    UNSOLVED = "validation.unsolved_frames"
    START_NOT_MARKED = "validation.start_not_marked"
    PUBLISHED_MISSING = "validation.published_missing"
    PUBLISHED_UNUSED = "validation.published_unused"
    LOW_CORRELATION = "validation.low_correlation"


VALIDATION: Mapping[StrEnum, str] = {
    ValidationCode.NOT_A_FOLDER: "{path} is not a folder, expected one with lifts (NAME_as_solved.osim, …)",
    ValidationCode.NO_LIFT: "{path} contains no NAME_as_solved.osim; docs/validation.md lists the files of a lift",
    ValidationCode.FILES_MISSING: "{path} lacks {missing} of the lift {lift}; docs/validation.md lists the files",
    ValidationCode.NO_BODY_WEIGHT: "{file} has no BodyWeight [N] in its header, expected the patient's; add the line",
    ValidationCode.DIFFERENT_FORCES: (
        "the two records of the force of {lift} differ by up to {difference_n:.1f} N, expected at most {limit_n:g} N; "
        "use the two records of one measurement"
    ),
    ValidationCode.NOT_COVERED: (
        "the motion of {lift} lasts from {start_s:g} to {end_s:g} s and its measured force in {file} from 0 to "
        "{last_s:g} s; cut the motion"
    ),
    ValidationCode.TIMES_DIFFER: (
        "the published solution {variant} of {lift} and its motion have no time in common; use files of one lift"
    ),
    ValidationCode.WITHIN_LIMITS: (
        "all {count} published variants are within the limits: median difference from the published force at most "
        "{difference_n:g} N, RMSE at most the published one + {rmse_percent:g} % of body weight"
    ),
    ValidationCode.BEYOND_LIMITS: "beyond the limits: {variants}",
    ValidationCode.NOTHING_PUBLISHED: "no published solution in the folder: the limits were not checked",
    ValidationCode.PARTLY_PUBLISHED: (
        "{lift}, {variant}: the motion lasts from {start_s:g} to {end_s:g} s and the published solution from "
        "{published_start_s:g} to {published_end_s:g} s, so that {compared} of {frames} frames are compared; check "
        "that both files are whole"
    ),
    ValidationCode.LOW_CORRELATION: (
        "{lift}: measured and predicted force have a correlation of at most {correlation:z.2f} in all variants, "
        "expected {expected:g} or more; check that record and motion are of one lift and begin together"
    ),
    ValidationCode.START_NOT_MARKED: (
        "{file} has Marker 1 in its first sample, which is therefore time 0; check that the motion begins with it"
    ),
    ValidationCode.PUBLISHED_MISSING: "there is no {files}, so that this variant is not compared with a publication",
    ValidationCode.PUBLISHED_UNUSED: "not used: {files}; published solutions are those of the variants {variants}",
    ValidationCode.LIFT_LEFT_OUT: "{lift} is left out: {reason}",
    ValidationCode.UNSOLVED: "{unsolved} of {frames} frames of {lift}, {variant}, have no solution and are left out",
}
