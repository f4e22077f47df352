"""The plan of a study, a TOML file: what is expected, what is to be detected, and the choices."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, ValidationError, model_validator

from documents.plain_data import PlainDataError, read_toml
from documents.regular_file import describe_failure
from documents.validation import NonNegative, Number, Positive, Section, Whole, describe_error
from fitting.study.information import SETTLING
from station.messages.message import Message
from station.messages.study_codes import PlanCode
from station.study.sessions import StudyError

Several = Annotated[tuple[Annotated[Whole, Field(ge=1, le=100)], ...], Field(min_length=1)]
Part = Annotated[Number, Field(gt=0, lt=1)]


class ExpectedSection(Section):
    """The cuffs as expected: k, c and the mass of the cuff."""

    stiffness_n_per_m: Positive
    damping_n_s_per_m: Positive
    mass_kg: NonNegative = 0.0


class NoiseSection(Section):
    """Standard deviations per sample, as in `diagnostics` of a cuffs.json.

    force_rate_hz: rate to which the fit averages the force.
    """

    displacement_m: Positive = 0.00026
    force_n: Positive = 0.28
    frame_rate_hz: Positive = 100.0
    force_rate_hz: Positive = 250.0


class SpreadSection(Section):
    """Standard deviations of the quantity to be detected, in its unit, as in study.json.

    volunteer_by_cuff: between volunteers, in the value of one cuff beyond what both cuffs share.
    """

    volunteer_by_cuff: NonNegative
    donning: NonNegative
    repeat: NonNegative = 0.0


class DetectSection(Section):
    """Difference of two cuffs over volunteers, in SI, and the power of the paired test."""

    quantity: Literal["stiffness", "damping", "migration"]
    difference: Positive
    power: Part = 0.9
    significance: Part = 0.05


class ChoicesSection(Section):
    """What may be chosen. Every combination of the lists is a design."""

    most_volunteers: Annotated[Whole, Field(ge=3, le=1000)] = 40
    donnings: Several = (1, 2, 3)
    repeats: Several = (1, 2, 3)
    step_masses_kg: Annotated[tuple[Annotated[tuple[Positive, ...], Field(min_length=2)], ...], Field(min_length=1)] = (
        (1.53, 1.53, 1.53, 1.53, 1.53),
    )
    swing_frequencies_hz: Annotated[tuple[Positive, ...], Field(min_length=1)] = (1.0,)
    force_amplitude_n: Positive = 12.0


class TimeSection(Section):
    """Durations. donning_s: one cuff is put on; setup_s: markers and calibration of a session."""

    setup_s: NonNegative = 1800.0
    donning_s: NonNegative = 300.0
    hold_s: Annotated[Number, Field(gt=SETTLING)] = 7.0
    swing_s: Positive = 20.0
    pause_s: NonNegative = 60.0


class StudyPlan(Section):
    """The plan of a study of two cuffs."""

    expected: ExpectedSection
    noise: NoiseSection = NoiseSection()
    spread: SpreadSection
    detect: DetectSection
    choices: ChoicesSection = ChoicesSection()
    time: TimeSection = TimeSection()

    @model_validator(mode="after")
    def _spread_is_above_zero(self) -> StudyPlan:
        if self.spread.volunteer_by_cuff + self.spread.donning + self.spread.repeat <= 0:
            raise ValueError("spread: all standard deviations are 0, expected at least one above 0")
        return self


def read_study_plan(path: Path) -> StudyPlan:
    """Raises StudyError that names a key that is missing, unknown or out of range."""
    try:
        return StudyPlan.model_validate(read_toml(path))
    except (OSError, PlainDataError) as error:
        raise StudyError(
            Message(PlanCode.UNREADABLE, {"path": str(path), "reason": describe_failure(error)})
        ) from error
    except ValidationError as error:
        figures = {"path": str(path), "reason": describe_error(error)}
        raise StudyError(Message(PlanCode.WRONG_TABLE, figures)) from error
