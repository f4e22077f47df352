"""The plan of a study, a TOML file, its designs, and what is written of it: plan.json, the configuration, a table.

The plan has what is expected, what is to be detected, and the choices. A design has number of volunteers, precision,
power and time of each combination of the choices.
"""

from __future__ import annotations

import itertools
import json
import math
import re
from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from documents.interval import counted
from documents.message import Message
from documents.plain_data import parse_toml, read_toml
from documents.regular_file import read_regular
from documents.validation import FiniteSection, NonNegative, Number, Positive, Section, Whole, refused_as
from fitting.study.power import (
    SETTLING,
    ExpectedSpread,
    InstrumentNoise,
    damping_error,
    difference_error,
    held_levels,
    migration_error,
    paired_power,
    stiffness_error,
)
from recordings.standard_gravity import g
from station.checksums import write_whole
from station.config import parse_config
from station.cuff_text import SHOWN
from station.folded_table import FoldedTable
from station.messages.study_messages import PlanCode
from station.study.sessions import StudyError

Several = Annotated[tuple[Annotated[Whole, Field(ge=1, le=100)], ...], Field(min_length=1)]
Part = Annotated[Number, Field(gt=0, lt=1)]
PLAN_FILE, CONFIG_FILE = "plan.json", "station.toml"
FORMAT: Literal[1] = 1
SECTION = re.compile(r"^\[protocol\][^\n]*\n(?:(?!\[).*\n?)*?(?=^(?:# )?\[|\Z)", re.M)
SHOWN_DESIGNS = 8
CUFFS = 2
FEWEST_VOLUNTEERS = 3
MOST_DESIGNS = 2000
REST_OF_SWING_S = 8.0
"""Seconds of a dynamic trial before and after the oscillation."""


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


class DetectSection(Section):
    """Difference of two cuffs over volunteers, in SI, and the power of the paired test."""

    quantity: Literal["stiffness", "damping", "migration"]
    difference: Positive
    power: Part = 0.9
    significance: Part = 0.05


class ChoicesSection(Section):
    """Choices of the protocol. Every combination of the lists is a design."""

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
    spread: ExpectedSpread
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
    with refused_as(StudyError, path, PlanCode.UNREADABLE, PlanCode.WRONG_TABLE):
        return StudyPlan.model_validate(read_toml(path))


ERROR_KEYS = {
    "stiffness": "stiffness_error_n_per_m",
    "damping": "damping_error_n_s_per_m",
    "migration": "migration_error_m",
}
"""Quantity → key of its standard error."""


class DesignOutcome(StrEnum):
    """Whether a design reaches the power with the volunteers that are possible."""

    REACHED = "reached"
    NOT_REACHED = "power_not_reached"


class DesignEntry(FiniteSection):
    """One design, in SI. Standard errors are those of one donning, from the noise of its trials."""

    outcome: DesignOutcome
    volunteers: int
    donnings: int
    repeats: int
    step_masses_kg: list[float]
    swing_frequency_hz: float
    stiffness_error_n_per_m: float
    damping_error_n_s_per_m: float
    migration_error_m: float
    difference_error: float = Field(description="standard error of the mean difference of the cuffs")
    power: float = Field(description="with this number of volunteers")
    session_minutes: Annotated[float, Field(description="of one volunteer with both cuffs")]
    total_hours: Annotated[float, Field(description="of all sessions")]


class StudyPlanDocument(FiniteSection):
    """plan.json: the designs of a study, the recommended one first, and the plan that they were computed from."""

    format: Literal[1]
    plan: StudyPlan
    designs: list[DesignEntry]


def write_plan(folder: Path, plan: StudyPlan, designs: Sequence[DesignEntry]) -> Path:
    """Write plan.json into the folder."""
    document = StudyPlanDocument(format=FORMAT, plan=plan, designs=list(designs))
    write_whole(folder / PLAN_FILE, json.dumps(document.model_dump(mode="json"), indent=1, allow_nan=False) + "\n")
    return folder / PLAN_FILE


def planned_config(config: Path, plan: StudyPlan, design: DesignEntry) -> str:
    """The station's configuration with the protocol of the design. Raises StudyError and ConfigError."""
    text = read_regular(config, 2**20).decode("utf-8-sig").replace("\r\n", "\n")
    if not SECTION.search(text):
        raise StudyError(Message(PlanCode.NO_PROTOCOL, {"path": str(config)}))
    masses = ", ".join(f"{mass:g}" for mass in design.step_masses_kg)
    section = (
        f"[protocol]                        # planned: {counted(design.volunteers, 'volunteer')}, "
        f"{counted(design.donnings, 'donning')} of each cuff, swing at {design.swing_frequency_hz:g} Hz\n"
        f"repeats = {design.repeats}\n"
        f"pause_s = {plan.time.pause_s:g}\n"
        f"hold_s = {plan.time.hold_s:g}\n"
        f"swing_s = {plan.time.swing_s:g}\n"
        f"step_masses_kg = [{masses}]\n\n"
    )
    planned = SECTION.sub(lambda _: section, text, count=1)
    parse_config(parse_toml(planned), str(config))
    return planned


