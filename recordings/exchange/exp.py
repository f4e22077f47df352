"""The .exp files of the public shoulder data (Seth et al. 2019): a header, then frame numbers and a column per channel.

    <tab>// User name
    …
    1000.000<tab>// Measurement rate
    7.940<tab>// Data capture period
    …
    Frame #<tab>AD<tab>MD<tab>…

No unit is given. Some files of the set are bare numbers, without header and frame numbers.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from recordings.errors import ForeignFile, RecordingCode
from recordings.exchange.delimited_emg import read_delimited_emg
from recordings.exchange.sample_tables import SignalTable
from recordings.exchange.text import read_lines, read_numbers

FRAME = "Frame #"
_REMARK = re.compile(r"\s*([^\t]*?)\s*\t\s*//\s*(.*?)\s*$")


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
            f"{path} announces {announced} frames and holds {len(frames)}; export it again, whole",
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
