"""Findings of a result: the solver adds none, the station those that its terminal prints."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from enum import StrEnum
from typing import Protocol


class CodedFinding(Protocol):
    """A stable code and the figures of its sentence, which str() renders."""

    @property
    def code(self) -> StrEnum: ...

    @property
    def figures(self) -> Mapping[str, float | str]: ...


def describe_codes(findings: Iterable[CodedFinding]) -> str:
    """The last part of a repr: every code once; empty without findings."""
    codes = ", ".join(dict.fromkeys(finding.code for finding in findings))
    return f"; findings: {codes}" if codes else ""


class CoverageCode(StrEnum):
    """What a marker set does not determine."""

    THORAX_NOT_DETERMINED = "thorax_not_determined"
    NO_SCAPULA_MARKERS = "no_scapula_markers"
    FEW_SCAPULA_MARKERS = "few_scapula_markers"
    HUMERUS_NOT_DETERMINED = "humerus_not_determined"
    AXIAL_ROTATION_UNCERTAIN = "axial_rotation_uncertain"
    NO_FOREARM_MARKERS = "no_forearm_markers"


class ScalingCode(StrEnum):
    """Stable codes of findings on a scaled model."""

    POINT_INSIDE_SURFACE = "point_inside_surface"
    FIBRE_LENGTH = "fibre_length"
    PATH_LENGTH = "path_length"
    FIBRE_LENGTH_IN_MOTION = "fibre_length_in_motion"
    PASSIVE_FORCE = "passive_force"
    PATH_JUMP = "path_jump"
