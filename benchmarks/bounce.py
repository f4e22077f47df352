"""Accuracy of the calibration of the load cell by a bounce: `python -m benchmarks.bounce [runs]`.

Lag, gain and zero of a weight of 2.5 kg that bounces by ± 80 mm once a second for half a minute, against the truth of
a chain of masses that is independent of the fit (tests/fitting/bouncing.py).
"""

from __future__ import annotations

import math
import sys

import numpy as np

from fitting.trial.bounce import fit_bounce
from fitting.trial.trial import build_bounce
from tests.fitting.bouncing import Bounce, recorded

CASES = {
    "1 kHz": Bounce(lag=0.004),
    "20 Hz": Bounce(lag=0.004, force_rate=20.0),
    "1 kHz, filter of 10 Hz": Bounce(filter_hz=10.0),
    "1 kHz, spring of 0.4 kg": Bounce(spring_mass=0.4),
    "1 kHz, ghosts and 5 % hidden": Bounce(ghosts=0.01, occlusion=0.05),
    "1 kHz, 1.5 Hz, ± 30 mm": Bounce(frequency=1.5, amplitude=0.03),
}


def main(runs: int) -> None:
    print(f"{'bounce':30} lag rmse [ms]  cover   gain rmse [%]  cover   zero rmse [N]  cover   of {runs}")
    for name, truth in CASES.items():
        fits = [fit_bounce(build_bounce(*recorded(truth, seed), "", "")) for seed in range(runs)]
        cells = []
        for quantity, true, unit in (("lag", _lag(truth), 1e3), ("gain", truth.gain, 1e2), ("zero", truth.zero, 1.0)):
            found = [getattr(fit, quantity).estimate for fit in fits]
            off = np.array([estimate.value - true for estimate in found])
            inside = np.mean([estimate.ci95[0] <= true <= estimate.ci95[1] for estimate in found])
            cells.append(f"{unit * np.sqrt(np.mean(off**2)):13.3f} {100 * inside:4.0f} %")
        print(f"{name:30} {'  '.join(cells)}")


def _lag(truth: Bounce) -> float:
    """Lag of a first-order filter: its phase at the frequency of the bounce."""
    if not truth.filter_hz:
        return truth.lag
    return truth.lag - math.atan(truth.frequency / truth.filter_hz) / (2 * math.pi * truth.frequency)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 100)
