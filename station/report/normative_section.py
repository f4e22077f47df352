"""The cuffs of this session beside those of the volunteers of a study, from normative.json in the session's folder."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from fitting.cuffs.wearable_cuff import Cuff
from recordings.manifest import DataOrigin
from station.checksums import write_checksums
from station.report.cuff_section import Cuffs, figure_of
from station.report.numbers import LocatedInteger, LocatedObject, Number, Shown, ends, interval, located, mean_with
from station.report.report_file import Source
from station.study.study_document import (
    NORMATIVE_FILE,
    SHOWN,
    NormativeEntry,
    NormativePlace,
    QuantityName,
    read_normative,
)
from station.whole_file import write_whole

PLACES = {
    NormativePlace.BELOW: "below the interval",
    NormativePlace.WITHIN: "within the interval",
    NormativePlace.ABOVE: "above the interval",
}


@dataclass(frozen=True)
class NormativeRow:
    """One quantity of one cuff, in words; interval: 95 % prediction interval of a new volunteer in one donning."""

    cuff: str
    quantity: str
    own: Shown
    mean: Shown
    interval: Number
    place: str
    volunteers: LocatedInteger


@dataclass(frozen=True)
class NormativeSection:
    """has_same_origin: whether study and session are both measured, or both simulated."""

    rows: tuple[NormativeRow, ...]
    origin: DataOrigin
    has_same_origin: bool


def normative_section(folder: Path, cuffs: Cuffs, origin: DataOrigin) -> NormativeSection | None:
    """None without the file. Raises StudyError for one that `station study` would not write."""
    path = folder / NORMATIVE_FILE
    if not path.is_file():
        return None
    table = read_normative(path)
    places: LocatedObject = located(table.model_dump(mode="json")["cuffs"], Source.of(NORMATIVE_FILE, "/cuffs"))
    rows = tuple(row for name, fit in cuffs.items() for row in _rows(fit, table.cuffs.get(name) or {}, places))
    return NormativeSection(rows, table.origin, table.origin == origin)


def adopt_normative(table: Path, folder: Path) -> None:
    """Copy the table of a study into the session's folder, so that the report can be made and verified there.

    Raises StudyError for a file that is no such table.
    """
    read_normative(table)
    copy = folder / NORMATIVE_FILE
    if not copy.exists() or not copy.samefile(table):
        write_whole(copy, table.read_bytes())
    write_checksums(copy)


def _rows(fit: Cuff, entries: Mapping[QuantityName, NormativeEntry], places: LocatedObject) -> Iterator[NormativeRow]:
    for quantity, entry in entries.items():
        value = getattr(fit, quantity)
        (scale, unit), place = SHOWN[quantity], places[fit.name][quantity]
        yield NormativeRow(
            fit.name,
            f"{quantity} [{unit}]",
            interval(figure_of(fit, quantity), scale),
            mean_with(place, "mean", scale),
            ends(place["prediction95"], scale),
            PLACES[entry.place(value.value)] if value else "",
            place["volunteers"],
        )
