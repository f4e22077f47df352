"""Messages on many sessions or cases: studies, their plans, the catalogue, sweeps, the viewer, the validation."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum


class StudyCode(StrEnum):
    """Reason why a study is not made, or why a session or a value is left out of it."""

    NOT_A_FOLDER = "study.not_a_folder"
    NO_SESSION = "study.no_session"
    NO_USABLE_SESSION = "study.no_usable_session"
    MIXED_ORIGIN = "study.mixed_origin"
    NOT_FITTED = "study.session_not_fitted"
    NO_JOURNAL = "study.no_journal"
    NO_VOLUNTEER = "study.no_volunteer_code"
    UNREADABLE = "study.session_unreadable"
    NOT_IDENTIFIED = "study.not_identified"
    WRONG_FILE = "study.wrong_file"
    WRONG_NORMATIVE = "normative.wrong_file"


class CatalogueCode(StrEnum):
    """Reason why the catalogue is not built or queried, or why a session in it has no values."""

    NOT_A_FOLDER = "catalogue.not_a_folder"
    NOT_CREATED = "catalogue.not_created"
    NOT_OPENED = "catalogue.not_opened"
    OTHER_DATABASE = "catalogue.other_database"
    WRONG_SQL = "catalogue.wrong_sql"
    NO_QUERY = "catalogue.no_query"
    WRONG_PARTICIPANTS = "catalogue.wrong_participants"
    UNREADABLE = "catalogue.session_unreadable"


class PlanCode(StrEnum):
    """Reason why a study is not planned."""

    UNREADABLE = "study_plan.unreadable"
    WRONG_TABLE = "study_plan.wrong_table"
    NO_PROTOCOL = "study_plan.no_protocol_section"
    TOO_MANY_DESIGNS = "study_plan.too_many_designs"


STUDY: Mapping[StrEnum, str] = {
    StudyCode.NOT_A_FOLDER: "{folder} is not a folder; give session folders, or a folder that holds them",
    StudyCode.NO_SESSION: "{folders} holds no session: no folder has a cuffs.json; fit sessions with `station fit`",
    StudyCode.NO_USABLE_SESSION: "none of {sessions:session} can be used: {left_out}",
    StudyCode.MIXED_ORIGIN: (
        "measured and simulated sessions cannot be in one study: {measured} is measured, {simulated} is simulated; "
        "name the folders of one kind"
    ),
    StudyCode.NOT_FITTED: "{session} is left out: it has no cuffs.json; fit it with `station fit`",
    StudyCode.NO_JOURNAL: (
        "{session} is left out: it has no session.jsonl, which has the volunteer's code; copy it beside cuffs.json"
    ),
    StudyCode.NO_VOLUNTEER: (
        "{session} is left out: its session.jsonl has no volunteer's code, as where trials are recorded one by one "
        "(`station record --test`); record sessions with `station record --subject` or `station serve`"
    ),
    StudyCode.UNREADABLE: "{session} is left out: {reason}",
    StudyCode.NOT_IDENTIFIED: "{session}: {quantity} of {cuff}, donning {donning}, is left out: {reason}",
    StudyCode.WRONG_FILE: "{path} is not a study: {reason}; make it again with `station study`",
    StudyCode.WRONG_NORMATIVE: (
        "{path} cannot be used as a normative table: {reason}; give a normative.json of `station study`"
    ),
    CatalogueCode.NOT_A_FOLDER: "{folder} is not a folder; give the folder that holds the sessions",
    CatalogueCode.NOT_CREATED: (
        "the catalogue {path} cannot be created: {reason}; give a file in a folder that you can write to, with --output"
    ),
    CatalogueCode.NOT_OPENED: (
        "the catalogue {path} cannot be opened: {reason}; close the program that uses it, or build it again with "
        "--rebuild if it is damaged"
    ),
    CatalogueCode.OTHER_DATABASE: "{path} is another database, not a catalogue; give another file with --output",
    CatalogueCode.NO_QUERY: "--sql has {found}, expected one query; start it with SELECT",
    CatalogueCode.WRONG_SQL: "the query failed: {reason}",
    CatalogueCode.WRONG_PARTICIPANTS: "{path} cannot be used as participants.tsv of BIDS: {reason}",
    CatalogueCode.UNREADABLE: "{session} has no values in the catalogue: {reason}",
    PlanCode.UNREADABLE: "{path} cannot be read as the plan of a study in TOML: {reason}",
    PlanCode.WRONG_TABLE: "the plan of a study {path}: {reason}; docs/study.md has an example",
    PlanCode.NO_PROTOCOL: "{path} has no section [protocol]; give the configuration of the station with --config",
    PlanCode.TOO_MANY_DESIGNS: "the plan has {designs:design}, expected at most {most:.0f}; name fewer choices",
}


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
        "the grid of the plan has {points:point}, expected at most {most:.0f}; vary fewer values, or draw a sample"
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
        "every = {every} keeps fewer than {least} frames in {cases:case}, as few as {fewest:.0f}: efforts and best "
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
        "all published variants ({count}) are within the limits: median difference from the published force at most "
        "{difference_n:g} N, RMSE at most the published one + {rmse_percent:g} % of body weight"
    ),
    ValidationCode.BEYOND_LIMITS: "beyond the limits: {variants}",
    ValidationCode.NOTHING_PUBLISHED: "no published solution in the folder: the limits were not checked",
    ValidationCode.PARTLY_PUBLISHED: (
        "{lift}, {variant}: the motion lasts from {start_s:g} to {end_s:g} s and the published solution from "
        "{published_start_s:g} to {published_end_s:g} s, so that {compared} of {frames:frame} can be compared; check "
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
    ValidationCode.UNSOLVED: "{unsolved} of {frames:frame} of {lift}, {variant}, have no solution and are left out",
}
