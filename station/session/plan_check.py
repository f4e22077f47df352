"""Whether a session can be done as it was set up."""

from __future__ import annotations

import re

from station.config import StationConfig
from station.journal import Setup

SUBJECT = re.compile(r"[A-Za-z0-9]{1,32}")
NAME = re.compile(r"\D*[^\W\d_]{3}\D*")


def looks_like_a_name(subject: str) -> bool:
    """Three letters in a row and no digit, as in Maria or de Vries; a code has a digit in it."""
    return NAME.fullmatch(subject.strip()) is not None


def fault_of(setup: Setup, config: StationConfig) -> str | None:
    """What is wrong with a setup, in one sentence; None where it can be done."""
    if not SUBJECT.fullmatch(setup.subject):
        return (
            f"the subject is {setup.subject!r}, expected a code of letters and digits, like P01: it becomes part "
            "of file names"
        )
    if not SUBJECT.fullmatch(setup.number):
        return f"the session is {setup.number!r}, expected letters and digits, like 1 or monday"
    unknown = [cuff for cuff in setup.cuffs if cuff not in config.cuffs]
    if unknown or not setup.cuffs:
        return f"no cuff {', '.join(unknown) or 'is chosen'}; the configuration has {', '.join(config.cuffs)}"
    if not all(mass > 0 for mass in setup.step_masses_kg):
        return f"the load steps are {setup.step_masses_kg} kg, expected masses above 0"
    return None


def masses_of(setup: Setup, config: StationConfig) -> tuple[float, ...]:
    """The session's load steps [kg]; those of the configuration where it has none of its own."""
    return setup.step_masses_kg or config.protocol.step_masses_kg


def plan_in_words(setup: Setup, config: StationConfig) -> str:
    masses = " + ".join(f"{mass:g}" for mass in masses_of(setup, config))
    return f"{setup.repeats} repeats of {', '.join(setup.cuffs)}" + (f" and steps of {masses} kg" if masses else "")