def design_table(plan: StudyPlan, designs: Sequence[DesignEntry]) -> FoldedTable:
    """The first designs; the precision is that of the quantity to be detected, of one donning."""
    detect = plan.detect
    scale, unit = SHOWN[detect.quantity].scale, SHOWN[detect.quantity].unit
    title = f"Designs to detect a difference of {scale * detect.difference:g} {unit} in {detect.quantity}"
    names = ("volunteers", "donnings", "repeats", "weights [kg]", "swing [Hz]", f"noise [{unit}]", "power")
    table = FoldedTable(*names, "session [min]", "total [h]", title=title, title_justify="left")
    for design in designs[:SHOWN_DESIGNS]:
        table.add_row(
            str(design.volunteers),
            str(design.donnings),
            str(design.repeats),
            " + ".join(f"{mass:g}" for mass in design.step_masses_kg),
            f"{design.swing_frequency_hz:g}",
            f"{scale * getattr(design, ERROR_KEYS[detect.quantity]):.2g}",
            f"{100 * design.power:.0f} %",
            f"{design.session_minutes:.0f}",
            f"{design.total_hours:.0f}",
        )
    return table


def find_designs(plan: StudyPlan) -> list[DesignEntry]:
    """Every design; those that reach the power first, in the order of their total time. Raises StudyError."""
    choices = plan.choices
    lists = (choices.donnings, choices.repeats, choices.step_masses_kg, choices.swing_frequencies_hz)
    count = math.prod(map(len, lists))
    if count > MOST_DESIGNS:
        raise StudyError(Message(PlanCode.TOO_MANY_DESIGNS, {"designs": count, "most": MOST_DESIGNS}))
    designs = [_design(plan, *chosen) for chosen in itertools.product(*lists)]
    return sorted(designs, key=_rank)


def session_minutes(plan: StudyPlan, donnings: int, repeats: int, steps: int) -> float:
    """Of one volunteer with both cuffs: set-up, donnings, static and dynamic trials with a pause after each pair."""
    time = plan.time
    static = (2 * steps + 1) * time.hold_s
    trials = repeats * (static + time.swing_s + REST_OF_SWING_S + time.pause_s)
    return (time.setup_s + CUFFS * donnings * (time.donning_s + trials)) / 60


def _rank(design: DesignEntry) -> tuple[bool, float, float, float, float]:
    """Without the power, the design with most of it is first."""
    is_short = design.outcome is DesignOutcome.NOT_REACHED
    first = -design.power if is_short else design.total_hours
    return (is_short, first, design.total_hours, design.damping_error_n_s_per_m, design.stiffness_error_n_per_m)


def _design(plan: StudyPlan, donnings: int, repeats: int, masses: tuple[float, ...], frequency: float) -> DesignEntry:
    errors = _errors(plan, repeats, masses, frequency)
    detect, averaged = plan.detect, 1 if plan.detect.quantity == "migration" else repeats
    most = plan.choices.most_volunteers
    for volunteers in range(FEWEST_VOLUNTEERS, most + 1):
        error = difference_error(plan.spread, errors[detect.quantity], volunteers, donnings, averaged)
        power = paired_power(detect.difference, error, volunteers, detect.significance)
        if power >= detect.power:
            break
    minutes = session_minutes(plan, donnings, repeats, len(masses))
    return DesignEntry(
        outcome=DesignOutcome.REACHED if power >= detect.power else DesignOutcome.NOT_REACHED,
        volunteers=volunteers,
        donnings=donnings,
        repeats=repeats,
        step_masses_kg=list(masses),
        swing_frequency_hz=frequency,
        **{key: errors[quantity] for quantity, key in ERROR_KEYS.items()},
        difference_error=error,
        power=power,
        session_minutes=minutes,
        total_hours=volunteers * minutes / 60,
    )


def _errors(plan: StudyPlan, repeats: int, masses: tuple[float, ...], frequency: float) -> dict[str, float]:
    """Standard errors of one donning: the information of its repeats adds up."""
    one, expected, hold = plan.noise, plan.expected, plan.time.hold_s
    noise = InstrumentNoise(one.displacement_m, one.force_n, one.frame_rate_hz, one.force_rate_hz)
    k, steps = expected.stiffness_n_per_m, [mass * g for mass in masses]
    first = stiffness_error(k, held_levels(steps, is_first=True), hold, noise)
    later = stiffness_error(k, held_levels(steps, is_first=False), hold, noise)
    law = (k, expected.damping_n_s_per_m, expected.mass_kg)
    damping = damping_error(law, plan.choices.force_amplitude_n, frequency, plan.time.swing_s, noise)
    return {
        "stiffness": 1 / math.sqrt(first**-2 + (repeats - 1) * later**-2),
        "damping": damping / math.sqrt(repeats),
        "migration": migration_error(k, hold, noise),
    }
