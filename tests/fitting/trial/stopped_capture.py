"""A capture that ends at a chosen moment of its last frame, seen by a DAQ with a clock of its own.

Independent of the estimator: everything happens on a third, true time axis, on which both quartz clocks run fast or
slow. The camera counts its own seconds, the DAQ samples the line's voltage by its own, and only those samples and the
number of frames are handed on.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from fitting.trial.clocks import SyncEdges
from fitting.trial.sync_line import find_edges

Stop = Literal["end_of_frame", "end_of_exposure", "anywhere"]
STOPS: tuple[Stop, ...] = ("end_of_frame", "end_of_exposure", "anywhere")
EXPOSURE = 4e-4
SAMPLE_RATE = 1000.0
FRAME_RATES = (85.0, 100.0, 120.0, 179.0, 200.0)
"""QTM takes any whole number; most of these do not divide the DAQ's samples evenly."""
TEMPERATURE_SD = 3e-6
"""Seconds a second by which a quartz changes from one trial to the next."""


@dataclass(frozen=True)
class StoppedCapture:
    """What the DAQ saw, how many frames of which length came, and the true drift of the DAQ against the camera."""

    edges: SyncEdges
    frames: int
    frame: float
    drift: float

    @property
    def duration(self) -> float:
        """[s] of the camera's clock that the frames last."""
        return self.frames * self.frame


def stopped_capture(
    random: np.random.Generator, stop: Stop, daq_ppm: float = 0.0, camera_ppm: float = 0.0
) -> StoppedCapture:
    """One trial of 20 to 70 s; both clocks run fast by their parts per million."""
    daq, camera = (1 + 1e-6 * ppm + random.normal(0, TEMPERATURE_SD) for ppm in (daq_ppm, camera_ppm))
    rate = float(random.choice(FRAME_RATES))
    count = int(random.uniform(20, 70) * rate)
    last_exposure_begins = (count - 1) / rate
    high_for = {
        "end_of_frame": count / rate,
        "end_of_exposure": last_exposure_begins + EXPOSURE,
        "anywhere": last_exposure_begins + random.uniform(0, 1 / rate),
    }[stop]
    rises = random.uniform(2.0, 2.5)
    falls = rises + high_for / camera
    near = [np.arange(at * daq * SAMPLE_RATE - 60, at * daq * SAMPLE_RATE + 60) // 1 for at in (rises, falls)]
    numbers = np.concatenate(([0.0], *near))  # the samples between are high, and change nothing
    is_high = (numbers / SAMPLE_RATE / daq >= rises) & (numbers / SAMPLE_RATE / daq < falls)
    volts = 5.0 * is_high + random.normal(0, 5e-3, len(numbers))
    return StoppedCapture(find_edges(numbers / SAMPLE_RATE, volts, 2.5), count, 1 / rate, daq / camera - 1)
