"""Coverage of the clock ratio's 95 % interval, by where the sync line falls in the last frame and by drift.

    python -m benchmarks.stop_edge [TRIALS]

Declared: sync.stop_edge states where the line falls. Not known: it does not, and the interval covers every position in
the last frame. Trials last 20 to 70 s, at 1 kHz and 85 to 200 frames a second
(tests/fitting/trial/stopped_capture.py).
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np

from fitting.trial.clock_fit import fit_clock, stop_window
from recordings.manifest import Timing
from tests.fitting.trial.stopped_capture import EXPOSURE, STOPS, Stop, stopped_capture

DRIFTS_PPM = ((0, 0), (50, 0), (0, 50), (300, 0), (0, 300))
"""Of the DAQ's clock and of the camera's."""


@dataclass(frozen=True)
class Cell:
    """Parts of the trials whose interval held the truth, and whose ratio was identified.

    half_width  [ppm] of the interval, median
    worst       largest error in standard uncertainties
    """

    covered: float
    identified: float
    half_width: float
    worst: float

    @property
    def words(self) -> str:
        covered, identified = 100 * self.covered, 100 * self.identified
        return f"{covered:5.1f} %, ±{self.half_width:3.0f} ppm, identified {identified:3.0f} %"


def coverage(stop: Stop, daq_ppm: float, camera_ppm: float, trials: int, *, is_declared: bool) -> Cell:
    """Coverage over a number of simulated trials."""
    random = np.random.default_rng([STOPS.index(stop), int(daq_ppm), int(camera_ppm)])
    timing = Timing(stop_edge=stop, exposure_s=EXPOSURE) if is_declared else Timing()
    covered, identified, widths, errors = [], [], [], []
    for _ in range(trials):
        capture = stopped_capture(random, stop, daq_ppm, camera_ppm)
        clock = fit_clock(capture.edges, capture.duration, stop_window(timing, capture.frame))
        low, high = clock.drift_ci95 or (np.nan, np.nan)
        covered.append(low <= capture.drift <= high)
        identified.append(clock.is_identified)
        widths.append(0.5e6 * (high - low))
        errors.append(abs(clock.ratio - 1 - capture.drift) / np.sqrt(clock.covariance[1, 1]))
    return Cell(float(np.mean(covered)), float(np.mean(identified)), float(np.median(widths)), float(np.max(errors)))


def main(trials: int) -> None:
    print(f"{'line falls at':<18}{'DAQ':>5}{'camera':>8}  {'declared':<38}not known")
    for stop in STOPS:
        for daq, camera in DRIFTS_PPM:
            declared, unknown = (
                coverage(stop, daq, camera, trials, is_declared=is_declared).words for is_declared in (True, False)
            )
            print(f"{stop.replace('_', ' '):<18}{daq:>5}{camera:>8}  {declared:<38}{unknown}", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 1000)
