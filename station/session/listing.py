"""The sessions of a folder: whose they are, when they began, how far they are."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from station.journal import JOURNAL_FILE, JournalError, Setup, read_journal
from station.session.agenda import agenda


@dataclass(frozen=True)
class ListedSession:
    """done of its trials are accepted; begun is local time, None where the journal does not tell."""

    setup: Setup
    folder: Path
    begun: datetime | None
    done: int
    trials: int


def list_sessions(folder: Path) -> list[ListedSession]:
    """Those in the folders of this one, the last one that anything was written of first."""
    found = []
    for path in folder.glob(f"*/{JOURNAL_FILE}"):
        try:
            journal = read_journal(path.parent)
        except JournalError:
            continue
        if journal.setup is not None:
            plan = agenda(journal.setup, journal, path.parent)
            begun = _local(journal.begun)
            listed = ListedSession(journal.setup, path.parent, begun, len(plan.done), len(plan.trials))
            found.append((path.stat().st_mtime, listed))
    return [listed for _, listed in sorted(found, key=lambda entry: -entry[0])]


def _local(utc: str) -> datetime | None:
    try:
        return datetime.fromisoformat(utc).astimezone()
    except ValueError:
        return None
