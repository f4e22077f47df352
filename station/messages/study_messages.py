"""Messages on many sessions or cases: studies, their plans, the catalogue, sweeps, the viewer, the validation."""

from __future__ import annotations

from documents.message import Code


class StudyCode(Code, prefix="study."):
    """Reason why a study is not made, or why a session or a value is left out of it."""

    NO_SESSION = "{folders} holds no session: no folder has a cuffs.json; fit sessions with `station fit`"
    NO_USABLE_SESSION = "none of the sessions found ({sessions:.0f}) can be used: {left_out}"
    MIXED_ORIGIN = (
        "measured and simulated sessions cannot be in one study: {measured} is measured, {simulated} is simulated; "
        "name the folders of one kind"
    )
    NOT_FITTED = "study.session_not_fitted", "{session} is left out: it has no cuffs.json; fit it with `station fit`"
    NO_JOURNAL = (
        "{session} is left out: it has no session.jsonl, which has the volunteer's code; copy it beside cuffs.json"
    )
    NO_VOLUNTEER = (
        "study.no_volunteer_code",
        "{session} is left out: its session.jsonl has no volunteer's code, as where trials are recorded one by one "
        "(`station record --test`); record sessions with `station record --subject` or `station serve`",
    )
    UNREADABLE = "study.session_unreadable", "{session} is left out: {reason}"
    NOT_IDENTIFIED = "{session}: {quantity} of {cuff}, donning {donning}, is left out: {reason}"
    WRONG_NORMATIVE = (
        "normative.wrong_file",
        "{path} cannot be used as a normative table: {reason}; give a normative.json of `station study`",
    )


class CatalogueCode(Code, prefix="catalogue."):
    """Reason why the catalogue is not built or queried, or why a session in it has no values."""

    NOT_CREATED = (
        "the catalogue {path} cannot be created: {reason}; give a file in a folder that you can write to, with --output"
    )
    NOT_OPENED = (
        "the catalogue {path} cannot be opened: {reason}; close the program that uses it, or build it again with "
        "--rebuild if it is damaged"
    )
    OTHER_DATABASE = "{path} is another database, not a catalogue; give another file with --output"
    WRONG_SQL = "the query failed: {reason}"
    NO_QUERY = "--sql has {found}, expected one query; start it with SELECT"
    WRONG_PARTICIPANTS = "{path} cannot be used as participants.tsv of BIDS: {reason}"
    UNREADABLE = "catalogue.session_unreadable", "{session} has no values in the catalogue: {reason}"


class PlanCode(Code, prefix="study_plan."):
    """Reason why a study is not planned."""

    UNREADABLE = "{path} cannot be read as the plan of a study in TOML: {reason}"
    WRONG_TABLE = "the plan of a study {path}: {reason}; docs/study.md has an example"
    NO_PROTOCOL = (
        "study_plan.no_protocol_section",
        "{path} has no section [protocol]; give the configuration of the station with --config",
    )
    TOO_MANY_DESIGNS = "the plan has {designs:design}, expected at most {most:.0f}; name fewer choices"


class SweepCode(Code, prefix="plan."):
    """Reason why a sweep does not start, why a case of it is not solved, or a finding on its plan."""

    UNREADABLE = "{path} cannot be read as a plan in TOML ({reason}); correct it"
    WRONG_TABLE = "the plan {path}: {reason}"
    TOO_MANY_POINTS = (
        "the grid of the plan has {points:point}, expected at most {most:.0f}; vary fewer values, or draw a sample"
    )
    SPAN_OF_GRID = (
        "{axis} of the plan has first and last, expected a list of values; only numbers of a sample have first and last"
    )
    EMPTY_AXIS = "{axis} of the plan is empty, expected at least one value; add one, or remove the key"
    WRONG_VALUE = "the plan: {reason}; correct it"
    WORN_CUFFS = (
        "{cuff} of {file} gives the cuffs {worn}, expected one arm cuff and at most one waist cuff; name an arm cuff"
    )
    FILE_UNREADABLE = (
        "vary.{axis} of the plan names {file}, which cannot be read ({reason}); paths are relative to the plan"
    )
    FEW_FRAMES = (
        "every = {every} keeps fewer than {least} frames in {cases:case}, as few as {fewest:.0f}: efforts and best "
        "rest lengths depend on which frames these are. Choose a smaller every in the plan"
    )
    NO_SCHEDULER = (
        "cluster.no_scheduler",
        "no Dask scheduler answers at {address} ({reason}); start one with `dask scheduler`, or omit --scheduler",
    )
    CASE_FAILED = "cluster.case_failed", "the case was not solved ({reason}); run the sweep again to repeat it"
    NO_VIEWER = (
        "viewer.not_started",
        "the viewer of Rerun did not start; it needs a display: write a file with --rrd, and open it on a computer "
        "with a display",
    )


class ValidationCode(Code, prefix="validation."):
    """Reason why a folder is not validated, and the verdict."""

    NO_LIFT = "{path} contains no NAME_as_solved.osim; docs/validation.md lists the files of a lift"
    FILES_MISSING = "{path} lacks {missing} of the lift {lift}; docs/validation.md lists the files"
    NO_BODY_WEIGHT = "{file} has no BodyWeight [N] in its header, expected the patient's; add the line"
    DIFFERENT_FORCES = (
        "the two records of the force of {lift} differ by up to {difference_n:.1f} N, expected at most {limit_n:g} N; "
        "use the two records of one measurement"
    )
    NOT_COVERED = (
        "the motion of {lift} lasts from {start_s:g} to {end_s:g} s and its measured force in {file} from 0 to "
        "{last_s:g} s; cut the motion"
    )
    TIMES_DIFFER = (
        "the published solution {variant} of {lift} and its motion have no time in common; use files of one lift"
    )
    WITHIN_LIMITS = (
        "all published variants ({count}) are within the limits: median difference from the published force at most "
        "{difference_n:g} N, RMSE at most the published one + {rmse_percent:g} % of body weight"
    )
    BEYOND_LIMITS = "beyond the limits: {variants}"
    NOTHING_PUBLISHED = "no published solution in the folder: the limits were not checked"
    LIFT_LEFT_OUT = "{lift} is left out: {reason}"
    PARTLY_PUBLISHED = (
        "{lift}, {variant}: the motion lasts from {start_s:g} to {end_s:g} s and the published solution from "
        "{published_start_s:g} to {published_end_s:g} s, so that {compared} of {frames:frame} can be compared; check "
        "that both files are whole"
    )
    UNSOLVED = (
        "validation.unsolved_frames",
        "{unsolved} of {frames:frame} of {lift}, {variant}, have no solution and are left out",
    )
    START_NOT_MARKED = (
        "{file} has Marker 1 in its first sample, which is therefore time 0; check that the motion begins with it"
    )
    PUBLISHED_MISSING = "there is no {files}, so that this variant is not compared with a publication"
    PUBLISHED_UNUSED = "not used: {files}; published solutions are those of the variants {variants}"
    LOW_CORRELATION = (
        "{lift}: measured and predicted force have a correlation of at most {correlation:z.2f} in all variants, "
        "expected {expected:g} or more; check that record and motion are of one lift and begin together"
    )
