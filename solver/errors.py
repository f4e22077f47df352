"""The root of the solver's exceptions, and the codes of its findings.

SolverError
├── ModelError        a model, or an option for it, that cannot be solved
├── MotionError       a motion, or a table over time, that cannot be used
└── SuitError         a suit that does not fit the model (suit/suit.py)
"""

from __future__ import annotations

from collections.abc import Iterable
from enum import StrEnum

from documents.message import Code, Message


class SolverCode(StrEnum):
    """Stable codes of errors, for programs. The code of a class stands for any reason that has no code of its own."""

    FAILED = "solver_failed"
    NO_PERSON_SOLVED = "solver_failed.no_person_solved"

    MODEL = "model_unusable"
    UNREADABLE_FILE = "model_unusable.unreadable_file"
    WRONG_DOCUMENT = "model_unusable.wrong_document"
    MALFORMED = "model_unusable.malformed_element"
    UNSUPPORTED = "model_unusable.unsupported_component"
    UNKNOWN_NAME = "model_unusable.unknown_name"
    NO_JOINT = "model_unusable.body_without_joint"
    WRONG_SHAPE = "model_unusable.wrong_shape"
    WRONG_PATH = "model_unusable.wrong_path"
    NO_MUSCLES = "model_unusable.no_muscles"
    SINGULAR = "model_unusable.singular"
    WRONG_GLENOID = "model_unusable.wrong_glenoid"
    NOT_BALANCED = "model_unusable.not_balanced"
    NEGATIVE_WEIGHT = "model_unusable.negative_weight"
    WRONG_OPTION = "model_unusable.wrong_option"
    NOT_WRITABLE = "model_unusable.not_writable"
    NO_MARKERS = "model_unusable.no_markers_in_common"
    TOO_FEW_MARKERS = "model_unusable.too_few_markers"
    TOO_FEW_FRAMES = "model_unusable.too_few_frames"
    CONSTRAINTS_NOT_MET = "model_unusable.constraints_not_met"
    WRONG_NOISE = "model_unusable.wrong_noise"
    MARKERS_DO_NOT_FIT = "model_unusable.markers_do_not_fit"
    LOAD_PRESENT = "model_unusable.load_present"
    NOT_POSITIVE = "model_unusable.not_positive"
    NOT_NAMED = "model_unusable.not_named"
    WRONG_PENNATION = "model_unusable.wrong_pennation"
    WRONG_MUSCLE = "model_unusable.wrong_muscle"
    NO_TENDON = "model_unusable.no_elastic_tendon"

    MOTION = "motion_unusable"
    UNREADABLE_TABLE = "motion_unusable.unreadable_table"
    MALFORMED_TABLE = "motion_unusable.malformed_table"
    MISSING_COLUMN = "motion_unusable.missing_column"
    NOT_FINITE = "motion_unusable.not_finite"
    UNEVEN_TIME = "motion_unusable.uneven_time"
    TIME_UNIT = "motion_unusable.time_unit"
    NO_FRAMES = "motion_unusable.no_frames"
    WRONG_CUTOFF = "motion_unusable.wrong_cutoff"
    NOT_COVERED = "motion_unusable.not_covered"
    NO_ACCELERATIONS = "motion_unusable.no_accelerations"
    IMPOSSIBLE_VALUE = "motion_unusable.impossible_value"
    OPEN_JOINT = "motion_unusable.open_joint"
    OUT_OF_RANGE = "motion_unusable.coordinate_out_of_range"

    SUIT = "suit_unusable"
    SUIT_FILE = "suit_unusable.unreadable_file"
    SUIT_KEY = "suit_unusable.wrong_key"
    SUIT_BODY = "suit_unusable.body_not_in_model"
    SUIT_MUSCLE = "suit_unusable.muscle_not_in_model"
    SUIT_NOT_WRITABLE = "suit_unusable.not_writable"
    NO_ARM_CUFF = "suit_unusable.no_arm_cuff"
    WRONG_CUFF = "suit_unusable.wrong_cuff"
    CUFF_BEYOND_SHOULDER = "suit_unusable.cuff_beyond_shoulder"
    CUFFS_NOT_AT_REST = "suit_unusable.cuffs_not_at_rest"
    CORD_SLACK = "suit_unusable.cord_slack"
    POINT_NOT_SEEN = "suit_unusable.point_not_seen"


class SolverError(ValueError):
    """One sentence for the analyst, a second may say what to do; code is for programs."""

    exit_code = 1
    general_code = SolverCode.FAILED

    def __init__(self, sentence: str, code: SolverCode | None = None) -> None:
        super().__init__(sentence)
        self.code = code or self.general_code


class ModelError(SolverError):
    """A model that cannot be read or is inconsistent; one sentence for its author."""

    general_code = SolverCode.MODEL


class MotionError(SolverError):
    """A motion that cannot be used; one sentence."""

    general_code = SolverCode.MOTION


def describe_codes(findings: Iterable[Message[Code]]) -> str:
    """The last part of a repr: every code once; empty without findings."""
    codes = ", ".join(dict.fromkeys(finding.code for finding in findings))
    return f"; findings: {codes}" if codes else ""


class CoverageCode(Code, prefix=""):
    """Degrees of freedom that a marker set does not determine."""

    THORAX_NOT_DETERMINED = "fewer than three markers on the thorax: no segment has a reference; add IJ, PX, C7 or T8"
    NO_SCAPULA_MARKERS = (
        "no marker on the scapula, or one: its orientation is not measured, it follows from the acromioclavicular "
        "joint and the coordinate tasks; add an acromion cluster, calibrated with AA, TS and AI"
    )
    FEW_SCAPULA_MARKERS = (
        "two markers on the scapula: coordinate tasks decide part of its posture; add an acromion cluster"
    )
    HUMERUS_NOT_DETERMINED = "no marker on the upper arm: add a cluster or both epicondyles"
    AXIAL_ROTATION_UNCERTAIN = (
        "axial rotation of the arm depends on the epicondyles alone and is uncertain; add a cluster or a forearm marker"
    )
    NO_FOREARM_MARKERS = "no marker on the forearm: elbow flexion and pronation are not measured"


class ScalingCode(Code, prefix=""):
    """Stable codes of findings on a scaled model."""

    POINT_INSIDE_SURFACE = "{muscle}: a path point lies inside {surface}, unlike in the generic model"
    FIBRE_LENGTH = "{muscle}: its fibre is {figure:.2f} of the optimal length in the default posture"
    PATH_LENGTH = "{muscle}: its path is {figure:.2f} times as long, relative to the median of all muscles"
    FIBRE_LENGTH_IN_MOTION = "{muscle}: its fibre reaches {figure:.2f} of the optimal length in the motion"
    PASSIVE_FORCE = "{muscle}: its passive force reaches {figure:.2f} of the maximum isometric force"
    PATH_JUMP = "{muscle}: the length of its path jumps by {jump_mm:.0f} mm between two frames"
