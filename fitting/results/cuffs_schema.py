"""The schema of cuffs.json, with which it is written and read; published in docs/schemas/cuffs.schema.json.

Units are SI, named in the key. Only "cuffs" is required, and of a cuff only the figures that are used: a file may be
written by hand. Unknown keys are ignored.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from documents.plain_data import shortened
from fitting.results.codes import EXPLAINED_BY, CauseCode, FindingCode, FitOutcome, NoteCode, Standing, Verdict
from fitting.results.trial_codes import RejectionCode, TensorCode, TrialNoteCode
from recordings.manifest import DataOrigin

FORMAT: Literal[1] = 1
"""Version of the file format. It increases when a key changes its meaning; a file without one has this one."""

ROUNDING = 1e-6
"""Of a correlation."""
Vector = Annotated[list[float], Field(min_length=3, max_length=3)]
Matrix = Annotated[list[Vector], Field(min_length=3, max_length=3)]
Ends = Annotated[list[float], Field(min_length=2, max_length=2)]
Origin = Annotated[DataOrigin, Field(strict=False)]


class _Entry(BaseModel):
    model_config = ConfigDict(strict=True, frozen=True, allow_inf_nan=False)


class FigureEntry(_Entry):
    """A number with its standard error and 95 % interval; value is null where it is not identified."""

    value: float | None = None
    standard_error: float | None = Field(default=None, ge=0)
    ci95: Annotated[Ends | None, Field(description="lower and upper end of the 95 % interval")] = None
    parts: dict[str, float] = Field(default_factory=dict, description="standard error by cause; squares add up")
    cramer_rao_bound: float | None = None

    @model_validator(mode="after")
    def _ensure_order(self) -> Self:
        if self.ci95 is not None and self.ci95[0] > self.ci95[1]:
            raise ValueError(f"ci95 is {self.ci95}, expected the lower end first")
        return self


def _with_value(entry: Any) -> Any:
    if isinstance(entry, dict | FigureEntry):
        return entry
    if isinstance(entry, bool) or not isinstance(entry, int | float | None):
        raise ValueError(f"found {shortened(entry)}, expected a number or a table")
    return {"value": entry}


Figure = Annotated[FigureEntry, BeforeValidator(_with_value, json_schema_input_type=FigureEntry | float | None)]
"""An object, or a number alone."""


class _CodeEntry(_Entry):
    model_config = ConfigDict(from_attributes=True)  # of a note

    figures: Annotated[dict[str, float | str], Field(strict=False)] = Field(
        default_factory=dict, description="in SI with the unit in the name"
    )


class NoteEntry(_CodeEntry):
    """Remark on a donning."""

    code: Annotated[NoteCode, Field(strict=False)]

    @model_validator(mode="after")
    def _ensure_sentence(self) -> Self:
        """A note that leads a verdict becomes a sentence again."""
        if self.code in EXPLAINED_BY:
            try:
                self.code.sentence(self.figures)
            except (KeyError, ValueError) as error:
                found = shortened(self.figures)
                raise ValueError(f"{self.code} has the figures {found}, expected those of a fit; remove it") from error
        return self


class TrialNoteEntry(_CodeEntry):
    """Remark on a trial."""

    code: Annotated[TrialNoteCode, Field(strict=False)]


class ReasonEntry(_CodeEntry):
    """Why a recording is not used."""

    code: Annotated[RejectionCode, Field(strict=False)]


class TensorReasonEntry(_CodeEntry):
    """Why there is no tensor."""

    code: Annotated[TensorCode, Field(strict=False)]


class LagEntry(_Entry):
    value_s: float
    delay_standard_error_s: float
    edge_standard_error_s: float
    clock_rate_standard_error: float
    source: str


class CreepEntry(_Entry):
    is_seen: bool
    fraction: Figure
    time_constant_s: float | None
    stiffness_at_rest_n_per_m: Figure


class TangentEntry(_Entry):
    force_n: float
    stiffness_n_per_m: Figure


class ExponentialLawEntry(_Entry):
    stiffening_per_m: Figure
    tangents: list[TangentEntry]


class HeldLoadsEntry(_Entry):
    """Held loads beside the straight line."""

    hold_s: float
    zero_drift_n_per_s: Figure
    hysteresis_energy_j: Figure
    slip_m: float
    steps_s: dict[str, list[float]]
    creep: CreepEntry | None = None
    exponential_law: ExponentialLawEntry | None = None


class BandEntry(_Entry):
    frequency_hz: float
    stiffness_n_per_m: Figure
    damping_n_s_per_m: Figure


class TensorEntry(_Entry):
    """K or C in three dimensions, or the reason why there is none."""

    value: Matrix | None
    reason: str = Field(default="", description="reason_code as a sentence")
    reason_code: TensorReasonEntry | None = None
    standard_error: Matrix | None = None
    ci95: Annotated[list[Matrix] | None, Field(min_length=2, max_length=2)] = None
    parts: dict[str, Matrix] = Field(default_factory=dict)
    covariance: list[list[float]] | None = None
    eigenvalues: list[Figure] = Field(default_factory=list)
    axes: Matrix | None = None
    axes_ci95_rad: list[float] | None = None
    directions: int | None = None


class ClassEntry(_Entry):
    name: str = Field(alias="class")
    left_over_n: float = Field(description="residual RMS in repeats that were left out")
    gain: float


class ModelClassEntry(_Entry):
    """The law that describes the cuff: extensions of F = k x + c ẋ, none for that law alone."""

    chosen: str
    extensions: list[str]
    ranking: list[ClassEntry] = Field(default_factory=list)


class FindingEntry(_Entry):
    """A check D1 to D8."""

    code: str
    finding: Annotated[FindingCode | None, Field(strict=False)] = None
    name: str
    value: float
    standard_error: float | None
    unit: str
    alarm: bool
    figures: dict[str, float | str] = Field(default_factory=dict)
    sentence: str


class CauseEntry(_Entry):
    cause: str
    code: Annotated[CauseCode | None, Field(strict=False)] = None
    severity: float
    figures: dict[str, float | str] = Field(default_factory=dict)
    finding: Annotated[FindingCode | None, Field(strict=False)] = None
    sentence: str


class DiagnosisEntry(_Entry):
    findings: list[FindingEntry]
    causes: list[CauseEntry]


class SyncEntry(_Entry):
    """The trial's sync certificate."""

    has_both_edges: bool
    offset_s: float
    offset_standard_error_s: float
    clock_ratio_ppm: float
    clock_ratio_standard_error_ppm: float
    clock_ratio_ci95_ppm: Ends | None = None
    clock_ratio_is_identified: bool | None = None
    stop_edge_contradiction_s: float
    peak_force_rate_n_per_s: float
    peak_speed_m_per_s: float
    time_standard_error_s: float
    force_standard_error_n: float
    displacement_standard_error_m: float
    findings: list[str] = Field(description="finding_codes in sentences")
    finding_codes: list[TrialNoteEntry] = Field(default_factory=list)


