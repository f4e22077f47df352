"""Codes of findings on the scaled body of a person; those of coverage and scaling are in the solver."""

from __future__ import annotations

from enum import StrEnum


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
