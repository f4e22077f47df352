"""Numbered frames of all markers, and their packets on QTM's wire."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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
        due = math.ceil((until - self._first_exposure) * self._rate - ROUNDING_FRAMES)
        if due <= self._exposed:
            return None
        index = np.arange(self._exposed, due)
        self._exposed = due
        return self._frames(index)

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
