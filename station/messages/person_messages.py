"""Findings on the scaled body of a person; those of coverage and scaling are in the solver."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum

from solver.coded_findings import CoverageCode, ScalingCode


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
    PersonCode.NOT_CONVERGED: "the estimate did not converge in {steps} steps; sizes and standard errors are not final",
    PersonCode.UNSOLVED_FRAMES: "{trial}: inverse kinematics is unsolved in {frames} of {all} frames",
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
