"""Messages on the findings of an assessment, the choice of a cuff, and an assessment.json that cannot be used."""

from __future__ import annotations

from collections.abc import Sequence

from documents.message import Code

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
_EQUIVALENT = "{at}, {leading}: equivalent within {relevant_points:g} points of effort (probability {percent} %)"
_SETTLE = "{group} explains {percent} % of the variance of {first} − {second}, the largest share; to reduce it, "
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


def sources_text(sources: Sequence[str]) -> str:
    """Groups of sources: "the fit of the cuffs, their donning, body, muscles and motion"."""
    *others, last = (SOURCE_TEXT[source] for source in sources)
    return f"{', '.join(others)} and {last}" if others else last


class AssessmentCode(Code):
    """A finding of an assessment: comparison of cuffs, choice, uncertainty, limits."""

    NO_CHOICE = "choice.unknown", "The cuffs cannot be compared: every cuff has frames without a solution."
    ONLY_CUFF = "choice.only_cuff", _CHOICE + "; there is no other cuff to compare it with."
    LEAST_EFFORT = "choice.least_effort", _CHOICE + "; compared: {cuffs}."
    EQUIVALENT = (
        "choice.equivalent",
        _CHOICE + "; {equivalent}: less than {relevant_percent:g} % more effort, or no significant difference.",
    )
    NOT_COMPARED = "comparison.unknown", "{first} and {second} cannot be compared: frames have no solution."
    WITHOUT_INTERVAL = "comparison.without_interval", _DIFFERENCE + "; without an interval."
    DIFFERENT = "comparison.different", _INTERVAL + "."
    NOT_RELEVANT = "comparison.not_relevant", _INTERVAL + "; below the {relevant_percent:g} % taken to matter."
    NOT_DISTINGUISHED = "comparison.not_distinguished", _INTERVAL + "; not significant."
    BEST_REST_LENGTH = (
        "rest_length.best",
        "With a cord of its best rest length, {at_m:.3f} m, the effort with {cuff} is {effort:.3f}.",
    )
    OUTSIDE_RANGE = (
        "rest_length.outside_range",
        "A dash in place of a best rest length, or of its width, means that it lies outside the range tried, "
        "{first_m:.3f} to {last_m:.3f} m.",
    )
    NO_INTERVALS = "intervals.none", "Intervals are not computed: no people were drawn."
    NO_COVARIANCE = (
        "intervals.no_covariance",
        "Intervals are not computed: the cuffs have no covariance, so there is nothing to draw. Give their standard "
        "errors, or fit the cuffs from recordings.",
    )
    INTERVALS = (
        "intervals.computed",
        _INTERVALS + ", which alone changes efforts by up to {effort:.4f}, best rest lengths by up to "
        "{rest_length_mm:.1f} mm and permissible errors by up to {permissible_error_mm:.1f} mm.",
    )
    INTERVALS_UNVERIFIED = "intervals.unverified", _INTERVALS + "; the effect of this is unknown for some figures."
    PEOPLE_UNSOLVED = (
        "intervals.people_unsolved",
        "{unsolved:.0f} of {people:.0f} drawn people have no solution for at least one cuff ({outcomes}). The "
        "intervals are of the others, and may be too narrow.",
    )
    PEOPLE_INFEASIBLE = (
        "intervals.people_infeasible",
        "{infeasible:.0f} of {people:.0f} drawn people ({percent:.0f} %) are left out: their muscles cannot do the "
        "motion, because reserve actuators would need more than {reserves_percent:.0f} % of the effort with a slack "
        "cord. The motion was done, so intervals and decision are of the others.",
    )
    CORD_FORCE = (
        "cord.force",
        "With rigid cuffs the cord pulls with up to {force_n:.0f} N, and is slack throughout from a rest length "
        "of {slack_m:.3f} m on, {slack_cm:.1f} cm above the best one.",
    )
    MIGRATION_COST = "cord.migration_cost", _MIGRATION_INTERVAL + "."
    MIGRATION_COST_OPEN = (
        "cord.migration_cost.not_distinguished",
        _MIGRATION_INTERVAL + "; this change of effort is not distinguishable from 0.",
    )
    MIGRATION_COST_ALONE = "cord.migration_cost.without_interval", _MIGRATION + "; without an interval."
    MIGRATION_COST_OF_WAIST = (
        "cord.migration_cost.of_waist",
        "With {cuff}, the effort changes by {percent_per_cm} percentage points per centimetre that {waist} alone "
        "migrates.",
    )
    RESERVES_SMALL = (
        "reserves.small",
        "Reserve actuators, which are not included in the effort, would add at most {effort:.4f} at {at_m:.3f} m.",
    )
    RESERVES_LARGE = (
        "reserves.large",
        "The muscles cannot carry this motion: reserve actuators, which are not included in the effort, would add up "
        "to {effort:.3g} at {at_m:.3f} m. Remove the weight of the actuators of coordinates that no muscle moves, such "
        "as those of a pelvis, with --effort (unweighted_coordinates); otherwise use a lighter load or another motion.",
    )
    RESERVES_LARGE_AT = (
        "reserves.large.at_coordinates",
        "Reserves give {shares}, more than {percent:g} %: the muscles do not give the motion, because they are too "
        "weak, their passive forces oppose it, or these reserves cost too little (optimal_force in --actuators or "
        "--effort).",
    )
    RESIDUALS_LARGE = (
        "residuals.large",
        "Residual actuators give {forces} (RMS); the model weighs {weight:.0f} N. They replace the forces of ground, "
        "seat or hands: give the measured forces (--external-loads), and check their unit and time.",
    )
    RATE_EXCEEDED = (
        "frames.beyond_activation_rate",
        _UNSOLVED + "exceed the rate of activation since the previous frame; they are solved without that limit.",
    )
    INFEASIBLE = (
        "frames.infeasible",
        _INFEASIBLE + " and keep the reaction of a shoulder inside its glenoid" + _UNKNOWN_EFFORT,
    )
    INFEASIBLE_WITHOUT_CONE = "frames.infeasible.without_cone", _INFEASIBLE + _UNKNOWN_EFFORT + _RESERVE
    NOT_CONVERGED = (
        "frames.not_converged",
        _UNSOLVED + "did not converge: the solver stopped before its residuals were small; efforts that include them "
        "are not reliable.",
    )
    NOT_FINITE = (
        "frames.not_finite",
        _UNSOLVED + "have no finite accelerations in the model; they are not included in any effort.",
    )
    PATH_NOT_CONVERGED = (
        "muscles.path_not_converged",
        _UNCONVERGED + "path of at least one muscle did not converge within the limit of iterations; as in OpenSim, "
        "its last point is used. Compare with geodesics.",
    )
    CURVE_NOT_CONVERGED = (
        "muscles.curve_not_converged",
        _UNCONVERGED + "force of at least one muscle did not converge on a curve of the fibre; its last point is used.",
    )
    FIBER_NOT_CONVERGED = (
        "muscles.fiber_not_converged",
        _UNCONVERGED + "fibre and elastic tendon of at least one muscle did not come into balance; the last point is "
        "used.",
    )
    MUSCLES_SLACK = (
        "muscles.slack",
        "Muscles whose tendon is longer than their whole path in every frame, so that they give no active force: "
        "{muscles}. Check their tendon slack length, in metres, and their path.",
    )
    NEGATIVE_MIGRATION = (
        "cuffs.negative_migration",
        "The migration of {cuff} is {migration_mm:.1f} mm: it moved against the pull, so that the cord pulls more "
        "than before. Check its sign.",
    )
    WEARER_NOT_RECORDED = (
        "wearer.not_recorded",
        "Body and motion are the bundled ones: the session has no motion of its wearer.",
    )
    WEARER_NOT_ASSESSED = "wearer.not_assessed", "Body and motion are the bundled ones, not the wearer's: {reason}."
    NO_GLENOID = "model.no_glenoid", "No joint reaction was constrained: the model has no glenoid."
    NO_ARM_SEGMENTS = (
        "model.no_arm_segments",
        "Drawn people have the segment masses of the model: the budget has those of humerus, ulna, radius and hand "
        "only, and the model has none of these bodies.",
    )
    LEFT_OUT = "model.left_out", "Left out of the model: {parts}.{effect}"
    IMPOSSIBLE_INERTIA = (
        "model.impossible_inertia",
        "Bodies whose principal moments of inertia no mass can have, because the largest is far above the sum of the "
        "others: {bodies}. Correct their inertia.",
    )
    WITHOUT_DATA = (
        "motion.without_data",
        "Coordinates without data: {coordinates}. They keep their default values, or those that a constraint gives.",
    )
    UNUSED_COLUMNS = (
        "motion.unused_columns",
        "Columns of the motion that are no coordinate of the model, and are not used: {columns}.",
    )
    RANGE_NOT_COVERED = (
        "motion.range_not_covered",
        "The motion does not cover the requested time: {range}. Only its own frames are solved.",
    )
    ROW_COUNTS = (
        "motion.row_counts",
        "The motion does not have as many rows as its header states: {rows}. All rows of the file are used. If the "
        "file was cut, export it again; otherwise correct nRows, because OpenSim's tools read no more rows than that.",
    )
    REPEATED_ROWS = (
        "motion.repeated_rows",
        "Rows of the motion that repeat the time and the values of the row before are left out: {count}.",
    )
    VIOLATES_CONSTRAINT = (
        "motion.violates_constraint",
        "Coordinates whose data differ from what their coupler, lock or prescription gives, with the largest "
        "difference: {coordinates}. Leave their columns out of the motion, and the constraint gives their values.",
    )
    BEYOND_RANGE = (
        "motion.beyond_range",
        "Angles more than a full turn outside their range: {coordinates}. If the motion is in degrees, the header of "
        "its file should have inDegrees=yes, and a DataFrame deg in attrs['units'].",
    )
    TRANSLATION_BEYOND_RANGE = (
        "motion.translation_beyond_range",
        "Translations far outside their range: {coordinates}. If these columns of the motion are in millimetres, "
        "convert them to metres.",
    )
    RADIANS_AS_DEGREES = (
        "motion.radians_as_degrees",
        "No angle of the motion is larger than {angle}°, and its header has inDegrees=yes. If the angles are in "
        "radians, write inDegrees=no.",
    )
    RESAMPLED = (
        "motion.resampled",
        "The steps of the motion are {steps} s. It is interpolated to even ones, of the median step.",
    )
    LOW_CUTOFF = (
        "motion.low_cutoff",
        "The low-pass filter removes a part of this motion: {frequencies}. Where a cut-off can be given (cutoff_hz), "
        "choose a higher one, for walking 6 Hz.",
    )
    NO_LOAD_APPLIED = (
        "loads.none_applied",
        "No external load is applied: {file} has no ExternalForce that is switched on. Set its appliesForce to true.",
    )
    LOAD_FAR_FROM_BODY = (
        "loads.far_from_body",
        "External forces far from their body: {loads}. Check the unit and the axes of their points, and the body of "
        "each force.",
    )
    LOAD_ON_GROUND = "loads.on_ground", "Loads on the ground do not act on the model: {loads}. Correct applied_to_body."
    LOADS_DATA_ELSEWHERE = (
        "loads.data_elsewhere",
        "The file with the columns of the external loads is not where it is named. The one beside the XML file is "
        "read: {files}.",
    )
    LOADS_UNUSED = "loads.unused_elements", "Elements of the external loads that are not used: {elements}."
    ACTUATORS_UNUSED = (
        "actuators.unused_elements",
        "Elements of the files of actuators that are not used: {elements}.",
    )


