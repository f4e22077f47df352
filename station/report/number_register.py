"""The numbers of a page: each is marked with an id in its place, and listed with its source for report.json."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from markupsafe import Markup

from station.report.located import Derivation, LocatedFloat, LocatedInteger, LocatedText, Source
from station.report.pictures import Picture
from station.report.provenance import Provenance, figures_of
from station.report.report_file import DrawnFigureEntry, RenderingEntry, ReportedNumberEntry, SourceEntry
from station.report.sourced_number import Form, SourcedNumber, sourced

UNITS = {
    "n_per_m": "N/m",
    "n_s_per_m": "N s/m",
    "n_per_s": "N/s",
    "m": "m",
    "mm": "mm",
    "kg": "kg",
    "n": "N",
    "s": "s",
    "hz": "Hz",
    "rad": "rad",
    "percent": "%",
    "per_m": "1/m",
}
"""Suffix of a key → unit of its value."""
_SENTENCE = re.compile(r"(?=.*\d)(?=.*\s)", re.DOTALL)
"""A text with a number and a space; without a space it is a name or a hash."""
_RUNNING = "recordings"
"""First part of the id of a count over recordings."""


class NumberRegister:
    """Numbers and figures by the id of their element, in the order of the page.

    documents: file → content as plain data, from which the figures of sentences are taken
    """

    def __init__(self, provenance: Provenance, documents: Mapping[str, Any]) -> None:
        self.numbers: dict[str, ReportedNumberEntry] = {}
        self.figures: dict[str, DrawnFigureEntry] = {}
        self._provenance, self._documents = provenance, documents

    def mark(self, shown: object) -> object:
        """A number, or a text of a result that contains one, as an element with an id; anything else unchanged.

        The templates pass everything they print through it.
        """
        if isinstance(shown, LocatedText) and _SENTENCE.match(shown):
            shown = sourced(shown, Form.TEXT)
        elif isinstance(shown, LocatedFloat | LocatedInteger):
            shown = sourced(shown, Form.GENERAL)
        if not isinstance(shown, SourcedNumber):
            return shown
        key = self._new_id(shown.source)
        self.numbers[key] = self._entry(shown)
        if isinstance(shown.value, str):
            return Markup('<span class="number" id="{0}" title="{0}">{1}</span>').format(key, str(shown))
        element = Markup('<data class="number" id="{0}" value="{1}" title="{0}">{2}</data>')
        return element.format(key, attribute_of(self.numbers[key]), str(shown))

    def add_figures(self, section: str, pictures: Sequence[Picture], sources: Sequence[Source]) -> list[Picture]:
        """The figures of a section, whose drawings get an id."""
        marked = []
        for number, picture in enumerate(pictures, start=1):
            key = f"figure.{section}.{number}".replace(" ", ".")
            behind = dict.fromkeys(file for source in sources for file in self._provenance.recordings(source))
            self.figures[key] = DrawnFigureEntry(
                caption=picture.caption,
                sha256=drawing_hash(picture.drawing),
                sources=[SourceEntry(file=source.file, pointer=source.pointer) for source in sources],
                recordings=list(behind),
            )
            marked.append(replace(picture, drawing=f'<div id="{key}">{picture.drawing}</div><!-- {key} -->'))
        return marked

    def _new_id(self, source: Source) -> str:
        """From the place: the file without suffix, then the keys. A number that is shown again gets a counter."""
        stem = source.file.rpartition(".")[0] or _RUNNING
        keys = source.keys if source.keys[:1] == [stem] else [stem, *source.keys]
        if source.derivation is not Derivation.VALUE:
            keys.append(source.derivation)
        key = first = re.sub(r"\s", "_", ".".join(keys))
        count = 1
        while key in self.numbers:
            count += 1
            key = f"{first}-{count}"
        return key

    def _entry(self, number: SourcedNumber) -> ReportedNumberEntry:
        source, rendering, value = number.source, number.rendering, number.value
        draws = self._provenance.draws(source) if number.ci95 or isinstance(value, str) else None
        behind = self._provenance.recordings(source) if number.recordings is None else number.recordings
        return ReportedNumberEntry(
            text=str(number),
            value=[float(component) for component in value] if isinstance(value, tuple) else _plain(value),
            ci95=None if number.ci95 is None else [float(end) for end in number.ci95],
            censored=number.censored,
            unit="" if isinstance(value, str) else _unit(source),
            rendering=RenderingEntry(
                form=rendering.form, scale=rendering.scale, digits=rendering.digits, around=rendering.around
            ),
            source=SourceEntry(file=source.file, pointer=source.pointer, derivation=source.derivation),
            figures=figures_of(self._documents.get(source.file), source) if isinstance(value, str) else {},
            recordings=list(behind),
            draws=draws.count if draws else None,
            seed=draws.seed if draws else None,
        )


def attribute_of(number: ReportedNumberEntry) -> str:
    """The attribute `value` of the element of a number."""
    components = number.value if isinstance(number.value, list) else [number.value]
    return " ".join(map(repr, components))


def drawing_hash(drawing: str) -> str:
    """SHA-256 of a figure's HTML."""
    return hashlib.sha256(drawing.encode()).hexdigest()


def _plain(value: Any) -> Any:
    """A located value as a plain one."""
    return str(value) if isinstance(value, str) else float(value)


def _unit(source: Source) -> str:
    """By the suffix of the last key that has one."""
    if source.derivation in (Derivation.LENGTH, Derivation.DISTINCT) or "axes" in source.keys:
        return ""
    for key in reversed(source.keys):
        for suffix in sorted(UNITS, key=len, reverse=True):
            if key.endswith(f"_{suffix}"):
                return UNITS[suffix]
    return ""
