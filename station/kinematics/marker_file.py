"""A file with markers on a body → its table under the names of the model's markers."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path

from recordings.exchange.c3d import read_c3d_markers
from recordings.exchange.qtm_tsv import read_qtm_tsv
from recordings.exchange.tables import MarkerTable
from recordings.exchange.trc import read_trc
from station.errors import StationError
from station.messages.codes import KinematicsCode
from station.messages.message import Message

LEAST_OF_A_PERSON = 3
"""Markers under one prefix that make another person, or the other side."""


class KinematicsError(StationError):
    """Markers that do not fit the model or the set-up; the code states the reason."""


def read_body_markers(path: Path, names: Collection[str], prefix: str = "") -> MarkerTable:
    """Read a .trc, .c3d or QTM's .tsv; names are those of the markers of the model or the set-up.

    QTM puts the person's name before the labels of a skeleton: "Anna_C7". A prefix that is the only one of the file
    is removed. Raises ForeignFile, or KinematicsError for a file of several persons.
    """
    table = _read(path, [prefix + name for name in names] if prefix else names)
    groups = _groups(table.labels, names)
    if prefix and not any(prefix + name in table.labels for name in names):
        figures = {"file": path.name, "prefix": prefix, "found": ", ".join(filter(None, groups)) or "none"}
        raise KinematicsError(Message(KinematicsCode.NO_SUCH_PREFIX, figures))
    if not prefix and not any(label in names for label in table.labels):
        several = [start for start, labels in groups.items() if len(labels) >= LEAST_OF_A_PERSON]
        if len(several) > 1:
            shown = ", ".join(sorted(groups[start][0] for start in several))
            raise KinematicsError(Message(KinematicsCode.SEVERAL_PERSONS, {"file": path.name, "labels": shown}))
        prefix = max(groups, key=lambda start: len(groups[start]), default="")
        if prefix:
            note = f"{path.name} has {prefix!r} before its labels, which is removed"
            table = replace(_read(path, [prefix + name for name in names]), notes=(*table.notes, note))
    labels = tuple(
        label.removeprefix(prefix) if prefix and label.removeprefix(prefix) in names else label
        for label in table.labels
    )
    return replace(table, labels=labels)


def _read(path: Path, tracked: Collection[str]) -> MarkerTable:
    match path.suffix.lower():
        case ".c3d":
            return read_c3d_markers(path)
        case ".tsv" | ".txt":
            return read_qtm_tsv(path)
        case _:
            return read_trc(path, tracked=tracked)


def _groups(labels: Sequence[str], names: Collection[str]) -> dict[str, list[str]]:
    """Text before the names or, for repeated labels, after them, with the labels that have it."""
    groups: dict[str, list[str]] = {}
    for label in labels:
        base, mark, number = label.rpartition("#")
        if mark and base in names:
            groups.setdefault(f"#{number}", []).append(label)
            continue
        name = max((name for name in names if name and label.endswith(name) and label != name), key=len, default=None)
        if name is not None:
            groups.setdefault(label.removesuffix(name), []).append(label)
    return groups