class DecisionCode(Code, prefix="decision."):
    """Choice of the cuff, as solver.suit.decision.DecisionOutcome; FIT_ONLY: the total uncertainty is not known.
    NO_PEOPLE: nor can it be, because people are not drawn with elastic tendons.
    """

    CHOOSE = (
        "{at}, choose {leading}: it saves at least {relevant_points:g} points of effort more than {worse} "
        "(probability {percent} %)."
    )
    EQUIVALENT = _EQUIVALENT + "; choose by comfort or migration."
    EQUIVALENT_AND_WORSE = (
        _EQUIVALENT + ", and each saves at least {relevant_points:g} points more than {worse}; choose by comfort "
        "or migration."
    )
    UNDECIDED = (
        "{at}, undecided: {leading} has the least mean effort. It saves at least {relevant_points:g} points more than "
        "{rival} with a probability of {first_percent} %, is equivalent to it with {equivalent_percent} %, and saves "
        "at least {relevant_points:g} points less with {second_percent} %."
    )
    ONLY_CUFF = "{at}, {leading} is the only cuff; there is no other to compare it with."
    UNKNOWN = "{at}, no decision: only {people:.0f} of {drawn:.0f} drawn people have a solution for every cuff."
    FIT_ONLY = (
        "No decision: the intervals do not contain the variation of donnings, bodies, muscles and motions. Assess "
        "again without `--people 0` and `--sources cuffs`."
    )
    NO_PEOPLE = (
        "No decision: people are not drawn with elastic tendons. Assess again without `--tendons elastic`, and compare "
        "how much effort the cuffs save with both."
    )
    SETTLE_FIT = "settle.fit", _SETTLE + "repeat the trials of the cuffs."
    SETTLE_DONNING = "settle.donning", _SETTLE + "measure more donnings of each cuff."
    SETTLE_BODY = "settle.body", _SETTLE + "measure the wearer's body and the points of the cord (--subject)."
    SETTLE_MUSCLES = "settle.muscles", _SETTLE + "measure the wearer's strength, or compare with EMG."
    SETTLE_MOTION = "settle.motion", _SETTLE + "record more cycles of the wearer's own motion (--subject)."
    SETTLE_UNKNOWN = (
        "settle.unknown",
        "Which measurement would settle {first} − {second} is not known: no group of sources has a share of its "
        "variance that differs from zero. Run `station assess` with --indices 128 or more.",
    )


