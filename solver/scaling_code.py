"""Codes of findings on a scaled model; apart from what finds them, because that imports the compiler."""

from __future__ import annotations

from enum import StrEnum


class ScalingCode(StrEnum):
    """Stable codes of findings on a scaled model."""

    POINT_INSIDE_SURFACE = "point_inside_surface"
    FIBRE_LENGTH = "fibre_length"
    PATH_LENGTH = "path_length"
    FIBRE_LENGTH_IN_MOTION = "fibre_length_in_motion"
    PASSIVE_FORCE = "passive_force"
    PATH_JUMP = "path_jump"
