"""study.json: the cuffs of many sessions, quantity by quantity. Its schema is published in docs/schemas.

Figures are shown in units of a study, with as many digits as their intervals bear.

normative.json: what volunteers of a study had, for comparison with the value of a later session.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from enum import StrEnum
from itertools import combinations
from pathlib import Path
from typing import Literal, get_args

from pydantic import ConfigDict, Field

from documents.interval import between, bracketed, shown
from documents.message import Message
from documents.plain_data import read_json
from documents.validation import FiniteSection, refused_as
from fitting.study.cuff_study import CuffComparison, CuffStudy, FixedEffect, Measure, Observation, analyse, compare
from recordings.manifest import DataOrigin
from station.checksums import file_sha256, write_checksums, write_whole
from station.cuff_text import SHOWN
from station.messages.study_messages import StudyCode
from station.progress import Progress, silent
from station.study.sessions import StudyError, StudySessions, select_measurements
from station.versions import solving_versions

FORMAT: Literal[1] = 1
"""It rises where a key changes its meaning, not where one is added."""
QuantityName = Literal["stiffness", "damping", "migration"]
"""In N/m, N s/m and m."""
OPEN = "not estimated"
STUDY_FILE = "study.json"
NORMATIVE_FILE = "normative.json"
NORMATIVE_FORMAT: Literal[1] = 1


@dataclass(frozen=True, kw_only=True)
class _OfQuantity:
    quantity: QuantityName


@dataclass(frozen=True, kw_only=True)
class ComparisonEntry(CuffComparison, _OfQuantity):
    """second − first, over the volunteers who wore both."""


class StudySessionEntry(FiniteSection):
    """A session of the study, with the hash of its cuffs.json."""

    folder: str
    volunteer: str
    operator: str
    begun: str
    cuffs_sha256: str


class LeftOutEntry(FiniteSection):
    """An omission and its reason."""

    code: StudyCode
    figures: dict[str, float | str] = Field(default_factory=dict)

    def __str__(self) -> str:
        return str(Message(self.code, self.figures))


class StudyDocument(FiniteSection):
    """study.json: variance components, reliability and comparison of cuffs over volunteers, in SI."""

    model_config = ConfigDict(revalidate_instances="always")  # also of what the analysis fills

    format: Literal[1]
    origin: DataOrigin
    sessions: list[StudySessionEntry]
    left_out: list[LeftOutEntry]
    cuffs: dict[str, dict[QuantityName, CuffStudy]]
    comparisons: list[ComparisonEntry]
    versions: dict[str, str]


def shown_effect(effect: FixedEffect | None, quantity: str) -> str:
    """Value and 95 % interval in the shown unit."""
    return OPEN if effect is None else bracketed(effect.value, effect.ci95, SHOWN[quantity].scale)


def shown_figure(figure: Measure, scale: float, digits: int = 0) -> str:
    """Value and 95 % interval; an upper end that is not found is open."""
    if figure.value is None:
        return OPEN
    if figure.ci95 is None or None in figure.ci95:
        low = figure.ci95[0] if figure.ci95 else None
        above = "" if low is None else f" (above {shown(scale * low, digits)})"
        return shown(scale * figure.value, digits) + above
    ends = (figure.ci95[0] or 0.0, figure.ci95[1] or 0.0)
    return bracketed(figure.value, ends, scale, digits)


def shown_range(ends: tuple[float, float], quantity: str) -> str:
    """Both ends with as many digits as two figures of half their distance."""
    return between(ends, SHOWN[quantity].scale)


def make_study(sessions: StudySessions, progress: Progress = silent) -> StudyDocument:
    """Analyse every quantity of every cuff, and compare every two cuffs."""
    left_out = list(sessions.left_out)
    by_quantity: dict[QuantityName, dict[str, list[Observation]]] = {}
    for quantity in get_args(QuantityName):
        by_cuff = by_quantity.setdefault(quantity, {})
        for session in sessions.sessions:
            found, missing = select_measurements(session, quantity)
            left_out += missing
            for cuff, measurements in found.items():
                by_cuff.setdefault(cuff, []).extend(measurements)
    cuffs: dict[str, dict[QuantityName, CuffStudy]] = {}
    total = sum(map(len, by_quantity.values()))
    for quantity, by_cuff in by_quantity.items():
        for cuff, measurements in by_cuff.items():
            progress("analysing cuffs", sum(map(len, cuffs.values())), total)
            cuffs.setdefault(cuff, {})[quantity] = analyse(measurements)
    progress("analysing cuffs", total, total)
    return StudyDocument(
        format=FORMAT,
        origin=sessions.origin,
        sessions=[
            StudySessionEntry(
                folder=session.folder.name,
                volunteer=session.volunteer,
                operator=session.operator,
                begun=session.begun,
                cuffs_sha256=session.sha256,
            )
            for session in sessions.sessions
        ],
        left_out=[LeftOutEntry(code=message.code, figures=dict(message.figures)) for message in left_out],
        cuffs=cuffs,
        comparisons=[
            ComparisonEntry(**vars(compare([*by_cuff[one], *by_cuff[other]], one, other)), quantity=quantity)
            for quantity, by_cuff in by_quantity.items()
            for one, other in combinations(by_cuff, 2)
        ],
        versions=solving_versions(),
    )


def write_study(folder: Path, document: StudyDocument) -> Path:
    """Write study.json into the folder."""
    text = json.dumps(document.model_dump(mode="json"), indent=1, ensure_ascii=False, allow_nan=False)
    write_whole(folder / STUDY_FILE, text + "\n")
    write_checksums(folder / STUDY_FILE)
    return folder / STUDY_FILE


class NormativePlace(StrEnum):
    """Position of a value relative to the 95 % prediction interval."""

    BELOW = "below"
    WITHIN = "within"
    ABOVE = "above"


class NormativeEntry(FiniteSection):
    """Mean over volunteers, and 95 % prediction interval of a new volunteer in one donning of `repeats` repeats, SI."""

    mean: float
    mean_ci95: tuple[float, float]
    prediction95: tuple[float, float]
    volunteers: int = Field(ge=2)
    repeats: int = Field(ge=1)

    def place(self, value: float) -> NormativePlace:
        """Position of the value of a donning."""
        low, high = self.prediction95
        if value < low:
            return NormativePlace.BELOW
        return NormativePlace.ABOVE if value > high else NormativePlace.WITHIN


class NormativeDocument(FiniteSection):
    """normative.json: cuff → quantity → mean and 95 % prediction interval; study_sha256 is the hash of study.json."""

    format: Literal[1]
    origin: DataOrigin
    study_sha256: str
    cuffs: dict[str, dict[QuantityName, NormativeEntry]]


def write_normative(study: Path, document: StudyDocument) -> Path:
    """Write the table beside study.json; only quantities with a prediction are in it."""
    table: dict[str, dict[QuantityName, NormativeEntry]] = {}
    for cuff, quantities in document.cuffs.items():
        for quantity, found in quantities.items():
            if found.mean is not None and found.prediction is not None:
                table.setdefault(cuff, {})[quantity] = NormativeEntry(
                    mean=found.mean.value,
                    mean_ci95=found.mean.ci95,
                    prediction95=found.prediction.ci95,
                    volunteers=len(found.volunteers),
                    repeats=found.repeats,
                )
    normative = NormativeDocument(
        format=NORMATIVE_FORMAT, origin=document.origin, study_sha256=file_sha256(study), cuffs=table
    )
    path = study.with_name(NORMATIVE_FILE)
    write_whole(path, json.dumps(normative.model_dump(mode="json"), indent=1, allow_nan=False) + "\n")
    write_checksums(path)
    return path


def read_normative(path: Path) -> NormativeDocument:
    """Raises StudyError for what `station study` would not write."""
    with refused_as(StudyError, path, StudyCode.WRONG_NORMATIVE):
        return NormativeDocument.model_validate(read_json(path))