class CrossCheckEntry(_Entry):
    method: str
    stiffness_n_per_m: Figure
    damping_n_s_per_m: Figure


class SwingEntry(_Entry):
    """A dynamic trial beside its damping."""

    method: str
    outcome: Annotated[FitOutcome | None, Field(strict=False)] = None
    frequency_hz: float
    force_amplitude_n: float
    dynamic_stiffness_n_per_m: Figure
    hysteresis_energy_j: Figure
    lag_s: float
    force_noise_n: float
    marker_noise_m: float
    marker_noise_correlation: float
    residual_at_harmonics_n: list[float]
    residual_between_harmonics_n: float
    cross_checks: list[CrossCheckEntry]
    complex_stiffness: list[BandEntry]


class TrialEntry(_Entry):
    """A recording's part in the fit."""

    file: str
    test: str
    repeat: int
    run: int
    state: Literal["used", "superseded", "unusable"]
    reason: str = Field(description="reason_code as a sentence; empty for a trial that is used")
    reason_code: ReasonEntry | None = None
    notes: list[str] = Field(description="note_codes in sentences")
    note_codes: list[TrialNoteEntry] = Field(default_factory=list)
    origin: Origin = DataOrigin.UNKNOWN
    damage: list[str] = Field(default_factory=list)
    sync: SyncEntry | None = None
    zero_drift_n: float | None = None
    stiffness_n_per_m: Figure = FigureEntry()
    damping_n_s_per_m: Figure = FigureEntry()
    migration_m: Figure = FigureEntry()
    dynamic: SwingEntry | None = None


