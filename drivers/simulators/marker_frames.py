"""Numbered frames of all markers, and their packets on QTM's wire.

Faults between QTM and its clients are frames held back, changed frames, additional packets.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from drivers.simulators.faults import Faults
from drivers.simulators.world import World

DATA_PACKET = 3
COMPONENTS = {"3d": (1, 3), "3dres": (9, 4)}  # type on the wire, numbers per marker
MISSING = 0xFFFFFFFF  # the bits of x, y and z of a hidden marker
ROUNDING_FRAMES = 1e-6  # a frame at the very end of a capture does not belong to it, whatever the rounding
_TYPICAL_RESIDUAL_MM = 0.4
_HEADER = (
    ("size", "<u4"),
    ("packet", "<u4"),
    ("timestamp", "<i8"),
    ("number", "<u4"),
    ("components", "<u4"),
    ("component_size", "<u4"),
    ("component", "<u4"),
    ("markers", "<u4"),
    ("drop_rate", "<u2"),
    ("out_of_sync_rate", "<u2"),
)
RELABELLING = ("drop_labels", "reorder_labels", "rename_labels")
WITHHOLDING = ("skip_frames", "silent", "no_more_data")
STRAYS = {
    "zero_length": struct.pack("<II", 0, 1),
    "huge_length": struct.pack("<II", 0x7FFFFFFF, 3),
    "unknown_packet": struct.pack("<II", 12, 77) + b"new!",
    "unknown_event": struct.pack("<IIB", 9, 6, 200),
    "no_more_data": struct.pack("<II", 8, 4),
}
_STRANGER = struct.pack("<II", 20, 99) + b"of tomorrow."
_HEAD = struct.Struct("<IIqII")  # size, type, time stamp, number, components
_RATES = struct.Struct("<HH")  # images dropped and out of synchronisation, per mille
_RATES_AT = _HEAD.size + 12  # behind the component's size, type and count

Turn = tuple[float, Literal["settings", "numbers"]]


@dataclass(frozen=True)
class Frames:
    """numbers (n,) from 1; timestamps (n,) [µs] from frame 1; points (n, labels, 4): x, y, z, residual [mm].

    times (n,) are the world seconds of their exposure.
    """

    times: NDArray[np.float64]
    numbers: NDArray[np.uint32]
    timestamps: NDArray[np.int64]
    points: NDArray[np.float32]

    def chosen(self, mask: NDArray[np.bool_], columns: Sequence[int]) -> Frames:
        """Only these frames, (n,), with only these labels in this order."""
        return Frames(self.times[mask], self.numbers[mask], self.timestamps[mask], self.points[mask][:, columns])


class Camera:
    """Exposes frame after frame of the World at its rate, from first_exposure [s, world time] on."""

    def __init__(self, world: World, first_exposure: float) -> None:
        self._world = world
        self._rate = world.settings.mocap.rate_hz
        self._first_exposure = first_exposure
        self._exposed = 0
        self._random = np.random.default_rng(round(first_exposure * 1e6))

    def frames_before(self, until: float) -> Frames | None:
        """The frames exposed since the last call and before the world time `until`; None without any."""
        first = self._exposed
        self.skip_before(until)
        return self._frames(np.arange(first, self._exposed)) if self._exposed > first else None

    def skip_before(self, until: float) -> None:
        """Expose the same frames without computing them, as no client takes them."""
        due = math.ceil((until - self._first_exposure) * self._rate - ROUNDING_FRAMES)
        self._exposed = max(self._exposed, due)

    def latest(self) -> Frames | None:
        """The last exposed frame again."""
        return self._frames(np.array([self._exposed - 1])) if self._exposed else None

    def renumbered(self) -> Camera:
        """Number the next exposure as frame 1."""
        return Camera(self._world, self._first_exposure + self._exposed / self._rate)

    def _frames(self, index: NDArray[np.int64]) -> Frames:
        times = self._first_exposure + index / self._rate
        markers = self._world.markers(times)
        points = np.zeros((*markers.shape[:2], 4), dtype="<f4")
        points[..., :3] = markers
        is_missing = np.isnan(points[..., 0])
        points[..., 3] = self._random.rayleigh(_TYPICAL_RESIDUAL_MM, is_missing.shape)
        points[is_missing, 3] = 0
        points.view("<u4")[is_missing, :3] = MISSING
        numbers, timestamps = index + 1, np.rint(index * (1e6 / self._rate))
        return Frames(times, numbers.astype(np.uint32), timestamps.astype(np.int64), points)


def packed(frames: Frames, component: str) -> bytes:
    """The packets of the frames, back to back."""
    kind, columns = COMPONENTS[component]
    count = frames.points.shape[1]
    layout = np.dtype([*_HEADER, ("points", "<f4", (count, columns))])
    packets = np.zeros(frames.numbers.size, dtype=layout)
    packets["size"] = layout.itemsize
    packets["packet"] = DATA_PACKET
    packets["timestamp"] = frames.timestamps
    packets["number"] = frames.numbers
    packets["components"] = 1
    packets["component_size"] = layout.itemsize - 24
    packets["component"] = kind
    packets["markers"] = count
    packets["points"] = frames.points[..., :columns]
    return packets.tobytes()


class QtmFaults:
    """Effect of one World's faults of "qtm"; times are world seconds."""

    def __init__(self, faults: Faults, labels: Sequence[str], rate_hz: float) -> None:
        self._faults = faults
        self._labels = tuple(labels)
        self._frame_s = 1 / rate_hz

    def is_now(self, kind: str) -> bool:
        return self._faults.active("qtm", kind) is not None

    def turns(self, after: float, until: float) -> list[Turn]:
        """Times in [after, until), in order, at which the settings change or the frame numbers restart."""
        changes = self._faults.of("qtm", *RELABELLING)
        turns: list[Turn] = [(moment, "settings") for one in changes for moment in (one.begin, one.end)]
        turns += [(one.begin, "numbers") for one in self._faults.of("qtm", "renumber")]
        return sorted(turn for turn in turns if after <= turn[0] < until)

    def labels(self, at: float) -> list[tuple[str, int]]:
        """The labels in QTM's order, each with its column in the World's markers."""
        labels = [(label, column) for column, label in enumerate(self._labels)]
        for one in self._faults.of("qtm", *RELABELLING):
            if not one.begin <= at < one.end:
                continue
            chosen = one.fault.labels or self._labels[-1:]
            if one.fault.fault == "drop_labels":
                labels = [(label, column) for label, column in labels if label not in chosen]
            elif one.fault.fault == "rename_labels":
                labels = [(f"{label} (old)" if label in chosen else label, column) for label, column in labels]
            else:
                labels.reverse()
        return labels

    def packets(self, frames: Frames, component: str, divisor: int) -> bytes:
        """Packets for the frames between two turns."""
        is_sent = (frames.numbers - 1) % divisor == 0
        for one in self._faults.of("qtm", *WITHHOLDING):
            is_sent &= (frames.times < one.begin) | (frames.times >= one.end)
        sent = frames.chosen(is_sent, [column for _, column in self.labels(float(frames.times[0]))])
        if not sent.numbers.size:
            return b""
        whole = packed(sent, component)
        size = len(whole) // sent.numbers.size
        packets = [whole[place : place + size] for place in range(0, len(whole), size)]
        return b"".join(self._spoilt(packets, sent.times))

    def strays(self, after: float, until: float) -> bytes:
        """Unexpected packets, due in [after, until)."""
        due = [one for one in self._faults.of("qtm", *STRAYS) if after <= one.begin < until]
        return b"".join(STRAYS[one.fault.fault] for one in due)

    def _spoilt(self, packets: list[bytes], times: NDArray[np.float64]) -> list[bytes]:
        for one in self._faults.of("qtm", "drop_images"):
            for n in np.flatnonzero((times >= one.begin) & (times < one.end)):
                packets[n] = packets[n][:_RATES_AT] + _RATES.pack(50, 20) + packets[n][_RATES_AT + _RATES.size :]
        for one in self._faults.of("qtm", "unknown_component"):
            for n in np.flatnonzero((times >= one.begin) & (times < one.end)):
                packets[n] = _with_stranger(packets[n])
        for one in self._faults.of("qtm", "half_packet"):
            begun = np.flatnonzero((times >= one.begin) & (times < one.begin + self._frame_s))
            for n in begun[:1]:
                packets[n] = packets[n][: len(packets[n]) // 2]
        return packets


def _with_stranger(packet: bytes) -> bytes:
    """The packet with a component of type 99 before its others."""
    size, kind, timestamp, number, components = _HEAD.unpack_from(packet)
    head = _HEAD.pack(size + len(_STRANGER), kind, timestamp, number, components + 1)
    return head + _STRANGER + packet[_HEAD.size :]
