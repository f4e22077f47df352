"""What a new session takes over from the earlier ones of its folder: operator, plan, number, wearer."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from station.config import StationConfig
from station.journal import Setup
from station.session.listing import ListedSession
from station.subject.subject_file import Cord, Subject, SubjectError, read_subject


class EarlierSessions:
    """Suggestions from sessions in the order of list_sessions, the latest first."""

    def __init__(self, sessions: list[ListedSession], config: StationConfig) -> None:
        self.sessions, self._config = sessions, config

    @property
    def setup(self) -> Setup:
        """The plan of the last session, as far as the configuration still has it; else that of the configuration."""
        config = self._config
        conditions = config.body.conditions if config.body is not None else ()
        plan, has_bounce = config.protocol, config.bounce is not None
        default = Setup("", "", tuple(config.cuffs), plan.repeats, has_bounce, "1", plan.step_masses_kg, conditions)
        if not self.sessions:
            return default
        last = self.sessions[0].setup
        return replace(
            default,
            operator=last.operator,
            cuffs=tuple(cuff for cuff in last.cuffs if cuff in config.cuffs),
            repeats=last.repeats,
            has_bounce=has_bounce and last.has_bounce,
            step_masses_kg=last.step_masses_kg or plan.step_masses_kg,
            conditions=last.conditions if config.body is not None else (),
        )

    def number_of(self, subject: str) -> str:
        """The next free number of this subject."""
        used = {session.setup.number for session in self.sessions if session.setup.subject == subject}
        return str(1 + max((int(number) for number in used if number.isdecimal()), default=0))

    def wearer(self, subject: str) -> Subject:
        """Laboratory and suit as in the last session with a wearer, mass as in the last one of this subject."""
        known = [(listed.setup.subject, wearer) for listed in self.sessions if (wearer := _wearer_in(listed.folder))]
        if not known:
            return Subject()
        last = known[0][1]
        cord = last.cord
        if cord is not None and cord.cuff not in self._config.cuffs:
            cord = Cord(rest_length_m=cord.rest_length_m) if cord.rest_length_m is not None else None
        masses = (wearer.mass_kg for code, wearer in known if code == subject and wearer.mass_kg is not None)
        return last.model_copy(update={"mass_kg": next(masses, None), "cord": cord})


def _wearer_in(folder: Path) -> Subject | None:
    try:
        return read_subject(folder)
    except SubjectError:
        return None
