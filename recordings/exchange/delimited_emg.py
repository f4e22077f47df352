"""EMG as text in columns, as Delsys, Noraxon, QTM and scripts export it: separated by tab, semicolon or comma.

Above the numbers is a line of titles, or QTM's header of keys (docs.qualisys.com, "Analog data (_a.tsv)"). Titles
may carry units: `AD [mV]`, `AD (uV)`, `AD_mv`, `AD, V`. Delsys writes a time column before every sensor and pads the
slower sensors at the end; only the channels that share the first one's clock are read.

The .exp files of the public shoulder data (Seth et al. 2019): a header, then frame numbers and a column per channel.

    <tab>// User name
    …
    1000.000<tab>// Measurement rate
    7.940<tab>// Data capture period
    …
    Frame #<tab>AD<tab>MD<tab>…

No unit is given. Some files of the set are bare numbers, without header and frame numbers.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from documents.interval import counted
from recordings.errors import ForeignFile, RecordingCode
from recordings.exchange.sample_tables import SignalTable, require_rising, require_single_channels
from recordings.exchange.text import MISSING, PRINTED_BY_C, is_number, read_lines, read_numbers

SEPARATORS = ("\t", ";", ",")
UNITS = {"v": "V", "mv": "mV", "uv": "uV", "µv": "uV", "μv": "uV"}
"""Spellings of a voltage's unit, in lower case → how it is called here."""
QTM_RATES = ("FREQUENCY", "CHANNEL_FREQUENCIES")
QTM_KEYS = (*QTM_RATES, "CHANNEL_NAMES", "CHANNEL_UNITS", "CHANNEL_GAIN", "CHANNEL_SAMPLE_COUNTS", "DATA_INCLUDED")
SECONDS = {"s": 1.0, "sec": 1.0, "seconds": 1.0, "ms": 1e-3}

_TIME = re.compile(
    r"(?:time|t)(?:\s*[\[(]\s*(s|sec|seconds|ms)\s*[\])]|[\s_,]+(s|sec|seconds|ms))?|x\s*[\[(]\s*(s|ms)\s*[\])]",
    re.IGNORECASE,
)
_COUNTER = re.compile(r"(?:frame|sample|index|no)s?(?:[\s_]*(?:#|no\.?|number))?|#|", re.IGNORECASE)
_BRACKETED = re.compile(r"(.+?)\s*[\[(]\s*([^\[\]()]*?)\s*[\])]")
_SUFFIXED = re.compile(r"(.+?)\s*[,_]\s*([muµμ]?v)", re.IGNORECASE)
_DELSYS_LABEL = re.compile(r"Label:\s*(.+?)\s+Sampling frequency:.*?\bUnit:\s*(\S+)")
FRAME = "Frame #"
_REMARK = re.compile(r"\s*([^\t]*?)\s*\t\s*//\s*(.*?)\s*$")


def read_delimited_emg(path: Path, rate_hz: float | None = None, labels: Sequence[str] = ()) -> SignalTable:
    """All channels of a file. rate_hz [Hz] and labels are for a file that lacks them, and do not overrule it.

    A column whose title names a unit other than a voltage, or on another clock than the first, is not read, but is
    listed in SignalTable.names.
    Raises ForeignFile where there are no numbers, no titles, no time and no rate, or a time does not rise.
    """
    lines = read_lines(path)
    first = next((i for i, line in enumerate(lines) if _is_row(line)), None)
    if first is None:
        raise ForeignFile(
            f"{path} holds no row of numbers, expected EMG in columns below a line of titles",
            RecordingCode.FOREIGN_NO_ROWS,
        )
    layout = _layout(lines[:first], lines[first], tuple(labels), path)
    values = read_numbers(lines[first:], layout.separator, range(len(layout.titles)), path, first + 1)
    time, columns = _shared_clock(values, layout.titles)
    if time is None:
        rate = layout.rate_hz or rate_hz
        if not rate:
            titles = ", ".join(layout.titles)
            raise ForeignFile(
                f"{path} has neither a time column nor a rate among {titles}; give rate_hz",
                RecordingCode.FOREIGN_NO_RATE,
            )
        time = np.arange(len(values)) / rate
    require_rising(time, f"{path}, time,", first + 1)
    units = {_named(layout.titles[i])[0]: layout.unit(i) for i in columns}
    voltages = {i: _named(layout.titles[i])[0] for i in columns if layout.unit(i) in ("", *UNITS.values())}
    _require_channels(tuple(voltages.values()), path)
    return SignalTable(
        time,
        {name: values[: len(time), i] for i, name in voltages.items()},
        {name: units[name] for name in voltages.values()},
        tuple(title if _TIME.fullmatch(title) else _named(title)[0] for title in layout.titles),
    )


