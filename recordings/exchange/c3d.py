"""C3D: markers and analog channels in one file and on one clock.

The format wants the analog rate to be a whole multiple of the frame rate.

Files are written byte by byte, after the C3D User Guide (c3d.org): header, parameters, frames of 32-bit floats, for
Intel. They are written here because a library may keep a parameter of one value as a scalar, where readers expect an
array (ANALOG:OFFSET with one channel), and may not notice a disk that is full.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from documents.interval import counted
from recordings.errors import ForeignFile, RecordingCode
from recordings.exchange.c3d_file import (
    BLOCK,
    CHARACTER,
    INTEGER,
    INTEL,
    MOST_COUNTED,
    RATE_TOLERANCE,
    REAL,
    SIGNATURE,
    C3dFile,
    read_c3d_file,
)
from recordings.exchange.sample_tables import (
    MarkerTable,
    SignalTable,
    distinct_labels,
    millimetres,
    note_on_far,
    require_single_channels,
    without_origin,
)

Array = NDArray[np.float64]
MOST_ENTRIES = 255  # of a parameter's dimension, which is one byte
RESIDUAL_STEPS, INTEGER_STEPS = 255, 32000  # of a residual, which is one byte, and of a coordinate as an integer


def read_c3d_markers(path: Path, unit: str = "") -> MarkerTable:
    """The labelled points; unit, if given, overrides that of the file. Raises ForeignFile."""
    c3d = read_c3d_file(path)
    layout, labels = c3d.layout, c3d.parameters.texts("POINT", "LABELS")
    if not layout.frames or not layout.points or not labels:
        raise ForeignFile(
            f"{path} holds no markers ({counted(layout.points, 'point')}, {counted(layout.frames, 'frame')})",
            RecordingCode.FOREIGN_NO_MARKERS,
        )
    if layout.frames < 2:
        raise ForeignFile(
            f"{path} holds {layout.frames} frame, expected at least 2; export the complete file",
            RecordingCode.FOREIGN_TOO_SHORT,
        )
    named = [i for i, label in enumerate(labels[: layout.points]) if label and not label.startswith("*")]
    names, notes = distinct_labels([labels[i] for i in named], str(path))
    scale = millimetres(unit or (c3d.parameters.texts("POINT", "UNITS") or [""])[0], str(path))
    positions, residuals = _points(c3d, named)
    notes += c3d.notes + note_on_far(scale * positions, str(path))
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


@np.errstate(invalid="ignore", over="ignore")  # signalling NaN of a damaged file
def _points(c3d: C3dFile, chosen: Sequence[int]) -> tuple[Array, Array]:
    """Positions (frames, chosen, 3) and residuals (frames, chosen) in the file's unit; a residual is NaN if negative.

    The low byte of the fourth number is the residual, the high byte the cameras; both are −1 for a missing point.
    """
    points = c3d.values[:, : 4 * c3d.layout.points].reshape(c3d.layout.frames, -1, 4)[:, chosen]
    stated = c3d.parameters.number("POINT", "SCALE")
    scale = abs(c3d.header.scale if stated is None else stated)
    if not (0 < scale < np.inf or c3d.is_real):
        raise ForeignFile(
            f"{c3d.path} has the scale {scale:g} for its integer positions; export it again",
            RecordingCode.FOREIGN_DAMAGED,
        )
    positions = points[..., :3].astype(np.float64) * (1.0 if c3d.is_real else scale)
    mask = np.trunc(np.nan_to_num(points[..., 3].astype(np.float64), nan=-1.0, posinf=-1.0, neginf=-1.0))
    residuals = scale * np.mod(mask, 256)
    return positions, np.where(mask < 0, np.nan, residuals)


def _analog_rate(c3d: C3dFile) -> float:
    """[Hz] Frame rate × samples of a frame. Raises ForeignFile where the file states another one."""
    rate = c3d.layout.per_frame * c3d.rate_hz
    stated = c3d.parameters.number("ANALOG", "RATE") or rate
    if abs(stated / rate - 1) > RATE_TOLERANCE:
        raise ForeignFile(
            f"{c3d.path} states {stated:g} analog samples a second and holds {c3d.layout.per_frame} in each frame of "
            f"{1 / c3d.rate_hz:.6g} s, which is {rate:g}; export it again with its rates",
            RecordingCode.FOREIGN_CONTRADICTORY,
        )
    return rate


@np.errstate(invalid="ignore", over="ignore")
def _channel(c3d: C3dFile, channel: int, name: str) -> Array:
    """(raw − OFFSET) × SCALE × GEN_SCALE. FORMAT, whose text may be cut, states the sign of OFFSET and of integers."""
    layout, parameters = c3d.layout, c3d.parameters
    raw = c3d.values[:, 4 * layout.points :].reshape(-1, layout.channels)[:, channel]
    is_signed = not any(text.upper().startswith("UNSIGN") for text in parameters.texts("ANALOG", "FORMAT"))
    if not (is_signed or c3d.is_real):
        raw = raw.astype(np.int16).view(np.uint16)
    scales = parameters.numbers("ANALOG", "SCALE")
    offsets = parameters.numbers("ANALOG", "OFFSET", is_signed=is_signed)
    if not len(offsets):  # in c3d.org's sample 06, of Motion Analysis
        offsets = parameters.numbers("ANALOG", "OFFSETS", is_signed=is_signed)
    factors = parameters.numbers("ANALOG", "GEN_SCALE", is_signed=False)
    if channel >= len(scales) or channel >= len(offsets):
        raise ForeignFile(
            f"{c3d.path} has no ANALOG:SCALE or no ANALOG:OFFSET for the channel {name}; export it again",
            RecordingCode.FOREIGN_CONTRADICTORY,
        )
    scale, offset = scales[channel] * (factors[0] if len(factors) else 1.0), offsets[channel]
    if not np.isfinite([scale, offset]).all() or scale == 0:
        raise ForeignFile(
            f"{c3d.path} has the scale {scale:g} and the offset {offset:g} for the channel {name}, expected finite "
            "numbers and a scale that is not 0; export it again",
            RecordingCode.FOREIGN_DAMAGED,
        )
    values: Array = (raw - offset) * scale
    return values


def write_c3d(path: Path, markers: MarkerTable, signals: Mapping[str, Array], units: Mapping[str, str]) -> None:
    """Markers in mm and signals (frames × whole number,) that begin with the first frame, each as an analog channel.

    A missing marker is at zero with residual −1, as the format has it. Frames count from 1: times begin anew.
    """
    frames, count = markers.positions.shape[:2]
    per_frame = max((len(values) for values in signals.values()), default=frames) // frames
    scale = _scale(markers)
    parameters = _parameters(markers, signals, units, per_frame, scale)
    start = 2 + len(parameters) // BLOCK
    parameters = _parameters(markers, signals, units, per_frame, scale, start)
    header = struct.pack(
        "<BB5HfHHf",
        2,
        SIGNATURE,
        count,
        len(signals) * per_frame,
        1,
        min(frames, MOST_COUNTED),
        0,
        -scale,
        start,
        per_frame,
        markers.rate_hz,
    )
    with path.open("wb") as file:
        file.write(header.ljust(BLOCK, b"\0"))
        file.write(parameters)
        file.write(_frames(markers, signals, per_frame, scale).tobytes())


def _scale(markers: MarkerTable) -> float:
    """[mm] Unit of the residuals; also of the positions, should a program turn them into 16-bit integers."""
    seen = ~markers.missing
    reach = float(np.abs(markers.positions).max(initial=0.0, where=seen[..., None]))
    residual = float(markers.residuals.max(initial=0.0, where=seen))
    return max(reach / INTEGER_STEPS, residual / RESIDUAL_STEPS) or 1.0


def _frames(markers: MarkerTable, signals: Mapping[str, Array], per_frame: int, scale: float) -> NDArray[np.float32]:
    """(frames, values): x, y, z and the residual of each point, then the channels' values sample by sample."""
    frames, missing = len(markers.time_s), markers.missing
    points = np.zeros((*markers.positions.shape[:2], 4))
    points[..., :3] = np.where(missing[..., None], 0.0, markers.positions)
    points[..., 3] = np.where(missing, -1.0, np.rint(np.nan_to_num(markers.residuals) / scale))
    analog = np.stack(list(signals.values()), axis=-1) if signals else np.zeros((frames * per_frame, 0))
    return np.hstack([points.reshape(frames, -1), analog.reshape(frames, -1)]).astype("<f4")