class InputCode(Code, prefix="input."):
    """Reason why files do not make an assessment, a suit or a sweep."""

    UNKNOWN_CUFF = "the cuffs file has no cuff {missing}, only {known}; fit the session again or choose another cuff"
    CUFF_NAMED_RIGID = "a cuff is named {name}, which is reserved for rigid cuffs; rename it"
    RICHER_LAW = (
        "the cuff {cuff} has the law {law}; a suit wears cuffs of the law {known} only (F = k x + c ẋ). If that is "
        "sufficient, write {cuff} with its k, c and migration alone into a cuffs file"
    )
    OUTPUT_IS_FILE = "{path} is a file, expected a folder to write into; give another folder"
    ONE_ARM_CUFF = "expected one arm cuff, found {found}; choose one by --cuff (arm cuffs of the file: {known})"
    NO_CUFFS_FILE = "the cuff {cuff} needs a cuffs.json that holds it; give it by --cuffs"
    CONDITION_WITHOUT_CUFFS = "the condition {condition} needs cuffs; give a cuffs.json by --cuffs"
    TABLE_FORMAT = "the output is {name}, expected a name that ends in {suffixes}"
    BUDGET = "{path} is not a budget of uncertainty ({reason}); correct it"
    EFFORT = "{path} cannot be used as weights of the effort: {reason}; docs/redundancy.md has an example"
    PEOPLE_FAILED = "drawn people could not be assessed on the cluster: {reason}; start it again to continue"
    NO_PEOPLE = (
        "--indices, --scheduler, --workers and --donnings are for drawn people, and none are drawn; leave out "
        "--people 0"
    )
    NO_GLENOID_TO_KEEP = "the model {model} has no glenoid; leave out {options}"
    NO_ARM_OF_SUBJECT = (
        "--subject estimates a person with an arm, and the model {model} has none of the bodies {bodies}; for another "
        "limb give a scaled model and its motion by --model and --motion"
    )
    DONNING_SPREAD = "Spread between donnings: {stiffness}, {damping}, {migration}."
    EMG_UNREADABLE = "emg.unreadable", "{path} cannot be read as a CSV table of EMG ({reason}); check the path"
    EMG_COLUMNS = "emg.columns", "{path} has the columns {found}, expected {expected}"
    EMG_MUSCLE = (
        "emg.unknown_muscle",
        "{path}, line {line}, names {muscle}, which is neither a muscle of the model nor a group of the suit; known "
        "are {known}",
    )
    EMG_NUMBER = "emg.number", "{path}, line {line}, has {reduction} and {sd}, expected two numbers in percent"