@dataclass(frozen=True)
class _Layout:
    """The header above the numbers; rate_hz 0 and units {} if it does not state them."""

    separator: str
    titles: tuple[str, ...]
    rate_hz: float
    units: dict[str, str]

    def unit(self, column: int) -> str:
        """Our name of a voltage unit, otherwise the unit as in the file, "" without a unit."""
        name, unit = _named(self.titles[column])
        found = unit or self.units.get(name, "")
        return UNITS.get(found.lower(), found)


def _is_row(line: str) -> bool:
    """Whether it has at least two fields, all of them numbers."""
    fields = [field.strip().strip('"') for field in line.split(_separator(line))]
    filled = [field for field in fields if field]
    return len(filled) > 1 and all(_is_value(field) for field in filled)


def _separator(line: str) -> str:
    return next((mark for mark in SEPARATORS if mark in line), ",")


def _is_value(field: str) -> bool:
    """Whether it is a number, or written for one that is missing."""
    return field.lower() in MISSING or PRINTED_BY_C.fullmatch(field) is not None or is_number(field)


def _layout(above: Sequence[str], row: str, labels: tuple[str, ...], path: Path) -> _Layout:
    separator = _separator(row)
    keys = {key: values for line in above for key, *values in [_fields(line, "\t") or [""]] if key in QTM_KEYS}
    names = tuple(keys.get("CHANNEL_NAMES", ())) or labels
    titles = tuple(_fields(above[-1], separator)) if above else ()
    if not titles or titles[0] in QTM_KEYS:
        titles = names
    fields = row.split(separator)
    if len(fields) < len(titles) or any(field.strip() for field in fields[len(titles) :]):
        found = counted(len(titles), "title") if titles else "no line of titles"
        raise ForeignFile(
            f"{path} has {counted(len(fields), 'column')} and {found}, expected a title for each; where "
            "the file has none, "
            "give labels",
            RecordingCode.FOREIGN_TITLES,
        )
    rates = {float(rate) for key in QTM_RATES for rate in keys.get(key, ()) if _is_value(rate)}
    if len(rates) > 1:
        raise ForeignFile(
            f"{path} has channels of {_listed(rates)} Hz, expected one rate; export them one by one",
            RecordingCode.FOREIGN_CONTRADICTORY,
        )
    units = dict(zip(names, keys.get("CHANNEL_UNITS", ()), strict=False))
    units |= {label[1].strip(' "'): label[2] for line in above if (label := _DELSYS_LABEL.match(line.strip()))}
    return _Layout(separator, titles, next(iter(rates), 0.0), units)


def _listed(rates: set[float]) -> str:
    return " and ".join(f"{rate:g}" for rate in sorted(rates))


def _fields(line: str, separator: str) -> list[str]:
    """The fields of a line, without empty ones at its end; titles may be quoted and hold the separator."""
    fields = [field.strip() for field in next(csv.reader([line], delimiter=separator), [])]
    while fields and not fields[-1]:
        fields.pop()
    return fields


