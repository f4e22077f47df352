"""The sessions of a folder: subject, start, progress, and what a new session takes over from them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path

from station.checksums import JOURNAL_FILE
from station.config import StationConfig
from station.journal import JournalError, Setup, read_journal
from station.session.plan_status import plan_status
from station.subject.subject_file import Cord, Subject, SubjectError, read_subject


@dataclass(frozen=True)
class ListedSession:
    """done of its trials are accepted; begun is local time, None if the journal has no start."""

    setup: Setup
    folder: Path
    begun: datetime | None
    done: int
    trials: int


def list_sessions(folder: Path) -> list[ListedSession]:
    """Sessions in the subfolders, the one with the latest journal entry first."""
    listed = []
    for path in folder.glob(f"*/{JOURNAL_FILE}"):
        try:
            journal = read_journal(path.parent)
        except JournalError:
            continue
        if journal.setup is not None:
            plan = plan_status(journal.setup, journal, path.parent)
            begun = local_time(journal.begun)
            session = ListedSession(journal.setup, path.parent, begun, len(plan.done), len(plan.trials))
            listed.append((path.stat().st_mtime, session))
    return [session for _, session in sorted(listed, key=lambda entry: -entry[0])]


def local_time(utc: str) -> datetime | None:
    """Of a time in the journal; None for one that this computer cannot convert."""
    try:
        return datetime.fromisoformat(utc).astimezone()
    except (ValueError, OverflowError, OSError):  # Windows has no local time of most years
        return None


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
