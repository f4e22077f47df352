"""study.json: the schema of a study; published in docs/schemas."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from fitting.study.cuff_study import ComparisonOutcome, ReliabilityOutcome, StudyOutcome
from fitting.study.variance_components import ComponentOutcome
from recordings.manifest import DataOrigin
from station.messages.study_codes import StudyCode

FORMAT: Literal[1] = 1
"""It rises where a key changes its meaning, not where one is added."""
QuantityName = Literal["stiffness", "damping", "migration"]
"""In N/m, N s/m and m."""


class _Entry(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class StudyFigure(_Entry):
    """A number with its 95 % interval; null where the design does not give it."""

    value: float | None
    ci95: tuple[float | None, float | None] | None = None


class EffectEntry(_Entry):
    """A mean, difference or prediction; ci95 of a prediction is the 95 % prediction interval."""

    value: float
    standard_error: float
    dof: float = Field(description="of Kenward and Roger; of a prediction, of Satterthwaite")
    ci95: tuple[float, float]


class ComponentEntry(_Entry):
    """A variance component as standard deviation."""

    outcome: ComponentOutcome
    levels: int
    sd: StudyFigure
    confounded_with: list[str] = Field(default_factory=list)


class ReliabilityEntry(_Entry):
    """Of one repeat in one donning by any operator: ICC(2,1), SEM, minimal detectable change."""

    outcome: ReliabilityOutcome
    icc: StudyFigure
    sem: StudyFigure
    mdc: StudyFigure


class VolunteerEntry(_Entry):
    """Mean over the donnings of a volunteer."""

    volunteer: str
    value: float
    ci95: tuple[float, float]
    donnings: int


class AgreementEntry(_Entry):
    """Bland–Altman analysis; means and differences of the pairs. limits are null for fewer than three pairs."""

    means: list[float]
    differences: list[float]
    bias: StudyFigure
    lower_limit: StudyFigure
    upper_limit: StudyFigure


class QuantityEntry(_Entry):
    """One quantity of one cuff, in SI.

    noise_sd is the mean known standard error of one repeat; repeats the median number in a donning, to which the
    prediction refers.
    """

    outcome: StudyOutcome
    measurements: int
    repeats: int
    noise_sd: float | None = None
    mean: EffectEntry | None = None
    prediction: EffectEntry | None = None
    components: dict[str, ComponentEntry] = Field(default_factory=dict)
    reliability: ReliabilityEntry | None = None
    volunteers: list[VolunteerEntry] = Field(default_factory=list)
    agreements: dict[str, AgreementEntry] = Field(default_factory=dict)


class ComparisonEntry(_Entry):
    """second − first, over the volunteers who wore both."""

    quantity: QuantityName
    first: str
    second: str
    volunteers: int
    outcome: ComparisonOutcome
    difference: EffectEntry | None = None


class StudySessionEntry(_Entry):
    """A session of the study, with the hash of its cuffs.json."""

    folder: str
    volunteer: str
    operator: str
    begun: str
    cuffs_sha256: str


class LeftOutEntry(_Entry):
    """What is left out, and why."""

    code: StudyCode
    figures: dict[str, float | str] = Field(default_factory=dict)


class StudyDocument(_Entry):
    """study.json: variance components, reliability and comparison of cuffs over volunteers, in SI."""

    format: Literal[1]
    origin: DataOrigin
    sessions: list[StudySessionEntry]
    left_out: list[LeftOutEntry]
    cuffs: dict[str, dict[QuantityName, QuantityEntry]]
    comparisons: list[ComparisonEntry]
    versions: dict[str, str]