def _shared_clock(
    values: NDArray[np.float64], titles: Sequence[str]
) -> tuple[NDArray[np.float64] | None, tuple[int, ...]]:
    """Times (n,) [s] of the first clock, None without one, and the columns of the channels that go by it."""
    clocks = [i for i, title in enumerate(titles) if _TIME.fullmatch(title)]
    others = [i for i, title in enumerate(titles) if i not in clocks and not _COUNTER.fullmatch(title)]
    if not clocks:
        return None, tuple(others)
    first = values[:, clocks[0]]
    length = int(np.flatnonzero(np.isfinite(first))[-1]) + 1 if np.isfinite(first).any() else 0
    shared = [clock for clock in clocks if np.allclose(values[:length, clock], first[:length], rtol=0, atol=1e-6)]
    owner = {i: max((clock for clock in clocks if clock < i), default=clocks[0]) for i in others}
    found = _TIME.fullmatch(titles[clocks[0]])
    unit = next(filter(None, found.groups()), "s") if found else "s"
    return SECONDS[unit.lower()] * first[:length], tuple(i for i in others if owner[i] in shared)


def _named(title: str) -> tuple[str, str]:
    """A channel's name and unit, "" without one, of its title."""
    for pattern in (_BRACKETED, _SUFFIXED):
        if found := pattern.fullmatch(title):
            return found[1].strip(), found[2]
    return title, ""


def _require_channels(names: tuple[str, ...], path: Path) -> None:
    if not names:
        raise ForeignFile(
            f"{path} has no column that may be EMG: none without a unit, and none in V, mV or uV",
            RecordingCode.FOREIGN_NO_CHANNEL,
        )
    require_single_channels(names, str(path))


def read_exp(path: Path, rate_hz: float | None = None, labels: Sequence[str] = ()) -> SignalTable:
    """All channels, time from 0. rate_hz [Hz] and labels are for a file without header.

    Raises ForeignFile where the header has no rate, frames are missing, or fewer are there than announced.
    """
    lines = read_lines(path)
    titles = next((i for i, line in enumerate(lines[:50]) if line.split("\t", 1)[0].strip() == FRAME), None)
    if titles is None:
        if not labels or rate_hz is None:
            raise ForeignFile(
                f"{path} has no header (no line begins with {FRAME!r}), so neither a rate nor names of channels; "
                "give rate_hz and labels",
                RecordingCode.FOREIGN_NO_HEADER,
            )
        return read_delimited_emg(path, rate_hz, labels)
    header = {found[2]: found[1] for line in lines[:titles] if (found := _REMARK.match(line))}
    rate = _number(header, "Measurement rate", path)
    names = tuple(title.strip() for title in lines[titles].split("\t")[1:] if title.strip())
    if not names or len(set(names)) < len(names):
        raise ForeignFile(
            f"{path} names the channels {', '.join(names) or 'nowhere'}, expected each once",
            RecordingCode.FOREIGN_REPEATED_NAME,
        )
    values = read_numbers(lines[titles + 1 :], "\t", range(1 + len(names)), path, titles + 2)
    frames = values[:, 0]
    jumps = np.flatnonzero(~(np.diff(frames) == 1))
    if len(jumps):
        at = int(jumps[0]) + 1
        raise ForeignFile(
            f"{path} has frame {frames[at]:g} after {frames[at - 1]:g} in line {titles + 2 + at}, expected every "
            "frame; export it again",
            RecordingCode.FOREIGN_MISSING_FRAME,
        )
    announced = round(rate * _number(header, "Data capture period", path))
    if len(frames) < 2 or abs(len(frames) - announced) > 1:
        raise ForeignFile(
            f"{path} announces {counted(announced, 'frame')} and holds {len(frames)}; export it again, whole",
            RecordingCode.FOREIGN_CUT,
        )
    signals = {name: values[:, 1 + i] for i, name in enumerate(names)}
    return SignalTable((frames - frames[0]) / rate, signals, dict.fromkeys(names, ""), names)


def _number(header: dict[str, str], what: str, path: Path) -> float:
    try:
        found = float(header[what].replace(",", "."))
    except (KeyError, ValueError):
        found = 0.0
    if not 0 < found < 1e6:
        raise ForeignFile(
            f"{path} gives {what!r} as {header.get(what, 'nothing')}, expected a positive number",
            RecordingCode.FOREIGN_NO_RATE,
        )
    return found
