"""uncertainty.toml: sources of uncertainty, sample and decision rule; missing keys keep the bundled values."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Field

from documents.plain_data import parse_toml
from documents.regular_file import LARGEST_SUIT, read_regular
from documents.validation import NonNegative, Number, Positive, Section, Whole, refused_as
from solver.suit.decision import DecisionRule
from solver.uncertainty.sources import (
    BodySpread,
    DonningSpread,
    FitSpread,
    MotionSpread,
    MuscleSpread,
    Spread,
    UncertaintySources,
)
from station.defaults import LEAST_DRAWS
from station.errors import StationError
from station.messages.assessment_messages import InputCode

BUNDLED_BUDGET = Path(__file__).with_name("uncertainty.toml")
MOST_PEOPLE = 1_000_000
Degrees = Annotated[NonNegative, Field(le=20.0)]


class BudgetError(StationError):
    """An uncertainty.toml that cannot be used."""


def _ensure_enough(people: int) -> int:
    if people and people < LEAST_DRAWS:
        raise ValueError(f"expected at least {LEAST_DRAWS} people for 95 % intervals, or 0 for none, and got {people}")
    return people


class SampleSection(Section):
    """Number and design of the drawn people."""

    people: Annotated[Whole, AfterValidator(_ensure_enough), Field(le=MOST_PEOPLE)]
    method: Literal["latin_hypercube", "sobol"]
    seed: Annotated[Whole, Field(ge=0)]
    frames: Annotated[Whole, Field(ge=2)]


class DecisionSection(Section):
    """Smallest effect of interest, and the probability above which a statement is made."""

    relevant_difference: Annotated[Positive, Field(lt=1.0)]
    certainty: Annotated[Number, Field(ge=0.5, lt=1.0)]


class DonningSection(Section):
    """Relative spreads between donnings; estimate: use those of repeated donnings instead, where there are enough."""

    estimate: Annotated[bool, Field(strict=True)]
    stiffness: Spread
    damping: Spread
    migration: Spread


class MotionSection(Section):
    """Spreads of posture and cycles."""

    posture_deg: Degrees
    noise_deg: Degrees
    amplitude: Spread
    duration: Spread


class UncertaintyBudget(Section):
    """The keys of uncertainty.toml."""

    sample: SampleSection
    decision: DecisionSection
    fit: FitSpread
    donning: DonningSection
    body: BodySpread
    muscles: MuscleSpread
    motion: MotionSection

    @property
    def rule(self) -> DecisionRule:
        return DecisionRule(self.decision.relevant_difference, self.decision.certainty)

    @property
    def sources(self) -> UncertaintySources:
        """The spreads in SI units."""
        motion = self.motion
        return UncertaintySources(
            fit=self.fit,
            donning=DonningSpread(self.donning.stiffness, self.donning.damping, self.donning.migration),
            body=self.body,
            muscles=self.muscles,
            motion=MotionSpread(
                float(np.radians(motion.posture_deg)),
                float(np.radians(motion.noise_deg)),
                motion.amplitude,
                motion.duration,
            ),
        )


def read_budget(path: Path = BUNDLED_BUDGET, people: int | None = None) -> UncertaintyBudget:
    """Read the file, with this number of people in place of its own. Raises BudgetError, which names the key."""
    with refused_as(BudgetError, path, InputCode.BUDGET):
        merged: dict[str, Any] = {name: dict(section) for name, section in _bundled().items()}
        for name, section in _parsed(path).items():
            merged[name] = {**merged.get(name, {}), **section} if isinstance(section, dict) else section
        if people is not None and isinstance(merged["sample"], dict):
            merged["sample"]["people"] = people
        return UncertaintyBudget.model_validate(merged)


@lru_cache(maxsize=1)
def _bundled() -> dict[str, dict[str, Any]]:
    return _parsed(BUNDLED_BUDGET)


def _parsed(path: Path) -> dict[str, Any]:
    return parse_toml(read_regular(path, LARGEST_SUIT))