def _parameters(
    markers: MarkerTable,
    signals: Mapping[str, Array],
    units: Mapping[str, str],
    per_frame: int,
    scale: float,
    start: int = 0,
) -> bytes:
    frames, channels = len(markers.time_s), len(signals)
    records = [
        _group(1, "POINT"),
        _integers(1, "USED", [len(markers.labels)]),
        _integers(1, "FRAMES", [min(frames, MOST_COUNTED)]),
        _integers(1, "DATA_START", [start]),
        _reals(1, "SCALE", [-scale]),
        _reals(1, "RATE", [markers.rate_hz]),
        _texts(1, "UNITS", ["mm"]),
        *_labels(1, "LABELS", markers.labels),
        *_labels(1, "DESCRIPTIONS", ["" for _ in markers.labels]),
        _group(2, "ANALOG"),
        _integers(2, "USED", [channels]),
        _reals(2, "RATE", [markers.rate_hz * per_frame]),
        _reals(2, "GEN_SCALE", [1.0]),
        _reals(2, "SCALE", [1.0] * channels, is_array=True),
        _integers(2, "OFFSET", [0] * channels, is_array=True),
        *_labels(2, "LABELS", list(signals)),
        *_labels(2, "DESCRIPTIONS", ["" for _ in signals]),
        *_labels(2, "UNITS", [units[name] for name in signals]),
        _group(3, "TRIAL"),
        _integers(3, "ACTUAL_START_FIELD", [1, 0], is_array=True),
        _integers(3, "ACTUAL_END_FIELD", [frames & 0xFFFF, frames >> 16], is_array=True),
        _group(4, "FORCE_PLATFORM"),
        _integers(4, "USED", [0]),
    ]
    size = 4 + sum(map(len, records)) + 2
    blocks = -(-size // BLOCK)
    return (bytes([1, SIGNATURE, blocks, INTEL]) + b"".join(records)).ljust(blocks * BLOCK, b"\0")


def _group(number: int, name: str) -> bytes:
    return struct.pack("<bb", len(name), -number) + name.encode() + struct.pack("<hB", 3, 0)


def _labels(group: int, name: str, texts: Sequence[str]) -> list[bytes]:
    """With continuations NAME2, NAME3 … where there are more than a dimension counts."""
    parts = [texts[i : i + MOST_ENTRIES] for i in range(0, len(texts), MOST_ENTRIES)] or [[]]
    return [_texts(group, f"{name}{i + 1 if i else ''}", part, is_array=True) for i, part in enumerate(parts)]


def _texts(group: int, name: str, texts: Sequence[str], *, is_array: bool = False) -> bytes:
    encoded = [text.encode()[:MOST_ENTRIES] for text in texts]
    width = max(map(len, encoded), default=0)
    data = b"".join(text.ljust(width) for text in encoded)
    return _parameter(group, name, CHARACTER, [width, len(texts)] if is_array else [width], data)


def _integers(group: int, name: str, values: Sequence[int], *, is_array: bool = False) -> bytes:
    return _parameter(group, name, INTEGER, [len(values)] if is_array else [], struct.pack(f"<{len(values)}H", *values))


def _reals(group: int, name: str, values: Sequence[float], *, is_array: bool = False) -> bytes:
    return _parameter(group, name, REAL, [len(values)] if is_array else [], struct.pack(f"<{len(values)}f", *values))


def _parameter(group: int, name: str, kind: int, dimensions: Sequence[int], data: bytes) -> bytes:
    body = struct.pack("<bB", kind, len(dimensions)) + bytes(dimensions) + data + b"\0"
    return struct.pack("<bb", len(name), group) + name.encode() + struct.pack("<h", len(body) + 2) + body
