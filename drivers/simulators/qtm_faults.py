"""Faults between QTM and its clients: frames held back, changed frames, additional packets."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from drivers.simulators.faults import Faults
from drivers.simulators.marker_frames import Frames, packed

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
