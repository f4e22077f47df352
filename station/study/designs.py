"""Designs of a study: number of volunteers, precision, power and time of each combination of the choices."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from enum import StrEnum

from fitting.study.information import (
    InstrumentNoise,
    damping_error,
    held_levels,
    migration_error,
    stiffness_error,
)
from fitting.study.power import ExpectedSpread, difference_error, paired_power
from recordings.standard_gravity import g
from station.messages.message import Message
from station.messages.study_codes import PlanCode
from station.study.plan_file import StudyPlan
from station.study.sessions import StudyError

CUFFS = 2
FEWEST_VOLUNTEERS = 3
MOST_DESIGNS = 2000
REST_OF_SWING_S = 8.0
"""Seconds of a dynamic trial before and after the oscillation."""


class DesignOutcome(StrEnum):
    """Whether a design reaches the power with the volunteers that are possible."""

    REACHED = "reached"
    NOT_REACHED = "power_not_reached"


@dataclass(frozen=True)
class StudyDesign:
    """One combination. Standard errors are those of one donning, from the noise of its trials, in SI.

    power is that with so many volunteers; session_minutes that of one volunteer with both cuffs.
    """

    outcome: DesignOutcome
    volunteers: int
    donnings: int
    repeats: int
    step_masses_kg: tuple[float, ...]
    swing_frequency_hz: float
    stiffness_error: float
    damping_error: float
    migration_error: float
    difference_error: float
    power: float
    session_minutes: float

    @property
    def total_hours(self) -> float:
        """Of all sessions."""
        return self.volunteers * self.session_minutes / 60


def find_designs(plan: StudyPlan) -> list[StudyDesign]:
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


def _rank(design: StudyDesign) -> tuple[bool, float, float, float, float]:
    """Without the power, the design with most of it is first."""
    is_short = design.outcome is DesignOutcome.NOT_REACHED
    first = -design.power if is_short else design.total_hours
    return (is_short, first, design.total_hours, design.damping_error, design.stiffness_error)


def _design(plan: StudyPlan, donnings: int, repeats: int, masses: tuple[float, ...], frequency: float) -> StudyDesign:
    errors = _errors(plan, repeats, masses, frequency)
    spread = ExpectedSpread(plan.spread.volunteer_by_cuff, plan.spread.donning, plan.spread.repeat)
    detect, averaged = plan.detect, 1 if plan.detect.quantity == "migration" else repeats
    most = plan.choices.most_volunteers
    for volunteers in range(FEWEST_VOLUNTEERS, most + 1):
        error = difference_error(spread, errors[detect.quantity], volunteers, donnings, averaged)
        power = paired_power(detect.difference, error, volunteers, detect.significance)
        if power >= detect.power:
            break
    return StudyDesign(
        outcome=DesignOutcome.REACHED if power >= detect.power else DesignOutcome.NOT_REACHED,
        volunteers=volunteers,
        donnings=donnings,
        repeats=repeats,
        step_masses_kg=masses,
        swing_frequency_hz=frequency,
        stiffness_error=errors["stiffness"],
        damping_error=errors["damping"],
        migration_error=errors["migration"],
        difference_error=error,
        power=power,
        session_minutes=session_minutes(plan, donnings, repeats, len(masses)),
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
