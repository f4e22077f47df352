"""C3D read by ezc3d: markers and analog channels in one file and on one clock.

The format wants the analog rate to be a whole multiple of the frame rate.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from recordings.errors import ForeignFile, RecordingCode
from recordings.exchange.c3d_layout import EXPORT_AGAIN, read_c3d_layout
from recordings.exchange.lengths import millimetres
from recordings.exchange.tables import MarkerTable, SignalTable, distinct_labels, require_single_channels


def read_c3d_markers(path: Path, unit: str = "") -> MarkerTable:
    """The labelled points; unit, if given, overrides that of the file. Raises ForeignFile."""
    c3d = _open(path)
    point = c3d["parameters"]["POINT"]
    labels = _texts(point, "LABELS")
    data, residuals = c3d["data"]["points"], c3d["data"]["meta_points"]["residuals"]
    _, points, frames = data.shape
    if not frames or not points or not labels:
        raise ForeignFile(
            f"{path} holds no markers ({points} points, {frames} frames)", RecordingCode.FOREIGN_NO_MARKERS
        )
    named = [i for i, label in enumerate(labels[:points]) if label and not label.startswith("*")]
    names, notes = distinct_labels([labels[i] for i in named], str(path))
    rate = _rate(point, path)
    scale = millimetres(unit or (_texts(point, "UNITS") or [""])[0], str(path))
    positions = scale * np.moveaxis(data[:3, named], 0, 2).transpose(1, 0, 2)
    residual = residuals[0, named].T
    missing = np.isnan(positions).any(axis=-1) | (residual < 0)
    positions[missing], residual = np.nan, np.where(missing, np.nan, scale * residual)
    time = (_first_frame(c3d) + np.arange(data.shape[2])) / rate
    return MarkerTable(names, rate, time, positions, residual, notes)


def read_c3d_signals(path: Path, wanted: Sequence[str]) -> SignalTable:
    """Those of the wanted analog channels that are there. Raises ForeignFile, also if one is there twice."""
    c3d = _open(path)
    analog = c3d["parameters"]["ANALOG"]
    labels, units = _texts(analog, "LABELS"), _texts(analog, "UNITS")
    values = c3d["data"]["analogs"][0]
    if not labels or not values.shape[1]:
        raise ForeignFile(
            f"{path} holds no analog channel; export the analog data with the markers", RecordingCode.FOREIGN_NO_CHANNEL
        )
    require_single_channels([label for label in labels if label in wanted], str(path))
    start = _first_frame(c3d) / _rate(c3d["parameters"]["POINT"], path)
    place = {name: labels.index(name) for name in wanted if name in labels}
    return SignalTable(
        start + np.arange(values.shape[1]) / _rate(analog, path),
        {name: values[i].astype(np.float64) for name, i in place.items()},
        {name: units[i] if i < len(units) else "" for name, i in place.items()},
        tuple(labels),
    )


def _open(path: Path) -> Any:
    """The file as ezc3d reads it. Its own sentences are meant for its maintainers, and are not passed on."""
    if not path.is_file():
        raise ForeignFile(f"{path} cannot be read: there is no such file", RecordingCode.FOREIGN_UNREADABLE)
    layout = read_c3d_layout(path)
    try:
        import ezc3d  # not everywhere: it has no wheel for Linux on arm64
    except ImportError as error:
        raise ForeignFile(
            f"{path} cannot be read: C3D needs the package ezc3d, which is not installed; export TRC or TSV instead",
            RecordingCode.FOREIGN_NEEDS_PACKAGE,
        ) from error
    try:
        c3d = ezc3d.c3d(str(path))  # type: ignore[no-untyped-call]
    except Exception as error:  # the package raises what its C++ throws: OSError, RuntimeError, MemoryError, IndexError
        raise ForeignFile(
            f"{path} cannot be read as C3D: it is damaged, or its parameters violate the format; {EXPORT_AGAIN}",
            RecordingCode.FOREIGN_DAMAGED,
        ) from error
    _, points, frames = c3d["data"]["points"].shape
    _, channels, samples = c3d["data"]["analogs"].shape
    layout.require_agreement(points, channels * samples // max(frames, 1), frames)
    return c3d


def _texts(group: Any, name: str) -> list[str]:
    """A text parameter with its continuations, which begin where the 255 entries of one end."""
    found: list[str] = []
    for suffix in ("", *map(str, range(2, 10))):
        if f"{name}{suffix}" in group:
            found += [text.strip() for text in group[f"{name}{suffix}"]["value"]]
    return found


def _rate(group: Any, path: Path) -> float:
    rate = float(next(iter(group["RATE"]["value"]), 0.0)) if "RATE" in group else 0.0
    if not rate > 0:
        raise ForeignFile(f"{path} has no sampling rate; export it again with its rates", RecordingCode.FOREIGN_NO_RATE)
    return rate


def _first_frame(c3d: Any) -> int:
    """Index from 0 of the file's first frame in the capture."""
    return int(c3d["header"]["points"]["first_frame"])
