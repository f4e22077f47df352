"""Streams of a device, described once, and blocks of samples with device time and host time.

Numbers keep the device's own unit here and in the file (`Stream.unit`); SI begins at the Trial.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Stream:
    """One kind of sample a device sends, described once.

    name      the topic it is recorded under: "/force", "/sync", "/markers", "/emg" …
    unit      the unit of every value as the device sends it: "V", "uV", "N", "lbf", "g", "mm"
    labels    names of the second axis of the values: one for a scalar stream, the marker names, the channel names
    rate_hz   nominal sample rate of the device
    source    text that names the device in errors and tables: "NI Dev1/ai0 (127.0.0.1:31763)"
    serial_number  of the instrument, "" if the wire carries none
    """

    name: str
    unit: str
    labels: tuple[str, ...]
    rate_hz: float
    source: str
    serial_number: str = ""


@dataclass(frozen=True)
class DeviceIdentity:
    """Identity of a device, as it reports itself at opening.

    name          the device as errors name it: "NI Dev1"
    text          product, serial number or version as the device gives them; "" if the wire carries none
    is_simulated  as the device reports; None if the wire cannot carry it
    """

    name: str
    text: str
    is_simulated: bool | None


@dataclass(frozen=True)
class Samples:
    """A block of consecutive samples of one stream.

    stream          the name of the stream
    sample_numbers  (n,) uint64, counted by the device (NI sample index, QTM frame number); a jump is a loss
    device_time_ns  (n,) int64, the device's own clock; its zero is the device's affair
    host_time_ns    UTC of the station's clock when the block arrived
    values          scalar and analog streams (n, labels) float64; markers (n, markers, 4) float32: x, y, z, residual.
                    A missing marker is NaN in all four.
    """

    stream: str
    sample_numbers: NDArray[np.uint64]
    device_time_ns: NDArray[np.int64]
    host_time_ns: int
    values: NDArray[np.float64] | NDArray[np.float32]


@dataclass(frozen=True)
class Event:
    """Something that happened at a moment: "capture_started", "capture_stopped", "armed", "sync_edge", "mark", …

    kind is one word with underscores, text is a sentence for a person; source is the device or "station".
    """

    kind: str
    text: str
    host_time_ns: int
    source: str


@dataclass(frozen=True)
class Loss:
    """Samples that the device numbered and the station did not receive.

    cause is one word: "skipped" (numbers jump), "late" (the first of a capture), "overrun", "silent", "disconnected",
    "garbled", "queue_overflow".
    first_missing and count are in the device's sample numbers; last_device_time_ns is that of the last good sample.
    """

    stream: str
    cause: str
    first_missing: int
    count: int
    last_device_time_ns: int
    host_time_ns: int


Item = Samples | Event | Loss
