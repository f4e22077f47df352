"""A body in Rerun: bones, muscles coloured by activation, cord and cuffs; for replays and live values alike."""

from __future__ import annotations

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from solver.drawing import bone_lines, path_lines, skeleton
from solver.model import Model
from solver.multibody.postures import points_in_ground, postures
from solver.suit.suit import Suit
from station.viewer.layout import TIMELINE, SceneExtent

Array = NDArray[np.float64]
IDLE, ACTIVE = np.array([60, 90, 160]), np.array([215, 40, 30])
"""Colours (RGB) of a muscle at rest and at full activation."""
THIN, THICK = 0.002, 0.006
"""Radii [m] of a muscle at rest and at full activation, for users who cannot distinguish the colours."""
BONE, CORD = (200, 200, 190), (30, 140, 60)
BONE_RADII = {"shaft": 0.006, "plate": 0.002, "cage": 0.0007}


class BodyScene:
    """Logs a model below `body` in a stream; suit is None without one."""

    def __init__(self, stream: rr.RecordingStream, model: Model, suit: Suit | None) -> None:
        self._stream, self._model, self._suit = stream, model, suit
        self._bones = skeleton(model)
        self._radii = [BONE_RADII[bone.kind] for bone in self._bones]
        stream.log("body", rr.ViewCoordinates.RIGHT_HAND_Y_UP, static=True)  # axes of OpenSim models

    def log(self, times_ns: NDArray[np.int64], coordinates: Array, activations: Array) -> SceneExtent:
        """Log frames at times_ns (frames,) on the timeline; returns their extent.

        coordinates (frames, coordinates) [rad or m], finite; activations (frames, muscles), NaN where unknown.
        """
        state = postures(self._model, coordinates, np.zeros_like(coordinates))
        bones, muscles = bone_lines(self._bones, state), path_lines(self._model, state)
        suit = self._suit
        parts = () if suit is None else suit.line
        places = [points_in_ground(state, self._model.body_index(part.body), part.location) for part in parts]
        cord = np.stack(places, axis=1) if places else None
        for frame, time_ns in enumerate(times_ns):
            self._stream.set_time(TIMELINE, timestamp=np.datetime64(int(time_ns), "ns"))
            self._log_muscles(muscles[frame], np.nan_to_num(activations[frame]))
            strips = [line[frame] for line in bones]
            self._stream.log("body/bones", rr.LineStrips3D(strips, colors=BONE, radii=self._radii))
            if cord is not None:
                self._log_cord(cord[frame])
        return SceneExtent.around(np.concatenate([line.reshape(-1, 3) for line in bones]))

    def _log_muscles(self, lines: list[Array], activations: Array) -> None:
        share = np.clip(activations, 0.0, 1.0)[:, None]
        colours = (IDLE + share * (ACTIVE - IDLE)).astype(np.uint8)
        radii = THIN + share[:, 0] * (THICK - THIN)
        self._stream.log("body/muscles", rr.LineStrips3D(lines, colors=colours, radii=radii))

    def _log_cord(self, points: Array) -> None:
        self._stream.log("body/cord", rr.LineStrips3D([points], colors=CORD, radii=0.004))
        cuffs = rr.Points3D(points[[0, 2]], colors=CORD, radii=0.02, labels=["waist", "arm"])
        self._stream.log("body/cuffs", cuffs)
