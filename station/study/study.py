"""A study: the cuffs of many sessions, quantity by quantity."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations

from fitting.cuffs.wearable_cuff import QUANTITIES
from fitting.study.cuff_study import CuffComparison, CuffStudy, analyse, compare
from fitting.study.measurements import Observation
from station.messages.message import Message
from station.messages.study_codes import StudyCode
from station.progress import Progress, silent
from station.study.sessions import StudySessions, measurements_of


@dataclass(frozen=True)
class Study:
    """Statistics by cuff and quantity, comparisons by quantity, in SI; left_out: sessions and donnings."""

    sessions: StudySessions
    cuffs: Mapping[str, Mapping[str, CuffStudy]]
    comparisons: Mapping[str, tuple[CuffComparison, ...]]
    left_out: tuple[Message[StudyCode], ...]


def make_study(sessions: StudySessions, progress: Progress = silent) -> Study:
    """Analyse every quantity of every cuff, and compare every two cuffs."""
    left_out = list(sessions.left_out)
    by_quantity: dict[str, dict[str, list[Observation]]] = {}
    for quantity in QUANTITIES:
        by_cuff = by_quantity.setdefault(quantity, {})
        for session in sessions.sessions:
            found, missing = measurements_of(session, quantity)
            left_out += missing
            for cuff, measurements in found.items():
                by_cuff.setdefault(cuff, []).extend(measurements)
    cuffs: dict[str, dict[str, CuffStudy]] = {}
    total = sum(map(len, by_quantity.values()))
    for quantity, by_cuff in by_quantity.items():
        for cuff, measurements in by_cuff.items():
            progress("analysing cuffs", sum(map(len, cuffs.values())), total)
            cuffs.setdefault(cuff, {})[quantity] = analyse(measurements)
    progress("analysing cuffs", total, total)
    comparisons = {quantity: _compare_all(by_cuff) for quantity, by_cuff in by_quantity.items()}
    return Study(sessions, cuffs, comparisons, tuple(left_out))


def _compare_all(by_cuff: Mapping[str, list[Observation]]) -> tuple[CuffComparison, ...]:
    return tuple(
        compare([*by_cuff[first], *by_cuff[second]], first, second) for first, second in combinations(by_cuff, 2)
    )
