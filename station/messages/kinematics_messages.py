"""Messages on markers, postures and the body of a person, on subject.toml, and on poses and motions of the wearer.

Findings of coverage and scaling are in the solver.
"""

from __future__ import annotations

from documents.message import Code


class PersonCode(Code, prefix=""):
    """Findings on the body of a person, and reasons why it is not scaled."""

    SAME_NAME = (
        "two files of --markers give a trial the name {name}, expected different names; rename one, or give it once"
    )
    MASS_DOES_NOT_FIT = (
        "a body mass of {mass_kg:.0f} kg does not fit an upper arm of {upper_arm_m:.3f} m: expected {lowest_kg:.0f} to "
        "{highest_kg:.0f} kg; give the person's mass, not the model's, which is that of thorax and one arm"
    )
    HAND_HOLDS_LOAD = (
        "the hand of {model} weighs {hand_kg:.2f} kg, {ratio:.1f} times the mass expected for its upper arm, so it "
        "seems to hold a load; give the load of these trials with --held-mass (0 for an empty hand)"
    )
    MODEL_MASS_DOES_NOT_FIT = (
        "a mass of {mass_kg:.0f} kg gives the model an upper arm of {segment_kg:.1f} kg, expected {lowest_kg:.1f} to "
        "{highest_kg:.1f} kg for its length; the set-up's mass is the model's, thorax and one arm, not the subject's"
    )
    MARKERS_DO_NOT_FIT = (
        "the markers lie {rms_mm:.0f} mm (RMS) from the fitted body, expected less than {highest_mm:.0f} mm: check "
        "labels, units, side of the body and that all trials are of one person"
    )
    POSE_MOVES = (
        "marker {marker} moves by {range_mm:.0f} mm within the static pose, expected less than {highest_mm:.0f} mm; "
        "choose a time range in which the person stands still"
    )
    POSE_SWAYS = "marker {marker} moves by {range_mm:.0f} mm within the static pose; its mean is used"
    NOT_CONVERGED = "the estimate did not converge in {steps:step}; sizes and standard errors are not final"
    UNSOLVED_FRAMES = "{trial}: inverse kinematics is unsolved in {frames} of {all:frame}"
    LOCKS_REMOVED = "coordinates locked in the generic model are free in this body: {coordinates}"
    MARKER_FAR_OFF = (
        "{marker} lies {offset_mm:.0f} mm from where the model has it, {deviations:.1f} standard deviations: check its "
        "label and placement"
    )
    COORDINATE_OUT_OF_RANGE = (
        "{trial}: {coordinate} is at {value_deg:.0f} deg in the median, outside its range of {lowest_deg:.0f} to "
        "{highest_deg:.0f} deg: check the labels of the markers that it moves"
    )
    TENDON_CHANGED = (
        "{muscle}: tendon slack length changed by {change_mm:+.1f} mm, so that its fibre stays within the active range "
        "(went from {shortest:.2f} to {longest:.2f} of the optimal length)"
    )
    SEGMENT_MASS = "{segment}: the segment's mass is {ratio:.1f} times the expected one"
    HAND_MASS = (
        "{segment}: the segment's mass is {ratio:.1f} times the expected one; a load in the hand may be the reason"
    )
    JOINT_NOT_EVALUATED = "{trial}: muscles and joint force are not evaluated: {reason}"
    LARGE_JOINT_FORCE = (
        "{trial}: the joint force reaches {percent:.0f} % of body weight, expected at most {highest_percent:.0f} %; "
        "check the masses of body and load, in kg, and the labels of the markers"
    )


class SubjectCode(Code, prefix="subject."):
    """Fault of subject.toml, or file missing in its folder."""

    UNREADABLE = "{path} should describe the wearer, mass_kg at least, and cannot be read ({reason}); write it"
    INVALID_KEY = "{path}: {reason}; correct it"
    NO_MASS = (
        "the body mass of the wearer is not known, and the masses of the arm follow from it; enter it in the session's "
        "set-up, or as mass_kg in subject.toml"
    )
    UNKNOWN_MARKERS = "subject.toml names the markers {markers}, which {model} does not have; it has {known}"
    NO_MOTION = (
        "{folder} should hold a motion trial of the wearer and holds none, but {poses:pose trial}; record "
        "one with `station record --test motion`"
    )
    UNKNOWN_CUFF = (
        "subject.toml names the cuff {cuff} in the cord, the fitted arm cuffs are {known}; fit it or correct the name"
    )
    UNUSABLE_CUFF = (
        "the cuff {cuff} was worn when the tension of the cord was measured, and cannot be used: {reason}. To leave "
        "the comparison out, remove rest_length_m of [cord] in subject.toml"
    )


