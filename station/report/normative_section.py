"""The cuffs of this session beside those of the volunteers of a study, from normative.json in the session's folder."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from recordings.manifest import DataOrigin
from station.checksums import write_checksums
from station.report.cuff_section import Cuffs, figure_of
from station.report.located import LocatedInteger, LocatedObject, Source, located
from station.report.number_texts import Shown, estimated
from station.report.sourced_number import Form, SourcedNumber, sourced
from station.study.normative_file import NORMATIVE_FILE, NormativeEntry, NormativePlace, read_normative
from station.study.study_document import QuantityName
from station.study.units import SHOWN
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
    interval: SourcedNumber
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
    document = read_normative(path)
    places: LocatedObject = located(document.model_dump(mode="json")["cuffs"], Source(NORMATIVE_FILE, "/cuffs"))
    rows = tuple(row for name in cuffs for row in _rows(name, cuffs, document.cuffs.get(name) or {}, places))
    return NormativeSection(rows, document.origin, document.origin == origin)


def adopt_normative(table: Path, folder: Path) -> None:
    """Copy the table of a study into the session's folder, so that the report can be made and verified there.

    Raises StudyError for a file that is no such table.
    """
    read_normative(table)
    copy = folder / NORMATIVE_FILE
    if not copy.exists() or not copy.samefile(table):
        write_whole(copy, table.read_bytes())
    write_checksums(copy)


def _rows(
    name: str, cuffs: Cuffs, entries: Mapping[QuantityName, NormativeEntry], places: LocatedObject
) -> Iterator[NormativeRow]:
    for quantity, entry in entries.items():
        own = getattr(cuffs[name], quantity)
        (scale, unit), place = SHOWN[quantity], places[name][quantity]
        yield NormativeRow(
            name,
            f"{quantity} [{unit}]",
            estimated(figure_of(cuffs[name], quantity), scale),
            sourced(place["mean"], Form.INTERVAL, scale, ci95=place["mean_ci95"]),
            sourced(place["prediction95"], Form.RANGE, scale),
            PLACES[entry.place(own.value)] if own else "",
            place["volunteers"],
        )
