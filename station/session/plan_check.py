"""Check the set-up of a session."""

from __future__ import annotations

import math
import re

from station.config import StationConfig
from station.journal import Setup
from station.journal_lines import MOST_REPEATS
from station.messages.codes import CommandCode
from station.messages.message import Message

SUBJECT = re.compile(r"[A-Za-z0-9]{1,32}")
NAME = re.compile(r"\D*[^\W\d_]{3}\D*")


def looks_like_a_name(subject: str) -> bool:
    """Three letters in a row and no digit, as in Maria or de Vries; a code has a digit in it."""
    return NAME.fullmatch(subject.strip()) is not None


def is_subject_code(subject: str) -> bool:
    """Whether it can be part of file names."""
    return SUBJECT.fullmatch(subject) is not None


def check_setup(setup: Setup, config: StationConfig) -> Message[CommandCode] | None:
    """The first fault of a set-up; None if there is none."""
    if not setup.subject:
        return Message(CommandCode.NO_SUBJECT)
    if not is_subject_code(setup.subject):
        return Message(CommandCode.WRONG_SUBJECT, {"subject": repr(setup.subject)})
    if not SUBJECT.fullmatch(setup.number):
        return Message(CommandCode.WRONG_NUMBER, {"number": repr(setup.number)})
    if not 1 <= setup.repeats <= MOST_REPEATS:
        return Message(CommandCode.WRONG_REPEATS, {"repeats": setup.repeats, "most": MOST_REPEATS})
    if not all(0 < mass < math.inf for mass in setup.step_masses_kg):
        return Message(CommandCode.WRONG_MASSES, {"masses": str(setup.step_masses_kg)})
    return _check_subjects(setup, config)


def _check_subjects(setup: Setup, config: StationConfig) -> Message[CommandCode] | None:
    """The first fault of the cuffs and of the wearer's trials; a session of the wearer's trials alone needs no cuff."""
    known = ", ".join(config.cuffs)
    if not setup.cuffs and not setup.conditions:
        return Message(CommandCode.NO_CUFF_CHOSEN, {"known": known})
    unknown = [cuff for cuff in setup.cuffs if cuff not in config.cuffs]
    if unknown:
        return Message(CommandCode.UNKNOWN_CUFF, {"unknown": ", ".join(unknown), "known": known})
    repeated = [cuff for cuff in dict.fromkeys(setup.cuffs) if setup.cuffs.count(cuff) > 1]
    if repeated:
        return Message(CommandCode.REPEATED_CUFF, {"repeated": ", ".join(repeated)})
    return Message(CommandCode.NO_BODY) if setup.conditions and config.body is None else None


def load_steps(setup: Setup, config: StationConfig) -> tuple[float, ...]:
    """The load steps of the session [kg]; those of the configuration if the set-up has none."""
    return setup.step_masses_kg or config.protocol.step_masses_kg


def describe_plan(setup: Setup, config: StationConfig) -> str:
    masses = " + ".join(f"{mass:g}" for mass in load_steps(setup, config))
    motions = f", motions {', '.join(setup.conditions)}" if setup.conditions else ""
    steps = f" and steps of {masses} kg" if masses else ""
    return f"{setup.repeats} repeats of {', '.join(setup.cuffs)}{steps}{motions}"
