"""The schema of the part of assessment.json on whose body and motion its figures are; SI, with the unit in the key."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict


class _Strict(BaseModel):
    model_config = ConfigDict(strict=True)


class MarkerResidual(_Strict):
    """Distance of the model's markers from the recorded ones in a trial."""

    file: str
    rms_m: float
    frames: int
    unsolved_frames: int


class BodyFactor(_Strict):
    """A scale factor of the generic model, with its 95 % interval."""

    value: float
    ci95: list[float]


class WearerFinding(_Strict):
    """A possible fault of the body or its markers; the codes are those of `station scale`."""

    code: str
    text: str


class CordTension(_Strict):
    """Measured tension of the cord beside the one predicted with arm_cuff, None for rigid cuffs; the offset has the
    zero of the load cell.
    """

    arm_cuff: str | None
    offset_n: float
    rms_n: float
    correlation: float | None
    largest_measured_n: float
    largest_predicted_n: float


class SubjectDocument(_Strict):
    """The wearer's body and motion."""

    mass_kg: float
    hand_load_kg: float
    origin: str
    motion: str
    condition: str
    frames: int
    interpolated_frames: int
    frames_left_out: int
    drawn_motions: int
    body_outcome: str
    is_whole: bool
    factors: dict[str, BodyFactor]
    trials: list[MarkerResidual]
    coordinates_not_measured: list[str]
    suit_point_spread_m: dict[str, float] | None
    cord: CordTension | None
    findings: list[WearerFinding]