POSSIBLE = {
    "stiffness_n_per_m": (1.0, 1e6, "N/m"),
    "damping_n_s_per_m": (0.0, 1e5, "N s/m"),
    "migration_m": (-0.5, 0.5, "m"),
}
"""Lowest and highest value of an identified cuff on a body, and its unit. Another value is in another unit."""


class CuffEntry(_Entry):
    """A cuff as last donned, or in one donning. What is not identified is null, and under not_identified."""

    stiffness_n_per_m: Figure = FigureEntry()
    damping_n_s_per_m: Figure = FigureEntry()
    migration_m: Figure = FigureEntry()
    not_identified: dict[str, Figure] | None = None
    verdict: str = Field(default="", description="verdict_codes in sentences")
    verdict_codes: list[Annotated[Verdict, Field(strict=False)]] = Field(default_factory=list)
    origin: Origin = DataOrigin.UNKNOWN
    site: Literal["arm", "waist"] | None = None
    donning: str | int = ""
    law: str | None = Field(default=None, description="by hand: kelvin_voigt, the only law that a suit wears")
    covariance: Matrix | None = Field(default=None, description="of stiffness, damping and migration")
    notes: list[str] = Field(default_factory=list, description="note_codes in sentences")
    note_codes: list[NoteEntry] = Field(default_factory=list)
    diagnostics: dict[str, float] = Field(default_factory=dict)
    lag: LagEntry | None = None
    static: HeldLoadsEntry | None = None
    hysteresis_energy_j: Figure = FigureEntry()
    complex_stiffness: list[BandEntry] = Field(default_factory=list)
    stiffness_tensor_n_per_m: TensorEntry | None = None
    damping_tensor_n_s_per_m: TensorEntry | None = None
    model_class: ModelClassEntry | None = None
    diagnosis: DiagnosisEntry | None = None
    sources: dict[str, str] = Field(default_factory=dict, description="file → SHA-256")
    trials: list[TrialEntry] = Field(default_factory=list)
    donnings: dict[str, CuffEntry] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _ensure_possible(self) -> Self:
        for key, (low, high, unit) in POSSIBLE.items():
            value = getattr(self, key).value
            if value is not None and not low <= value <= high:
                raise ValueError(f"{key} is {value:g} {unit}, expected {low:g} to {high:g} {unit}")
        return self

    @model_validator(mode="after")
    def _ensure_covariance(self) -> Self:
        if self.covariance is not None and not is_covariance(np.array(self.covariance)):
            raise ValueError("covariance is not a symmetric, positive semi-definite matrix")
        return self


def is_covariance(matrix: NDArray[Any]) -> bool:
    """Whether a matrix is one of three figures. Correlations are judged: variances differ by orders of magnitude."""
    if matrix.shape != (3, 3) or matrix.dtype.kind not in "fiu" or not np.isfinite(matrix).all():
        return False
    deviations = np.sqrt(np.diag(matrix).clip(min=0))
    if (np.abs(matrix) > np.outer(deviations, deviations) * (1 + ROUNDING)).any():
        return False
    scales = np.where(deviations > 0, deviations, 1.0)
    correlations = matrix / np.outer(scales, scales)
    return bool(np.allclose(correlations, correlations.T) and np.linalg.eigvalsh(correlations).min() >= -ROUNDING)


class RejectedEntry(_Entry):
    file: str
    reason: str = Field(description="reason_code as a sentence")
    reason_code: ReasonEntry | None = None
    damage: list[str] = Field(default_factory=list)


class CalibrationEntry(_Entry):
    """The load cell by the session's bounce trials."""

    lag_s: Figure
    gain: Figure
    gain_is_used: bool
    zero_n: Figure
    recorded_utc: str
    sources: dict[str, str]
    notes: list[str] = Field(description="note_codes in sentences")
    note_codes: list[TrialNoteEntry] = Field(default_factory=list)


class RecordingEntry(_Entry):
    standing: Annotated[Standing, Field(strict=False)]


class CuffsDocument(_Entry):
    """cuffs.json: the cuffs of a session, and the recordings that they are fitted from."""

    format: Literal[1]
    origin: Origin = DataOrigin.UNKNOWN
    cuffs: dict[str, CuffEntry]
    rejected: list[RejectedEntry] = Field(default_factory=list)
    calibration: CalibrationEntry | None = None
    recordings: dict[str, RecordingEntry] = Field(default_factory=dict)
