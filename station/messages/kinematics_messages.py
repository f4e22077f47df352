"""Messages on markers, postures and the body of a person, on subject.toml, and on poses and motions of the wearer.

Findings of coverage and scaling are in the solver.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum

from solver.errors import CoverageCode, ScalingCode
from station.messages.codes import CommandCode, CueCode, KinematicsCode, ReasonCode

KINEMATICS: Mapping[StrEnum, str] = {
    KinematicsCode.NONE_IN_COMMON: (
        "{file} shares no marker with the model and the set-up: the set-up has {followed}, the model has {known}, "
        "the file has {found}; rename them, or give --prefix"
    ),
    KinematicsCode.SEVERAL_PERSONS: (
        "{file} has markers of several persons or sides ({labels}), expected those of one; choose with --prefix, or "
        "export one person"
    ),
    KinematicsCode.NO_SUCH_PREFIX: (
        "{file} has no label that is a marker's name after the prefix {prefix}; prefixes found: {found}; correct "
        "--prefix, or leave it out"
    ),
    KinematicsCode.MARKERS_MISSING: (
        "{file} shows {seen} of {expected} markers in most frames, expected at least 60 %; missing or mostly hidden: "
        "{missing}"
    ),
    KinematicsCode.ONE_IN_COMMON: (
        "{file} shares only the marker {name} with the model {model}, expected at least two; rename the others, or "
        "give --prefix"
    ),
    KinematicsCode.WRONG_SIZE: (
        "the markers of {file} are {size:.3g} times as far apart as those of {model}; correct the unit in the file"
    ),
    KinematicsCode.MIRRORED: (
        "the markers of {file} fit the mirror image of {model} ({mirrored_mm:.0f} mm RMS) better than the model itself "
        "({given_mm:.0f} mm): left and right, or some labels, are exchanged; correct the labels, or use a model of the "
        "other side"
    ),
    KinematicsCode.NO_FIT: (
        "the markers of {file} are {given_mm:.0f} mm (RMS) from those of {model}, expected less than "
        "{limit_mm:.0f} mm; check labels and unit, and that all are of one person"
    ),
    KinematicsCode.TILTED: (
        "the body is tilted by {tilt_deg:.0f} deg from its default posture; if the person stood upright, the vertical "
        "axis of the file is not y: give it with --vertical"
    ),
    KinematicsCode.EXCHANGED: (
        "labels {one} and {other} are exchanged from {from_s:.2f} to {to_s:.2f} s (intervals: {count}): the postures "
        "there are wrong; correct the labels"
    ),
    KinematicsCode.FAR: (
        "{marker} is up to {residual_mm:.0f} mm from its place on the model in {frames:frame}, the first at "
        "{first_s:.2f} s: the postures there are wrong; delete these positions, or correct the label"
    ),
    KinematicsCode.NEVER_SEEN: (
        "no frame shows {markers}: not used; check the labels of the file, or remove the tasks"
    ),
    KinematicsCode.UNKNOWN_SET: "there is no marker set {name}; choose from {known}, or a file that ends in .toml",
    KinematicsCode.WRONG_SET: "{name} cannot be read as a marker set: {reason}",
    KinematicsCode.NO_BODY: (
        "marker set {set}: {marker} is attached to {body}, which {model} does not have; it has {known}"
    ),
    KinematicsCode.UNATTACHED: (
        "{markers}: {file} attaches them to bodies that the model does not have; they are not used"
    ),
    KinematicsCode.WITHOUT_PLACE: (
        "{markers}: the location in the model is unknown, so they are not used; give location_m in your own marker set"
    ),
    KinematicsCode.UNUSED_ELEMENTS: "{file} has elements that are not used: {elements}",
    KinematicsCode.FILE_ELSEWHERE: "{file} names files that do not exist; those in its own folder are read: {files}",
    KinematicsCode.NOT_IN_MODEL: (
        "{names}: {file} names them, and the model or the markers' file does not have them; they are not used"
    ),
    KinematicsCode.ELSEWHERE: (
        "{markers}: the model attaches them to other bodies than the marker set; the model is used"
    ),
    KinematicsCode.WRONG_FACTOR: (
        "{body} would be scaled by {factor:.2f} with the markers of {file}, expected {least:g} to {most:g}; check the "
        "labels, and the pairs of markers in the set-up"
    ),
    KinematicsCode.WRONG_MANUAL_FACTOR: (
        "{body} has the manual factor {factor:.4g} in the set-up, expected {least:g} to {most:g}; correct its scales"
    ),
    KinematicsCode.OTHER_RANGE: (
        "--from and --to override the set-up's time_range, {setup_range_s} s: frames from {range_s} s are solved"
    ),
    KinematicsCode.RANGE_NOT_COVERED: (
        "{file} does not cover the requested time, {range}: it lasts from {first_s:g} to {last_s:g} s. Only its own "
        "frames are solved"
    ),
    KinematicsCode.NOT_HELD: (
        "no visible marker determines {coordinates} (frames: {frames}): the values there are not measured"
    ),
    KinematicsCode.NOT_CONVERGED: "frames not converged: {frames}, the first at {first_s:.2f} s",
    KinematicsCode.GAP_OPEN: "frames off the constraints of the model: {frames}, the first at {first_s:.2f} s",
    KinematicsCode.NO_MARKERS: "frames without markers: {frames}, the first at {first_s:.2f} s",
}
WEARER_SENTENCES: Mapping[StrEnum, str] = {
    CommandCode.NO_BODY: (
        "motions are planned, but the configuration names no markers of the wearer; add [body] with its markers"
    ),
    CueCode.HOLD_POSE: "stand upright with the arm hanging, and keep still",
    CueCode.POSE_DONE: "pose held; end the capture",
    CueCode.RAISE_ARM: "raise the arm: cycle {cycle:.0f} of {cycles:.0f}",
    CueCode.LOWER_ARM: "lower the arm: cycle {cycle:.0f} of {cycles:.0f}",
    CueCode.MOTION_DONE: "{cycles:cycle} counted: let the arm hang, then end the capture",
    CueCode.MOVE_UNCOUNTED: (
        "raise and lower the arm {cycles:time}, then end the capture; cycles are counted only with arm and trunk "
        "under [body]"
    ),
    CueCode.CONTRACT: "contract as strongly as possible for 3 to 5 s, with rests between; then end the capture",
    ReasonCode.MARKERS_HIDDEN: (
        "hidden in more than {limit_percent:.0f} % of the frames: {markers}; turn the cameras or replace the markers"
    ),
    ReasonCode.POSE_MOVES: (
        "marker {marker} moves by {range_mm:.0f} mm within the static pose, expected less than {highest_mm:.0f} mm"
    ),
    ReasonCode.CYCLES_MISSING: "{found:arm cycle} found, expected {planned:.0f}",
    ReasonCode.EMG_UNUSABLE: "EMG {channel}: {text}",
    ReasonCode.NO_EMG_CLOCK: "{text}",
}


class PersonCode(StrEnum):
    """Findings on the body of a person, and reasons why it is not scaled."""

    SAME_NAME = "same_name"
    MASS_DOES_NOT_FIT = "mass_does_not_fit"
    HAND_HOLDS_LOAD = "hand_holds_load"
    MODEL_MASS_DOES_NOT_FIT = "model_mass_does_not_fit"
    MARKERS_DO_NOT_FIT = "markers_do_not_fit"
    POSE_MOVES = "pose_moves"
    POSE_SWAYS = "pose_sways"
    NOT_CONVERGED = "not_converged"
    UNSOLVED_FRAMES = "unsolved_frames"
    LOCKS_REMOVED = "locks_removed"
    MARKER_FAR_OFF = "marker_far_off"
    COORDINATE_OUT_OF_RANGE = "coordinate_out_of_range"
    TENDON_CHANGED = "tendon_changed"
    SEGMENT_MASS = "segment_mass"
    HAND_MASS = "hand_mass"
    JOINT_NOT_EVALUATED = "joint_not_evaluated"
    LARGE_JOINT_FORCE = "large_joint_force"


PERSON_SENTENCES: Mapping[StrEnum, str] = {
    PersonCode.SAME_NAME: (
        "two files of --markers give a trial the name {name}, expected different names; rename one, or give it once"
    ),
    PersonCode.MASS_DOES_NOT_FIT: (
        "a body mass of {mass_kg:.0f} kg does not fit an upper arm of {upper_arm_m:.3f} m: expected {lowest_kg:.0f} to "
        "{highest_kg:.0f} kg; give the person's mass, not the model's, which is that of thorax and one arm"
    ),
    PersonCode.HAND_HOLDS_LOAD: (
        "the hand of {model} weighs {hand_kg:.2f} kg, {ratio:.1f} times the mass expected for its upper arm, so it "
        "seems to hold a load; give the load of these trials with --held-mass (0 for an empty hand)"
    ),
    PersonCode.MODEL_MASS_DOES_NOT_FIT: (
        "a mass of {mass_kg:.0f} kg gives the model an upper arm of {segment_kg:.1f} kg, expected {lowest_kg:.1f} to "
        "{highest_kg:.1f} kg for its length; the set-up's mass is the model's, thorax and one arm, not the subject's"
    ),
    PersonCode.MARKERS_DO_NOT_FIT: (
        "the markers lie {rms_mm:.0f} mm (RMS) from the fitted body, expected less than {highest_mm:.0f} mm: check "
        "labels, units, side of the body and that all trials are of one person"
    ),
    PersonCode.POSE_MOVES: (
        "marker {marker} moves by {range_mm:.0f} mm within the static pose, expected less than {highest_mm:.0f} mm; "
        "choose a time range in which the person stands still"
    ),
    PersonCode.POSE_SWAYS: "marker {marker} moves by {range_mm:.0f} mm within the static pose; its mean is used",
    PersonCode.NOT_CONVERGED: "the estimate did not converge in {steps:step}; sizes and standard errors are not final",
    PersonCode.UNSOLVED_FRAMES: "{trial}: inverse kinematics is unsolved in {frames} of {all:frame}",
    PersonCode.LOCKS_REMOVED: "coordinates locked in the generic model are free in this body: {coordinates}",
    PersonCode.MARKER_FAR_OFF: (
        "{marker} lies {offset_mm:.0f} mm from where the model has it, {deviations:.1f} standard deviations: check its "
        "label and placement"
    ),
    PersonCode.COORDINATE_OUT_OF_RANGE: (
        "{trial}: {coordinate} is at {value_deg:.0f} deg in the median, outside its range of {lowest_deg:.0f} to "
        "{highest_deg:.0f} deg: check the labels of the markers that it moves"
    ),
    PersonCode.TENDON_CHANGED: (
        "{muscle}: tendon slack length changed by {change_mm:+.1f} mm, so that its fibre stays within the active range "
        "(went from {shortest:.2f} to {longest:.2f} of the optimal length)"
    ),
    PersonCode.SEGMENT_MASS: "{segment}: the segment's mass is {ratio:.1f} times the expected one",
    PersonCode.HAND_MASS: (
        "{segment}: the segment's mass is {ratio:.1f} times the expected one; a load in the hand may be the reason"
    ),
    PersonCode.JOINT_NOT_EVALUATED: "{trial}: muscles and joint force are not evaluated: {reason}",
    PersonCode.LARGE_JOINT_FORCE: (
        "{trial}: the joint force reaches {percent:.0f} % of body weight, expected at most {highest_percent:.0f} %; "
        "check the masses of body and load, in kg, and the labels of the markers"
    ),
    CoverageCode.THORAX_NOT_DETERMINED: (
        "fewer than three markers on the thorax: no segment has a reference; add IJ, PX, C7 or T8"
    ),
    CoverageCode.NO_SCAPULA_MARKERS: (
        "no marker on the scapula, or one: its orientation is not measured, it follows from the acromioclavicular "
        "joint and the coordinate tasks; add an acromion cluster, calibrated with AA, TS and AI"
    ),
    CoverageCode.FEW_SCAPULA_MARKERS: (
        "two markers on the scapula: coordinate tasks decide part of its posture; add an acromion cluster"
    ),
    CoverageCode.HUMERUS_NOT_DETERMINED: "no marker on the upper arm: add a cluster or both epicondyles",
    CoverageCode.AXIAL_ROTATION_UNCERTAIN: (
        "axial rotation of the arm depends on the epicondyles alone and is uncertain; add a cluster or a forearm marker"
    ),
    CoverageCode.NO_FOREARM_MARKERS: "no marker on the forearm: elbow flexion and pronation are not measured",
    ScalingCode.POINT_INSIDE_SURFACE: "{muscle}: a path point lies inside {surface}, unlike in the generic model",
    ScalingCode.FIBRE_LENGTH: "{muscle}: its fibre is {figure:.2f} of the optimal length in the default posture",
    ScalingCode.PATH_LENGTH: "{muscle}: its path is {figure:.2f} times as long, relative to the median of all muscles",
    ScalingCode.FIBRE_LENGTH_IN_MOTION: "{muscle}: its fibre reaches {figure:.2f} of the optimal length in the motion",
    ScalingCode.PASSIVE_FORCE: "{muscle}: its passive force reaches {figure:.2f} of the maximum isometric force",
    ScalingCode.PATH_JUMP: "{muscle}: the length of its path jumps by {jump_mm:.0f} mm between two frames",
}


class SubjectCode(StrEnum):
    """What is wrong with subject.toml, or missing in its folder."""

    UNREADABLE = "subject.unreadable"
    INVALID_KEY = "subject.invalid_key"
    NO_MASS = "subject.no_mass"
    UNKNOWN_MARKERS = "subject.unknown_markers"
    NO_MOTION = "subject.no_motion"
    UNKNOWN_CUFF = "subject.unknown_cuff"


SUBJECT: Mapping[StrEnum, str] = {
    SubjectCode.UNREADABLE: (
        "{path} should describe the wearer, mass_kg at least, and cannot be read ({reason}); write it"
    ),
    SubjectCode.INVALID_KEY: "{path}: {reason}; correct it",
    SubjectCode.NO_MASS: (
        "the body mass of the wearer is not known, and the masses of the arm follow from it; enter it in the session's "
        "set-up, or as mass_kg in subject.toml"
    ),
    SubjectCode.UNKNOWN_MARKERS: (
        "subject.toml names the markers {markers}, which {model} does not have; it has {known}"
    ),
    SubjectCode.NO_MOTION: (
        "{folder} should hold a motion trial of the wearer and holds none, but {poses:pose trial}; record "
        "one with `station record --test motion`"
    ),
    SubjectCode.UNKNOWN_CUFF: (
        "subject.toml names the cuff {cuff} in the cord, and the cuffs file holds {known}; fit it or correct the name"
    ),
}