class AssessmentFileCode(Code, prefix="assessment_file."):
    """Fault of the file."""

    UNREADABLE = "{path} cannot be read: {reason}"
    NOT_JSON = "{path} {reason}" + _REMEDY
    NOT_AN_OBJECT = "{path}: the document is {found}, expected an object" + _REMEDY
    INVALID_ENTRY = "{path}: {reason}" + _REMEDY
    OTHER_CUFFS = _FOUND + "the cuffs {cuffs}" + _REMEDY
    OTHER_CONDITIONS = _FOUND + "{conditions}" + _REMEDY
    COST_MISSING = _FOUND + "a cost for every rest length" + _REMEDY
    INTERVAL_MISSING = _FOUND + "an interval or null for every rest length" + _REMEDY
    WRONG_POSTURES = "{path}: postures is a list of {count:.0f}, expected three" + _REMEDY
    MUSCLE_MISSING = _FOUND + "{muscle} among them" + _REMEDY

    ACTIVATIONS_UNREADABLE = "activations_file.unreadable", "{path} cannot be read as a table: {reason}" + _REMEDY
    ACTIVATIONS_COLUMNS = (
        "activations_file.wrong_columns",
        "{path} has the columns {found}, expected condition, cuff, time_s and muscles" + _REMEDY,
    )
    ACTIVATIONS_NOT_NUMBERS = (
        "activations_file.not_numbers",
        "{path}, column {column}, holds values that are not numbers" + _REMEDY,
    )
