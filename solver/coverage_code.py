"""Codes of markers that leave segments open; apart from what finds them, because that imports the model."""

from __future__ import annotations

from enum import StrEnum


class CoverageCode(StrEnum):
    """What a marker set does not determine."""

    THORAX_NOT_DETERMINED = "thorax_not_determined"
    NO_SCAPULA_MARKERS = "no_scapula_markers"
    FEW_SCAPULA_MARKERS = "few_scapula_markers"
    HUMERUS_NOT_DETERMINED = "humerus_not_determined"
    AXIAL_ROTATION_UNCERTAIN = "axial_rotation_uncertain"
    NO_FOREARM_MARKERS = "no_forearm_markers"
