"""Spread between donnings of the budget: estimated where donnings were repeated, otherwise as declared."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Any

import numpy as np

from fitting.cuffs.cuffs_file import CUFFS_FILE, read_cuffs_document
from fitting.cuffs.wearable_cuff import QUANTITIES
from fitting.study.cuff_study import DonningSpreadEstimate, Observation, SpreadOutcome, estimate_donning_spread
from solver.uncertainty.sources import DonningSpread
from station.assessment.assessment_json import known
from station.assessment.number_entry import KnownNumberEntry, NumberEntry, StrictEntry
from station.checksums import sha256_of
from station.messages.codes import InputCode
from station.messages.message import Figures, Message
from station.study.sessions import StudySession, measurements_of, read_session, read_sessions, refuse_mixed


class DonningEntry(StrictEntry):
    """Relative spread of a quantity between donnings: estimated from repeated donnings, or that of the budget."""

    is_estimated: bool
    outcome: str
    spread: KnownNumberEntry
    degrees_of_freedom: NumberEntry
    donnings: KnownNumberEntry
    cuffs: KnownNumberEntry


@dataclass(frozen=True)
class DonningSources:
    """The declared spread, and of every quantity its estimate."""

    declared: DonningSpread
    estimates: Mapping[str, DonningSpreadEstimate]

    @property
    def spread(self) -> DonningSpread:
        """For the solver."""
        used = {
            quantity: estimate.spread if self.is_estimated(quantity) else getattr(self.declared, quantity)
            for quantity, estimate in self.estimates.items()
        }
        stiffness, damping, migration = (
            estimate.freedom if self.is_estimated(quantity) else inf for quantity, estimate in self.estimates.items()
        )
        return DonningSpread(**used, freedom=(stiffness, damping, migration))

    def is_estimated(self, quantity: str) -> bool:
        """Whether the estimate is used in place of the declared spread."""
        return self.estimates[quantity].outcome is SpreadOutcome.ESTIMATED

    @property
    def message(self) -> Message[InputCode]:
        """Which spread is used of every quantity, with its origin."""
        figures: Figures = {quantity: self._text(quantity) for quantity in self.estimates}
        return Message(InputCode.DONNING_SPREAD, figures)

    def plain(self) -> dict[str, Any]:
        """As of DonningEntry, by quantity."""
        return {quantity: self._plain(quantity, estimate) for quantity, estimate in self.estimates.items()}

    def _plain(self, quantity: str, estimate: DonningSpreadEstimate) -> dict[str, Any]:
        is_estimated = self.is_estimated(quantity)
        ends = [float(end) for end in estimate.ci95] if is_estimated and np.isfinite(estimate.ci95).all() else None
        return {
            "is_estimated": is_estimated,
            "outcome": estimate.outcome.value,
            "spread": {"value": getattr(self.spread, quantity), "ci95": ends},
            "degrees_of_freedom": {"value": estimate.freedom if is_estimated else None, "ci95": None},
            "donnings": known(estimate.donnings),
            "cuffs": known(estimate.cuffs),
        }

    def _text(self, quantity: str) -> str:
        estimate, percent = self.estimates[quantity], 100 * getattr(self.spread, quantity)
        if not self.is_estimated(quantity):
            return f"{quantity} {percent:.2g} % (declared)"
        low, high = (f"{100 * end:.2g}" for end in estimate.ci95)
        return f"{quantity} {percent:.2g} % (95 % CI {low} to {high}, {estimate.donnings} donnings)"


def donning_sources(
    declared: DonningSpread, cuffs: Path, chosen: Sequence[Path] = (), *, estimates: bool = True
) -> DonningSources:
    """Estimate the spread from the donnings of cuffs.json and of further session folders; without `estimates`, from
    none. Raises StudyError for a folder that is no session, or for measured sessions mixed with simulated ones.
    """
    sessions = _sessions(cuffs, chosen) if estimates else []
    found: dict[str, DonningSpreadEstimate] = {}
    for quantity in QUANTITIES:
        measurements: list[Observation] = []
        for session in sessions:
            by_cuff, _ = measurements_of(session, quantity)
            measurements += [one for values in by_cuff.values() for one in values]
        found[quantity] = estimate_donning_spread(measurements)
    return DonningSources(declared, found)


def _sessions(cuffs: Path, chosen: Sequence[Path]) -> list[StudySession]:
    """That of cuffs.json, which may be written by hand and have no volunteer, then the others."""
    own = read_session(cuffs.parent) if cuffs.name == CUFFS_FILE else None
    if not isinstance(own, StudySession):
        own = StudySession(cuffs.parent, "", "", "", read_cuffs_document(cuffs), sha256_of(cuffs))
    others = read_sessions(chosen).sessions if chosen else ()
    sessions = [own, *(session for session in others if session.folder.resolve() != own.folder.resolve())]
    refuse_mixed(sessions)
    return sessions