class KinematicsCode(Code):
    """Reasons why markers do not fit a model, and findings on postures."""

    NONE_IN_COMMON = (
        "markers.none_in_common",
        "{file} shares no marker with the model and the set-up: the set-up has {followed}, the model has {known}, "
        "the file has {found}; rename them, or give --prefix",
    )
    SEVERAL_PERSONS = (
        "markers.several_persons",
        "{file} has markers of several persons or sides ({labels}), expected those of one; choose with --prefix, or "
        "export one person",
    )
    NO_SUCH_PREFIX = (
        "markers.no_such_prefix",
        "{file} has no label that is a marker's name after the prefix {prefix}; prefixes found: {found}; correct "
        "--prefix, or leave it out",
    )
    MARKERS_MISSING = (
        "markers.too_few",
        "{file} shows {seen} of {expected} markers in most frames, expected at least 60 %; missing or mostly hidden: "
        "{missing}",
    )
    WRONG_SIZE = (
        "markers.wrong_size",
        "the markers of {file} are {size:.3g} times as far apart as those of {model}; correct the unit in the file",
    )
    ONE_IN_COMMON = (
        "markers.one_in_common",
        "{file} shares only the marker {name} with the model {model}, expected at least two; rename the others, or "
        "give --prefix",
    )
    MIRRORED = (
        "markers.mirrored",
        "the markers of {file} fit the mirror image of {model} ({mirrored_mm:.0f} mm RMS) better than the model itself "
        "({given_mm:.0f} mm): left and right, or some labels, are exchanged; correct the labels, or use a model of the "
        "other side",
    )
    NO_FIT = (
        "markers.no_fit",
        "the markers of {file} are {given_mm:.0f} mm (RMS) from those of {model}, expected less than "
        "{limit_mm:.0f} mm; check labels and unit, and that all are of one person",
    )
    TILTED = (
        "markers.tilted",
        "the body is tilted by {tilt_deg:.0f} deg from its default posture; if the person stood upright, the vertical "
        "axis of the file is not y: give it with --vertical",
    )
    EXCHANGED = (
        "markers.exchanged",
        "labels {one} and {other} are exchanged from {from_s:.2f} to {to_s:.2f} s (intervals: {count}): the postures "
        "there are wrong; correct the labels",
    )
    FAR = (
        "markers.far_off",
        "{marker} is up to {residual_mm:.0f} mm from its place on the model in {frames:frame}, the first at "
        "{first_s:.2f} s: the postures there are wrong; delete these positions, or correct the label",
    )
    NEVER_SEEN = (
        "markers.never_seen",
        "no frame shows {markers}: not used; check the labels of the file, or remove the tasks",
    )
    UNKNOWN_SET = (
        "marker_set.unknown",
        "there is no marker set {name}; choose from {known}, or a file that ends in .toml",
    )
    WRONG_SET = "marker_set.unreadable", "{path} cannot be read as a marker set: {reason}"
    NO_BODY = (
        "marker_set.no_body",
        "marker set {set}: {marker} is attached to {body}, which {model} does not have; it has {known}",
    )
    UNATTACHED = (
        "markers.body_not_in_model",
        "{markers}: {file} attaches them to bodies that the model does not have; they are not used",
    )
    WITHOUT_PLACE = (
        "marker_set.without_place",
        "{markers}: the location in the model is unknown, so they are not used; give location_m in your own marker set",
    )
    ELSEWHERE = (
        "marker_set.other_body",
        "{markers}: the model attaches them to other bodies than the marker set; the model is used",
    )
    WRONG_FACTOR = (
        "scale.factor",
        "{body} would be scaled by {factor:.2f} with the markers of {file}, expected {least:g} to {most:g}; check the "
        "labels, and the pairs of markers in the set-up",
    )
    WRONG_MANUAL_FACTOR = (
        "scale.manual_factor",
        "{body} has the manual factor {factor:.4g} in the set-up, expected {least:g} to {most:g}; correct its scales",
    )
    OTHER_RANGE = (
        "setup.time_range_overridden",
        "--from and --to override the set-up's time_range, {setup_range}: frames {range} are solved",
    )
    UNUSED_ELEMENTS = "setup.unused_elements", "{file} has elements that are not used: {elements}"
    NOT_IN_MODEL = (
        "setup.not_in_model",
        "{file} names {names}, absent from the model or from the markers' file, and not used",
    )
    FILE_ELSEWHERE = (
        "setup.file_elsewhere",
        "{file} names files that do not exist; those in its own folder are read: {files}",
    )
    RANGE_NOT_COVERED = (
        "markers.range_not_covered",
        "{file} does not cover the requested time, {range}: it lasts from {first_s:g} to {last_s:g} s. Only its own "
        "frames are solved",
    )
    NOT_HELD = (
        "posture.not_held",
        "no visible marker determines {coordinates} (frames: {frames}): the values there are not measured",
    )
    NOT_CONVERGED = "posture.not_converged", "frames not converged: {frames}, the first at {first_s:.2f} s"
    GAP_OPEN = "posture.gap_open", "frames off the constraints of the model: {frames}, the first at {first_s:.2f} s"
    NO_MARKERS = "posture.no_markers", "frames without markers: {frames}, the first at {first_s:.2f} s"
