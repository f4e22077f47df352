"""C3D: markers and analog channels in one file and on one clock.

The format wants the analog rate to be a whole multiple of the frame rate.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recordings.errors import ForeignFile, RecordingCode
from recordings.exchange.c3d_file import RATE_TOLERANCE, C3dFile, read_c3d_file
from recordings.exchange.lengths import millimetres
from recordings.exchange.tables import (
    MarkerTable,
    SignalTable,
    distinct_labels,
    require_single_channels,
    without_origin,
)

Array = NDArray[np.float64]


def read_c3d_markers(path: Path, unit: str = "") -> MarkerTable:
    """The labelled points; unit, if given, overrides that of the file. Raises ForeignFile."""
    c3d = read_c3d_file(path)
    layout, labels = c3d.layout, c3d.parameters.texts("POINT", "LABELS")
    if not layout.frames or not layout.points or not labels:
        raise ForeignFile(
            f"{path} holds no markers ({layout.points} points, {layout.frames} frames)",
            RecordingCode.FOREIGN_NO_MARKERS,
        )
    named = [i for i, label in enumerate(labels[: layout.points]) if label and not label.startswith("*")]
    names, notes = distinct_labels([labels[i] for i in named], str(path))
    scale = millimetres(unit or (c3d.parameters.texts("POINT", "UNITS") or [""])[0], str(path))
    positions, residuals = _points(c3d, named)
    positions, residuals = without_origin(scale * positions), scale * residuals
    missing = np.isnan(positions).any(axis=-1) | np.isnan(residuals)
    positions[missing], residuals[missing] = np.nan, np.nan
    time = (c3d.first_frame + np.arange(layout.frames)) / c3d.rate_hz
    return MarkerTable(names, c3d.rate_hz, time, positions, residuals, notes)


def read_c3d_signals(path: Path, wanted: Sequence[str]) -> SignalTable:
    """Those of the wanted analog channels that are there. Raises ForeignFile, also if one is there twice."""
    c3d = read_c3d_file(path)
    labels, units = (c3d.parameters.texts("ANALOG", name) for name in ("LABELS", "UNITS"))
    labels = labels[: c3d.layout.channels]
    if not labels or not c3d.layout.per_frame or not c3d.layout.frames:
        raise ForeignFile(
            f"{path} holds no analog channel; export the analog data with the markers", RecordingCode.FOREIGN_NO_CHANNEL
        )
    require_single_channels([label for label in labels if label in wanted], str(path))
    rate = _analog_rate(c3d)
    place = {name: labels.index(name) for name in wanted if name in labels}
    count = c3d.layout.frames * c3d.layout.per_frame
    return SignalTable(
        c3d.first_frame / c3d.rate_hz + np.arange(count) / rate,
        {name: _channel(c3d, i, name) for name, i in place.items()},
        {name: units[i] if i < len(units) else "" for name, i in place.items()},
        tuple(labels),
    )


def _points(c3d: C3dFile, chosen: Sequence[int]) -> tuple[Array, Array]:
    """Positions (frames, chosen, 3) and residuals (frames, chosen) in the file's unit; a residual is NaN if negative.

    The low byte of the fourth number is the residual, the high byte the cameras; both are −1 for a missing point.
    """
    points = c3d.values[:, : 4 * c3d.layout.points].reshape(c3d.layout.frames, -1, 4)[:, chosen]
    told = c3d.parameters.number("POINT", "SCALE")
    scale = abs(c3d.header.scale if told is None else told)
    positions = points[..., :3].astype(np.float64) * (1.0 if c3d.is_real else scale)
    mask = np.trunc(np.nan_to_num(points[..., 3].astype(np.float64), nan=-1.0, posinf=-1.0, neginf=-1.0))
    residuals = scale * np.mod(mask, 256)
    return positions, np.where(mask < 0, np.nan, residuals)


def _analog_rate(c3d: C3dFile) -> float:
    """[Hz] Frame rate × samples of a frame. Raises ForeignFile where the file states another one."""
    rate = c3d.layout.per_frame * c3d.rate_hz
    told = c3d.parameters.number("ANALOG", "RATE") or rate
    if abs(told / rate - 1) > RATE_TOLERANCE:
        raise ForeignFile(
            f"{c3d.path} states {told:g} analog samples a second and holds {c3d.layout.per_frame} in each frame of "
            f"{1 / c3d.rate_hz:.6g} s, which is {rate:g}; export it again with its rates",
            RecordingCode.FOREIGN_CONTRADICTORY,
        )
    return rate


def _channel(c3d: C3dFile, channel: int, name: str) -> Array:
    """(raw − OFFSET) × SCALE × GEN_SCALE of all samples. FORMAT states the sign of OFFSET and of integer samples."""
    layout, parameters = c3d.layout, c3d.parameters
    raw = c3d.values[:, 4 * layout.points :].reshape(-1, layout.channels)[:, channel]
    is_signed = not any(text.upper() == "UNSIGNED" for text in parameters.texts("ANALOG", "FORMAT"))
    if not (is_signed or c3d.is_real):
        raw = raw.astype(np.int16).view(np.uint16)
    scales = parameters.numbers("ANALOG", "SCALE")
    offsets = parameters.numbers("ANALOG", "OFFSET", is_signed=is_signed)
    if not len(offsets):  # in c3d.org's sample 06, of Motion Analysis
        offsets = parameters.numbers("ANALOG", "OFFSETS", is_signed=is_signed)
    factor = parameters.number("ANALOG", "GEN_SCALE")
    if channel >= len(scales) or channel >= len(offsets):
        raise ForeignFile(
            f"{c3d.path} has no ANALOG:SCALE or no ANALOG:OFFSET for the channel {name}; export it again",
            RecordingCode.FOREIGN_CONTRADICTORY,
        )
    values: Array = (raw - offsets[channel]) * scales[channel] * (1.0 if factor is None else factor)
    return values
