"""C3D through ezc3d: markers and analog channels in one file and on one clock.

The format wants the analog rate to be a whole multiple of the frame rate.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import ezc3d
import numpy as np
from numpy.typing import NDArray

from recordings.errors import ForeignFile
from recordings.exchange.lengths import millimetres
from recordings.exchange.tables import MarkerTable, SignalTable, require_labels

BYTES_PER_VALUE = 4


def read_c3d_markers(path: Path, unit: str = "") -> MarkerTable:
    """The points, without those that nobody labelled; unit, where given, overrides the file's. Raises ForeignFile."""
    c3d = _open(path)
    point = c3d["parameters"]["POINT"]
    labels = _texts(point, "LABELS")
    data, residuals = c3d["data"]["points"], c3d["data"]["meta_points"]["residuals"]
    if not data.shape[2] or not labels:
        raise ForeignFile(f"{path} holds no markers ({data.shape[1]} points, {data.shape[2]} frames)")
    named = [i for i, label in enumerate(labels) if label and not label.startswith("*")]
    require_labels(tuple(labels[i] for i in named), str(path))
    rate = _rate(point, path)
    scale = millimetres(unit or (_texts(point, "UNITS") or [""])[0], str(path))
    positions = scale * np.moveaxis(data[:3, named], 0, 2).transpose(1, 0, 2)
    residual = residuals[0, named].T
    missing = np.isnan(positions).any(axis=-1) | (residual < 0)
    positions[missing], residual = np.nan, np.where(missing, np.nan, scale * residual)
    time = (_first_frame(c3d) + np.arange(data.shape[2])) / rate
    return MarkerTable(tuple(labels[i] for i in named), rate, time, positions, residual)


def read_c3d_signals(path: Path, wanted: Sequence[str]) -> SignalTable:
    """Those of the wanted analog channels that are there. Raises ForeignFile."""
    c3d = _open(path)
    analog = c3d["parameters"]["ANALOG"]
    labels, units = _texts(analog, "LABELS"), _texts(analog, "UNITS")
    values = c3d["data"]["analogs"][0]
    if not labels or not values.shape[1]:
        raise ForeignFile(f"{path} holds no analog channel; export the analog data with the markers")
    start = _first_frame(c3d) / _rate(c3d["parameters"]["POINT"], path)
    place = {name: labels.index(name) for name in wanted if name in labels}
    return SignalTable(
        start + np.arange(values.shape[1]) / _rate(analog, path),
        {name: values[i].astype(np.float64) for name, i in place.items()},
        {name: units[i] if i < len(units) else "" for name, i in place.items()},
        tuple(labels),
    )


def write_c3d(
    path: Path, markers: MarkerTable, signals: Mapping[str, NDArray[np.float64]], units: Mapping[str, str]
) -> None:
    """Markers in mm and signals (frames × whole number,) that begin with the first frame, each as an analog channel.

    A missing marker has residual −1, as the format has it. C3D counts frames from 1: times begin anew with the file.
    Raises OSError where the disk does not hold it all: the package writes what it can and says nothing.
    """
    frames = len(markers.time_s)
    c3d: Any = ezc3d.c3d()  # type: ignore[no-untyped-call]
    missing = markers.missing
    points = np.ones((4, len(markers.labels), frames))
    points[:3] = np.where(missing[..., None], np.nan, markers.positions).transpose(2, 1, 0)
    parameters = c3d["parameters"]
    parameters["POINT"]["RATE"]["value"] = [markers.rate_hz]
    parameters["POINT"]["LABELS"]["value"] = list(markers.labels)
    parameters["POINT"]["DESCRIPTIONS"]["value"] = [""] * len(markers.labels)
    parameters["POINT"]["UNITS"]["value"] = ["mm"]
    c3d["data"]["points"] = points
    c3d["data"]["meta_points"]["residuals"] = np.where(missing, -1.0, markers.residuals).T[None]
    c3d["data"]["meta_points"]["camera_masks"] = np.zeros((7, len(markers.labels), frames), dtype=bool)
    samples = max((len(values) for values in signals.values()), default=frames)
    parameters["ANALOG"]["RATE"]["value"] = [markers.rate_hz * (samples // frames)]
    parameters["ANALOG"]["LABELS"]["value"] = list(signals)
    parameters["ANALOG"]["DESCRIPTIONS"]["value"] = [""] * len(signals)
    parameters["ANALOG"]["UNITS"]["value"] = [units[name] for name in signals]
    parameters["ANALOG"]["SCALE"]["value"] = [1.0] * len(signals)
    parameters["ANALOG"]["OFFSET"]["value"] = [0] * len(signals)
    c3d["data"]["analogs"] = np.reshape(list(signals.values()), (1, len(signals), samples))
    c3d.write(str(path))
    if path.stat().st_size < BYTES_PER_VALUE * (points.size + c3d["data"]["analogs"].size):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))


def _open(path: Path) -> Any:
    if not path.is_file():
        raise ForeignFile(f"{path} cannot be read: there is no such file")
    try:
        return ezc3d.c3d(str(path))  # type: ignore[no-untyped-call]
    except Exception as error:  # the package raises what its C++ throws: OSError, RuntimeError, MemoryError, IndexError
        raise ForeignFile(f"{path} cannot be read as C3D: {' '.join(str(error).split())}") from error


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
        raise ForeignFile(f"{path} tells no sampling rate; export it again with its rates")
    return rate


def _first_frame(c3d: Any) -> int:
    """Index from 0 of the file's first frame in the capture."""
    return int(c3d["header"]["points"]["first_frame"])
