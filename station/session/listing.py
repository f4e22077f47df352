"""The sessions of a folder: subject, start, progress."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from station.journal import JournalError, Setup, read_journal
from station.journal_lines import JOURNAL_FILE
from station.session.plan_status import plan_status


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
            begun = _local(journal.begun)
            session = ListedSession(journal.setup, path.parent, begun, len(plan.done), len(plan.trials))
            listed.append((path.stat().st_mtime, session))
    return [session for _, session in sorted(listed, key=lambda entry: -entry[0])]


def _local(utc: str) -> datetime | None:
    try:
        return datetime.fromisoformat(utc).astimezone()
    except (ValueError, OverflowError, OSError):  # Windows has no local time of most years
        return None
