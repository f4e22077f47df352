"""Numbers of the report: each knows its place in a result, has an id on the page, and is listed in report.json.

`located` copies a document or plain data; the copies behave as the values they replace and know their place. The
functions below it make a text of such a number, and `NumberRegister` gives each one that the templates print an id and
an entry. What is computed from a located number is plain again. Its provenance is its recordings, and random draws with
their seed.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from typing import Any, TypeVar, overload

import numpy as np
from markupsafe import Markup
from pydantic import BaseModel

from documents.interval import UNBROKEN, between, bracketed, plus_minus, rounded
from fitting.cuffs.cuffs_file import CUFFS_FILE
from fitting.results.codes import Standing
from fitting.results.cuffs_schema import CuffsDocument
from station.assessment.assessment_file import AssessmentDocument
from station.assessment.assessment_json import ASSESSMENT_FILE, NumberEntry, WornFigureEntry
from station.report.pictures import Picture
from station.report.report_file import Derivation, DrawnFigure, ReportedNumber, Source, pointer_below

UNKNOWN, NOT_IDENTIFIED = "–", "not identified"
UNITS = {unit.lower(): unit for unit in ("m", "mm", "kg", "N", "s", "Hz", "rad")}
UNITS |= {"n_per_m": "N/m", "n_s_per_m": "N s/m", "n_per_s": "N/s", "per_m": "1/m", "percent": "%"}
"""Suffix of a key → unit of its value."""
_BOUND_OF_SAVING = {"low": "high", "high": "low"}
"""A bound of an effort is the other bound of what is saved."""
_PERCENT = re.compile(r"(?<=\d) (?=%)")
"""The blank between a number and its sign, at which no line ends."""
_SENTENCE = re.compile(r"(?=.*\d)(?=.*\s)", re.DOTALL)
"""A text with a number and a space; without a space it is a name or a hash."""
Entry = BaseModel
"""Of a document: a number with its interval."""
Document = TypeVar("Document", bound=BaseModel)
WITHOUT_CUFFS = frozenset({"rigid", "bare_body_cost", "longest_cord_m", "reference_rest_length_m", "emg"})
"""Keys of assessment.json whose numbers do not depend on the cuffs."""


class Located:
    """A value with its file and JSON Pointer. Its Source is made on request, because few of thousands are shown."""

    place: tuple[str, str]

    @property
    def source(self) -> Source:
        return Source.of(*self.place)


class LocatedObject(Located, dict[str, Any]): ...


class LocatedList(Located, list[Any]): ...


class LocatedText(Located, str): ...


class LocatedFloat(Located, float): ...


class LocatedInteger(Located, int): ...


_PLACE = "place"
_LOCATED: dict[type, type[Any]] = {str: LocatedText, float: LocatedFloat, int: LocatedInteger}


@overload
def located(value: Document, source: Source) -> Document: ...
@overload
def located(value: object, source: Source) -> Any: ...
def located(value: Any, source: Source) -> Any:
    """A copy of a document or of plain data, every object, array, string and number with its place; source is that of
    the whole.

    Booleans, null and codes are not replaced.
    """
    return _located(value, source.file, source.pointer)


def _located(value: Any, file: str, pointer: str) -> Any:
    copy: Any
    if isinstance(value, BaseModel):
        fields = type(value).model_fields
        keys = {name: fields[name].serialization_alias or name if name in fields else name for name, _ in value}
        parts = {name: _located(part, file, pointer_below(pointer, keys[name])) for name, part in value}
        copy = value.model_copy(update=parts)
        object.__setattr__(copy, "__pydantic_private__", {_PLACE: Source.of(file, pointer)})  # beside its fields
        return copy
    if isinstance(value, Mapping):
        copy = LocatedObject({key: _located(part, file, pointer_below(pointer, key)) for key, part in value.items()})
    elif isinstance(value, list | tuple):
        copy = LocatedList([_located(part, file, f"{pointer}/{index}") for index, part in enumerate(value)])
    elif type(value) in _LOCATED:
        copy = _LOCATED[type(value)](value)
    else:
        return value
    copy.place = file, pointer
    return copy


@dataclass(frozen=True)
class Number:
    """A number of the report with its text and its place. A sentence with numbers is one, too, and so is a vector.

    recordings  on which it rests, None for those that the result of its source was computed from
    """

    text: str
    value: float | str | tuple[float, ...]
    source: Source
    ci95: tuple[float, float] | None = None
    recordings: tuple[str, ...] | None = None

    def __str__(self) -> str:
        return self.text

    @property
    def alone(self) -> Number:
        """The number without its interval, with the same digits."""
        return replace(self, text=self.text.partition(" (")[0])

    def within(self, text: str) -> Number:
        """The number in a longer text, in place of its braces."""
        return replace(self, text=text.replace("{}", self.text))


Shown = Number | str


def find_source(found: Any) -> Source:
    """The place of a located value. Raises KeyError or AttributeError for one without a place."""
    source: Source = (found.__pydantic_private__ or {})[_PLACE] if isinstance(found, BaseModel) else found.source
    return source


def interval(entry: Entry | None, scale: float = 1.0, most_digits: int | None = None) -> Shown:
    """`12.34 (12.21 to 12.47)` of an entry {"value", "ci95"}, with two digits of the half width; a fit without a value
    is not identified.

    most_digits: decimals that the measurement bears at most
    """
    return _bracketed(entry, NOT_IDENTIFIED, scale, most_digits or 0, is_limited=most_digits is not None)


def figure(entry: Entry | None, scale: float = 1.0, digits: int = 3) -> Shown:
    """The same of assessment.json and emg.json, with at most `digits` decimals; a dash where it is unknown.

    The interval of the fit alone would give it more decimals than the total uncertainty bears.
    """
    return _bracketed(entry, UNKNOWN, scale, digits, is_limited=True)


def worn(entry: Entry | None, scale: float = 1.0, digits: int = 3) -> Shown:
    """A parameter of a worn cuff, with its source where that is not the fit."""
    number = _bracketed(entry, UNKNOWN, scale, digits)
    is_by_hand = isinstance(entry, WornFigureEntry) and entry.source == Standing.BY_HAND
    return number.within("{} (given by hand)") if is_by_hand and isinstance(number, Number) else number


def saving(entry: NumberEntry) -> Shown:
    """`9.4 (2.0 to 15.1)`: per cent saved, from an effort relative to that with a slack cord; negative above 1."""
    return UNKNOWN if entry.value is None else _number(entry, _percent(entry, entry.value, -1.0))


def saving_in_words(entry: NumberEntry) -> Shown:
    """`9 % less effort than with a slack cord (95 % interval 2 to 15 %)`; `more` above 1."""
    if entry.value is None:
        return "effort not known"
    sign, word = (-1.0, "less") if entry.value <= 1.0 else (1.0, "more")
    number, _, brackets = _percent(entry, entry.value, sign).partition(" (")
    low, more, _ = brackets.removesuffix(")").partition(f"{UNBROKEN}or{UNBROKEN}more")
    interval = f" (95 % interval {low} %{more})" if brackets else ""
    return _number(entry, f"{number} % {word} effort than with a slack cord{interval}")


def half_width(entry: Entry, scale: float = 1.0, digits: int = 0) -> Number:
    """`12.34 ± 0.13`."""
    return _number(entry, plus_minus(*_parts(entry)[:2], scale, digits))


def ends(entry: Sequence[float], scale: float = 1.0) -> Number:
    """`12.21 to 12.47` of an interval alone."""
    return Number(between(entry, scale), tuple(entry), find_source(entry))


def mean_with(mean: float, ci95: Sequence[float], scale: float = 1.0) -> Number:
    """A located mean with its interval."""
    return Number(bracketed(mean, ci95, scale), mean, find_source(mean), (ci95[0], ci95[1]))


def fixed(number: Any, scale: float = 1.0, digits: int = 0) -> Number:
    """A located number, or a vector, with `digits` decimals."""
    if isinstance(number, LocatedList):
        text = ", ".join(_minus(rounded(scale * one, digits)) for one in number)
        return Number(text, tuple(number), number.source)
    return Number(_minus(rounded(scale * number, digits)), number, number.source)


def plain(number: Any) -> Number:
    """A located number with up to six digits, or a sentence as it is."""
    text = str(number) if isinstance(number, str) else _minus(f"{number:g}")
    return Number(text, str(number) if isinstance(number, str) else number, number.source)


def length(found: Any) -> Number:
    """The number of entries of a located list or object."""
    return Number(str(len(found)), len(found), find_source(found).derived(Derivation.LENGTH))


def total(found: LocatedList) -> Number:
    """The sum of a located list."""
    return Number(f"{sum(found):g}", sum(found), found.source.derived(Derivation.SUM))


def _parts(entry: Entry | None) -> tuple[Any, Any, Any]:
    """Value, ends of the interval, and the end that is a bound; an entry need not have both of these."""
    value, ci95, censored = (getattr(entry, key, None) for key in ("value", "ci95", "censored"))
    return value, ci95, censored


def _bracketed(entry: Entry | None, unknown: str, scale: float, digits: int, *, is_limited: bool = False) -> Shown:
    value, ci95, censored = _parts(entry)
    if entry is None or value is None:
        return unknown
    return _number(entry, bracketed(value, ci95, scale, digits, censored, is_limited=is_limited))


def _number(entry: Entry, text: str) -> Number:
    """Raises the errors of find_source."""
    value, ci95, _ = _parts(entry)
    given = tuple(value) if isinstance(value, list) else value
    return Number(text, given, find_source(entry), (ci95[0], ci95[1]) if ci95 else None)


def _percent(entry: NumberEntry, effort: float, sign: float) -> str:
    """Change of an effort from that with a slack cord, times the sign."""
    changes = sorted(sign * (end - 1.0) for end in entry.ci95 or ()) or None
    bound = entry.censored if sign > 0 else _BOUND_OF_SAVING.get(str(entry.censored), entry.censored)
    return bracketed(sign * (effort - 1.0), changes, 100.0, 1, bound, is_limited=True)


def _unbroken(text: str) -> str:
    return _PERCENT.sub(UNBROKEN, text)


def _minus(text: str) -> str:
    return text.replace("-", "−")


class NumberRegister:
    """Numbers and figures of a page by the id of their element, in the order of the page."""

    def __init__(self, provenance: Provenance) -> None:
        self.numbers: dict[str, ReportedNumber] = {}
        self.figures: dict[str, DrawnFigure] = {}
        self._provenance = provenance

    def mark(self, shown: object) -> object:
        """A number, or a text of a result that contains one, as an element with an id; anything else unchanged.

        The templates pass everything they print through it.
        """
        is_sentence = isinstance(shown, LocatedText) and _SENTENCE.match(shown)
        if is_sentence or isinstance(shown, LocatedFloat | LocatedInteger):
            shown = plain(shown)
        if not isinstance(shown, Number):
            return _unbroken(shown) if isinstance(shown, str) and not isinstance(shown, Markup) else shown
        shown = replace(shown, text=_unbroken(shown.text))
        key = self._new_id(shown.source)
        entry = self.numbers[key] = self._entry(shown)
        value = "" if entry.mark[1] is None else Markup(' value="{}"').format(entry.mark[1])
        tag = "data" if value else "span"
        return Markup('<{0} class="number" id="{1}"{2} title="{1}">{3}</{0}>').format(tag, key, value, shown.text)

    def add_figures(self, section: str, pictures: Sequence[Picture], sources: Sequence[Source]) -> list[Picture]:
        """The figures of a section, whose drawings get an id."""
        behind = list(dict.fromkeys(file for source in sources for file in self._provenance.recordings(source)))
        marked = []
        for number, picture in enumerate(pictures, start=1):
            key, digest = f"figure.{section}.{number}".replace(" ", "."), sha256(picture.drawing.encode()).hexdigest()
            self.figures[key] = DrawnFigure(
                caption=_unbroken(picture.caption), sha256=digest, sources=list(sources), recordings=behind
            )
            marked.append(replace(picture, drawing=f'<div id="{key}">{picture.drawing}</div><!-- {key} -->'))
        return marked

    def _new_id(self, source: Source) -> str:
        """From the place: the file without suffix, then the keys. A number that is shown again gets a counter."""
        stem = source.file.rpartition(".")[0] or "recordings"  # a count over them
        keys = source.keys if source.keys[:1] == [stem] else [stem, *source.keys]
        if source.derivation is not Derivation.VALUE:
            keys.append(source.derivation)
        first = re.sub(r"\s", "_", ".".join(keys))
        repeats = (f"{first}-{count}" for count in itertools.count(2))
        return next(key for key in itertools.chain([first], repeats) if key not in self.numbers)

    def _entry(self, number: Number) -> ReportedNumber:
        source, value = number.source, number.value
        draws, seed = self._provenance.draws(source) if number.ci95 or isinstance(value, str) else (None, None)
        behind = self._provenance.recordings(source) if number.recordings is None else number.recordings
        return ReportedNumber(
            text=number.text,
            value=value if isinstance(value, str) else np.asarray(value, float).tolist(),
            ci95=None if number.ci95 is None else [float(end) for end in number.ci95],
            unit="" if isinstance(value, str) else _unit(source),
            source=source,
            recordings=list(behind),
            draws=draws,
            seed=seed,
        )


def _unit(source: Source) -> str:
    """By the suffix of the last key that has one."""
    if source.derivation in (Derivation.LENGTH, Derivation.DISTINCT) or "axes" in source.keys:
        return ""
    suffixes = sorted(UNITS, key=len, reverse=True)
    found = (UNITS[suffix] for key in reversed(source.keys) for suffix in suffixes if key.endswith(f"_{suffix}"))
    return next(found, "")


@dataclass(frozen=True)
class Provenance:
    """Provenance of the numbers in cuffs.json and assessment.json; None without the file."""

    cuffs: CuffsDocument | None
    assessment: AssessmentDocument | None

    def recordings(self, source: Source) -> tuple[str, ...]:
        """Recordings from whose samples the value at this place was computed, including those of the calibration."""
        keys = source.keys
        if source.file.endswith(".mcap"):
            return (source.file,)
        if source.file == CUFFS_FILE:
            return tuple(dict.fromkeys(self._behind_cuffs_file(keys)))
        if source.file == ASSESSMENT_FILE and self.assessment is not None:
            return tuple(dict.fromkeys(self._behind_assessment(keys, self.assessment)))
        return ()

    def draws(self, source: Source) -> tuple[int, int] | tuple[None, None]:
        """Number of random draws behind the interval of an assessed number, and their seed."""
        if source.file != ASSESSMENT_FILE or self.assessment is None or source.keys[:1] in (["cuffs"], ["subject"]):
            return None, None
        settings = self.assessment.uncertainty
        return (settings.people.value, settings.seed.value) if settings else (None, None)

    def _behind_cuffs_file(self, keys: list[str]) -> Iterable[str]:
        if self.cuffs is None:
            return []
        calibration = list(self.cuffs.calibration.sources) if self.cuffs.calibration else []
        if keys[:1] == ["calibration"]:
            return calibration
        if keys[:1] == ["rejected"]:
            return [self.cuffs.rejected[int(keys[1])].file]
        cuff = self.cuffs.cuffs.get(keys[1] if len(keys) > 1 else "")
        if cuff is None:
            return calibration
        return (
            [cuff.trials[int(keys[3])].file, *calibration] if keys[2:3] == ["trials"] else [*cuff.sources, *calibration]
        )

    def _behind_assessment(self, keys: list[str], assessment: AssessmentDocument) -> Iterable[str]:
        wearer = [trial.file for trial in assessment.subject.trials] if assessment.subject else []
        if keys[:1] == ["subject"]:
            return wearer
        worn = assessment.cuffs
        named = [name for name in keys if name in worn] or ([] if WITHOUT_CUFFS & set(keys) else list(worn))
        worn_cuffs = dict.fromkeys([assessment.waist_cuff, *named] if named else ())
        return [*(file for name in worn_cuffs if name for file in self._behind_cuffs_file(["cuffs", name])), *wearer]
