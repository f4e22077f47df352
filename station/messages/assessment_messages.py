"""Messages on the findings of an assessment, the choice of a cuff, and an assessment.json that cannot be used."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from enum import StrEnum

from station.messages.codes import AssessmentCode, DecisionCode, InputCode

_CHOICE = "Least effort at {at_m:.3f} m: {cuff}, with migration and compliance {effort:.3f} of that with a slack cord"
_DIFFERENCE = "{first} − {second}: {difference_percent} % effort at {at_m:.3f} m"
_INTERVAL = _DIFFERENCE + " (95 % CI {low_percent} to {high_percent} %)"
_INTERVALS = (
    "Intervals contain {sources}: {people:.0f} drawn people, {solved:.0f} with a solution. So many people give 95 % "
    "intervals that hold {least_percent:.0f} to {most_percent:.0f} % of all people. One in {every:frame} is solved"
)
_UNSOLVED = "{frames:.0f} of {all_frames:frame} of all scenarios "
_INFEASIBLE = _UNSOLVED + (
    "are infeasible: no activations between 0 and 1 and controls within their limits give the accelerations"
)
_UNKNOWN_EFFORT = (
    "; their effort is unknown, and with it every figure that includes it. Use a lighter load, or leave out that part "
    "of the motion."
)
_RESERVE = " Elastic tendons that are slack after rest need a reserve ([reserves] in --effort)."
_UNCONVERGED = "{frames:.0f} of {all_frames:frame}: the "
_MIGRATION = (
    "With compliance, migration of {cuffs} reduces the largest force of the cord by {lost_percent:.0f} %, and changes "
    "the effort by {percent_per_cm} percentage points per centimetre that {cuff} alone migrates"
)
_MIGRATION_INTERVAL = _MIGRATION + " (95 % CI {low_per_cm} to {high_per_cm})"
ASSESSMENT: Mapping[StrEnum, str] = {
    AssessmentCode.NO_CHOICE: "The cuffs cannot be compared: every cuff has frames without a solution.",
    AssessmentCode.ONLY_CUFF: _CHOICE + "; there is no other cuff to compare it with.",
    AssessmentCode.LEAST_EFFORT: _CHOICE + "; compared: {cuffs}.",
    AssessmentCode.EQUIVALENT: (
        _CHOICE + "; {equivalent} differs by less than {relevant_percent:g} %, or not significantly."
    ),
    AssessmentCode.NOT_COMPARED: "{first} and {second} cannot be compared: frames have no solution.",
    AssessmentCode.WITHOUT_INTERVAL: _DIFFERENCE + "; without an interval.",
    AssessmentCode.DIFFERENT: _INTERVAL + ".",
    AssessmentCode.NOT_RELEVANT: _INTERVAL + "; below the {relevant_percent:g} % taken to matter.",
    AssessmentCode.NOT_DISTINGUISHED: _INTERVAL + "; not significant.",
    AssessmentCode.BEST_REST_LENGTH: (
        "With a cord of its best rest length, {at_m:.3f} m, the effort with {cuff} is {effort:.3f}."
    ),
    AssessmentCode.OUTSIDE_RANGE: (
        "A dash in place of a best rest length, or of its width, means that it lies outside the range tried, "
        "{first_m:.3f} to {last_m:.3f} m."
    ),
    AssessmentCode.NO_INTERVALS: ("Intervals are not computed: no people were drawn."),
    AssessmentCode.NO_COVARIANCE: (
        "Intervals are not computed: the cuffs have no covariance, so there is nothing to draw. Give their standard "
        "errors, or fit the cuffs from recordings."
    ),
    AssessmentCode.INTERVALS: (
        _INTERVALS + ", which alone changes efforts by up to {effort:.4f}, best rest lengths by up to "
        "{rest_length_mm:.1f} mm and permissible errors by up to {permissible_error_mm:.1f} mm."
    ),
    AssessmentCode.INTERVALS_UNVERIFIED: _INTERVALS + "; the effect of this is unknown for some figures.",
    AssessmentCode.PEOPLE_UNSOLVED: (
        "{unsolved:.0f} of {people:.0f} drawn people have no solution for at least one cuff ({outcomes}). The "
        "intervals are of the others, and may be too narrow."
    ),
    AssessmentCode.PEOPLE_INFEASIBLE: (
        "{infeasible:.0f} of {people:.0f} drawn people ({percent:.0f} %) are left out: their muscles cannot do the "
        "motion, because reserve actuators would need more than {reserves_percent:.0f} % of the effort with a slack "
        "cord. The motion was done, so intervals and decision are of the others."
    ),
    AssessmentCode.CORD_FORCE: (
        "With rigid cuffs the cord pulls with up to {force_n:.0f} N, and is slack throughout from a rest length "
        "of {slack_m:.3f} m on, {slack_cm:.1f} cm above the best one."
    ),
    AssessmentCode.MIGRATION_COST: _MIGRATION_INTERVAL + ".",
    AssessmentCode.MIGRATION_COST_OPEN: _MIGRATION_INTERVAL + "; this change of effort is not distinguishable from 0.",
    AssessmentCode.MIGRATION_COST_ALONE: _MIGRATION + "; without an interval.",
    AssessmentCode.MIGRATION_COST_OF_WAIST: (
        "With {cuff}, the effort changes by {percent_per_cm} percentage points per centimetre that {waist} alone "
        "migrates."
    ),
    AssessmentCode.NEGATIVE_MIGRATION: (
        "The migration of {cuff} is {migration_mm:.1f} mm: it moved against the pull, so that the cord pulls more "
        "than before. Check its sign."
    ),
    AssessmentCode.RESERVES_SMALL: (
        "Reserve actuators, which are not included in the effort, would add at most {effort:.4f} at {at_m:.3f} m."
    ),
    AssessmentCode.RESERVES_LARGE: (
        "The muscles cannot carry this motion: reserve actuators, which are not included in the effort, would add up "
        "to {effort:.3g} at {at_m:.3f} m. Remove the weight of the actuators of coordinates that no muscle moves, such "
        "as those of a pelvis, with --effort (unweighted_coordinates); otherwise use a lighter load or another motion."
    ),
    AssessmentCode.RESERVES_LARGE_AT: (
        "Reserves give {shares}, more than {percent:g} %: the muscles do not give the motion, because they are too "
        "weak, their passive forces oppose it, or these reserves cost too little (optimal_force in --actuators or "
        "--effort)."
    ),
    AssessmentCode.LEFT_OUT: "Left out of the model: {parts}.{effect}",
    AssessmentCode.IMPOSSIBLE_INERTIA: (
        "Bodies whose principal moments of inertia no mass can have, because the largest is far above the sum of the "
        "others: {bodies}. Correct their inertia."
    ),
    AssessmentCode.MUSCLES_SLACK: (
        "Muscles whose tendon is longer than their whole path in every frame, so that they give no active force: "
        "{muscles}. Check their tendon slack length, in metres, and their path."
    ),
    AssessmentCode.RESIDUALS_LARGE: (
        "Residual actuators give {forces} (RMS); the model weighs {weight:.0f} N. They replace the forces of ground, "
        "seat or hands: give the measured forces (--external-loads), and check their unit and time."
    ),
    AssessmentCode.RATE_EXCEEDED: (
        _UNSOLVED + "exceed the rate of activation since the previous frame; they are solved without that limit."
    ),
    AssessmentCode.INFEASIBLE: (
        _INFEASIBLE + " and keep the reaction of a shoulder inside its glenoid" + _UNKNOWN_EFFORT
    ),
    AssessmentCode.INFEASIBLE_WITHOUT_CONE: _INFEASIBLE + _UNKNOWN_EFFORT + _RESERVE,
    AssessmentCode.NOT_CONVERGED: (
        _UNSOLVED + "did not converge: the solver stopped before its residuals were small; efforts that include them "
        "are not reliable."
    ),
    AssessmentCode.NOT_FINITE: (
        _UNSOLVED + "have no finite accelerations in the model; they are not included in any effort."
    ),
    AssessmentCode.PATH_NOT_CONVERGED: (
        _UNCONVERGED + "path of at least one muscle did not converge within the limit of iterations; as in OpenSim, "
        "its last point is used. Compare with geodesics."
    ),
    AssessmentCode.CURVE_NOT_CONVERGED: (
        _UNCONVERGED + "force of at least one muscle did not converge on a curve of the fibre; its last point is used."
    ),
    AssessmentCode.FIBER_NOT_CONVERGED: (
        _UNCONVERGED + "fibre and elastic tendon of at least one muscle did not come into balance; the last point is "
        "used."
    ),
    AssessmentCode.WEARER_NOT_RECORDED: (
        "Body and motion are the bundled ones: the session has no motion of its wearer."
    ),
    AssessmentCode.WEARER_NOT_ASSESSED: "Body and motion are the bundled ones, not the wearer's: {reason}.",
    AssessmentCode.NO_GLENOID: "No joint reaction was constrained: the model has no glenoid.",
    AssessmentCode.NO_ARM_SEGMENTS: (
        "Drawn people have the segment masses of the model: the budget has those of humerus, ulna, radius and hand "
        "only, and the model has none of these bodies."
    ),
    AssessmentCode.WITHOUT_DATA: (
        "Coordinates without data: {coordinates}. They keep their default values, or those that a constraint gives."
    ),
    AssessmentCode.UNUSED_COLUMNS: (
        "Columns of the motion that are no coordinate of the model, and are not used: {columns}."
    ),
    AssessmentCode.RANGE_NOT_COVERED: (
        "The motion does not cover the requested time: {range}. Only its own frames are solved."
    ),
    AssessmentCode.ROW_COUNTS: (
        "The motion does not have as many rows as its header states: {rows}. All rows of the file are used. If the "
        "file was cut, export it again; otherwise correct nRows, because OpenSim's tools read no more rows than that."
    ),
    AssessmentCode.REPEATED_ROWS: (
        "Rows of the motion that repeat the time and the values of the row before are left out: {count}."
    ),
    AssessmentCode.VIOLATES_CONSTRAINT: (
        "Coordinates whose data differ from what their coupler, lock or prescription gives, with the largest "
        "difference: {coordinates}. Leave their columns out of the motion, and the constraint gives their values."
    ),
    AssessmentCode.BEYOND_RANGE: (
        "Angles more than a full turn outside their range: {coordinates}. If the motion is in degrees, the header of "
        "its file should have inDegrees=yes, and a DataFrame deg in attrs['units']."
    ),
    AssessmentCode.TRANSLATION_BEYOND_RANGE: (
        "Translations far outside their range: {coordinates}. If these columns of the motion are in millimetres, "
        "convert them to metres."
    ),
    AssessmentCode.RADIANS_AS_DEGREES: (
        "No angle of the motion is larger than {angle}°, and its header has inDegrees=yes. If the angles are in "
        "radians, write inDegrees=no."
    ),
    AssessmentCode.RESAMPLED: (
        "The steps of the motion are {steps} s. It is interpolated to even ones, of the median step."
    ),
    AssessmentCode.LOW_CUTOFF: (
        "The low-pass filter removes a part of this motion: {frequencies}. Where a cut-off can be given (cutoff_hz), "
        "choose a higher one, for walking 6 Hz."
    ),
    AssessmentCode.NO_LOAD_APPLIED: (
        "No external load is applied: {file} has no ExternalForce that is switched on. Set its appliesForce to true."
    ),
    AssessmentCode.LOAD_ON_GROUND: "Loads on the ground do not act on the model: {loads}. Correct applied_to_body.",
    AssessmentCode.LOADS_DATA_ELSEWHERE: (
        "The file with the columns of the external loads is not where it is named. The one beside the XML file is "
        "read: {files}."
    ),
    AssessmentCode.LOADS_UNUSED: "Elements of the external loads that are not used: {elements}.",
    AssessmentCode.LOAD_FAR_FROM_BODY: (
        "External forces far from their body: {loads}. Check the unit and the axes of their points, and the body of "
        "each force."
    ),
    InputCode.UNKNOWN_CUFF: (
        "the cuffs file has no cuff {missing}, only {known}; fit the session again or choose another cuff"
    ),
    InputCode.CUFF_NAMED_RIGID: "a cuff is named {name}, which is reserved for rigid cuffs; rename it",
    InputCode.RICHER_LAW: (
        "the cuff {cuff} has the law {law}; a suit wears cuffs of the law {known} only (F = k x + c ẋ). If that is "
        "sufficient, write {cuff} with its k, c and migration alone into a cuffs file"
    ),
    InputCode.OUTPUT_IS_FILE: "{path} is a file, expected a folder to write into; give another folder",
    InputCode.ONE_ARM_CUFF: (
        "expected one arm cuff, found {found}; choose one by --cuff (arm cuffs of the file: {known})"
    ),
    InputCode.EFFORT: "{path} cannot be used as weights of the effort: {reason}; docs/redundancy.md has an example",
    InputCode.NO_CUFFS_FILE: "the cuff {cuff} needs a cuffs.json that holds it; give it by --cuffs",
    InputCode.CONDITION_WITHOUT_CUFFS: "the condition {condition} needs cuffs; give a cuffs.json by --cuffs",
    InputCode.TABLE_FORMAT: "the output is {name}, expected a name that ends in {suffixes}",
    InputCode.BUDGET: "{path} is not a budget of uncertainty ({reason}); correct it",
    InputCode.NO_PEOPLE: (
        "--indices, --scheduler, --workers and --donnings are for drawn people, and none are drawn; leave out "
        "--people 0"
    ),
    InputCode.NO_GLENOID_TO_KEEP: (
        "{options} needs a shoulder with a glenoid, and the model {model} has none; leave it out"
    ),
    InputCode.NO_ARM_OF_SUBJECT: (
        "--subject estimates a person with an arm, and the model {model} has none of the bodies {bodies}; for another "
        "limb give a scaled model and its motion by --model and --motion"
    ),
    InputCode.DONNING_SPREAD: "Spread between donnings: {stiffness}, {damping}, {migration}.",
    InputCode.PEOPLE_FAILED: "drawn people could not be assessed on the cluster: {reason}; start it again to continue",
    InputCode.EMG_UNREADABLE: "{path} cannot be read as a CSV table of EMG ({reason}); check the path",
    InputCode.EMG_COLUMNS: "{path} has the columns {found}, expected {expected}",
    InputCode.EMG_MUSCLE: (
        "{path}, line {line}, names {muscle}, which is neither a muscle of the model nor a group of the suit; known "
        "are {known}"
    ),
    InputCode.EMG_NUMBER: "{path}, line {line}, has {reduction} and {sd}, expected two numbers in percent",
}


_EQUIVALENT = "{at}, {leading}: equivalent within {relevant_points:g} points of effort (probability {percent} %)"
_SETTLE = "{group} explains {percent} % of the variance of {first} − {second}, the largest share; to reduce it, "
DECISIONS: Mapping[StrEnum, str] = {
    DecisionCode.CHOOSE: (
        "{at}, choose {leading}: it saves at least {relevant_points:g} points of effort more than {worse} "
        "(probability {percent} %)."
    ),
    DecisionCode.EQUIVALENT: _EQUIVALENT + "; choose by comfort or migration.",
    DecisionCode.EQUIVALENT_AND_WORSE: (
        _EQUIVALENT + ", and each saves at least {relevant_points:g} points more than {worse}; choose by comfort "
        "or migration."
    ),
    DecisionCode.UNDECIDED: (
        "{at}, undecided: {leading} has the least mean effort. It saves at least {relevant_points:g} points more than "
        "{rival} with a probability of {first_percent} %, is equivalent to it with {equivalent_percent} %, and saves "
        "at least {relevant_points:g} points less with {second_percent} %."
    ),
    DecisionCode.ONLY_CUFF: "{at}, {leading} is the only cuff; there is no other to compare it with.",
    DecisionCode.UNKNOWN: (
        "{at}, no decision: only {people:.0f} of {drawn:.0f} drawn people have a solution for every cuff."
    ),
    DecisionCode.SETTLE_FIT: _SETTLE + "repeat the trials of the cuffs.",
    DecisionCode.SETTLE_DONNING: _SETTLE + "measure more donnings of each cuff.",
    DecisionCode.SETTLE_BODY: _SETTLE + "measure the wearer's body and the points of the cord (--subject).",
    DecisionCode.SETTLE_MUSCLES: _SETTLE + "measure the wearer's strength, or compare with EMG.",
    DecisionCode.SETTLE_MOTION: _SETTLE + "record more cycles of the wearer's own motion (--subject).",
    DecisionCode.SETTLE_UNKNOWN: (
        "Which measurement would settle {first} − {second} is not known: no group of sources has a share of its "
        "variance that differs from zero. Run `station assess` with --indices 128 or more."
    ),
    DecisionCode.FIT_ONLY: (
        "No decision: the intervals do not contain the variation of donnings, bodies, muscles and motions. Assess "
        "again without `--people 0` and `--sources cuffs`."
    ),
    DecisionCode.NO_PEOPLE: (
        "No decision: people are not drawn with elastic tendons. Assess again without `--tendons elastic`, and compare "
        "how much effort the cuffs save with both."
    ),
}
_REMEDY = "; make it again with `station assess`"
_FOUND = "{path}: {where} is {found}, expected "
SOURCE_TEXT = {
    "fit": "the fit of the cuffs",
    "donning": "their donning",
    "body": "body",
    "muscles": "muscles",
    "motion": "motion",
}
"""Group of sources → what it is called in a list that begins with the cuffs."""


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


def sources_text(sources: Sequence[str]) -> str:
    """Groups of sources: "the fit of the cuffs, their donning, body, muscles and motion"."""
    *others, last = (SOURCE_TEXT[source] for source in sources)
    return f"{', '.join(others)} and {last}" if others else last
