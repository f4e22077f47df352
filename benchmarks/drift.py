"""Error of the alignment of force and markers for two drifting clocks, with both edges of the sync line and with one.

    python -m benchmarks.drift [TRIALS]

Blocks arrive late by 5 ms on average, at random (exponential). The force of each sample is its true time, so that the
error of its estimated time is known. Prints the worst of all samples of all trials.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace

import numpy as np

from fitting.trial.trial import build_trial
from recordings.manifest import CuffSite, LoadCell, Manifest, Timing
from recordings.reader import Track
from tests.fitting.experiment import track

PPM = (0, 20, 50, 100, 150, 200)
LABELS = ("a1", "a2", "a3", "cuff")
SECONDS_PER_VOLT = 20.0


@dataclass(frozen=True)
class Residual:
    """Largest error of a sample's time [s], and the standard uncertainty of the certificate [s]."""

    worst: float
    stated: float


def residual(ppm: float, seed: int, *, duration: float = 60.0, jitter: float = 5e-3, stops: bool = True) -> Residual:
    """Residual of a trial of 1 kHz and 100 Hz whose DAQ is fast by ppm; stops: whether the stop edge was recorded."""
    random = np.random.default_rng(seed)
    edge, rate = 2.0 + random.uniform(0, 1e-3), 1000.0
    numbers = np.arange(int((edge + duration + 0.5) * rate))
    true = (numbers / rate - edge) / (1 + 1e-6 * ppm)
    high = (true >= 0) & ((true < duration) | (not stops))
    frames = np.arange(round(duration * 100))
    markers = np.tile(1e3 * np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]]), (len(frames), 1, 1))
    tracks = {
        "/force": track("/force", "V", ("ai0",), rate, numbers, true, 0, true[:, None] / SECONDS_PER_VOLT),
        "/sync": track("/sync", "V", ("ai1",), rate, numbers, true, 0, 5.0 * high[:, None]),
        "/markers": track("/markers", "mm", LABELS, 100.0, frames + 1, frames / 100, 0, markers),
    }
    late = {name: _late(each, jitter, random) for name, each in tracks.items()}
    trial = build_trial(_manifest(), late, "drift", "")
    assert trial.sync is not None  # noqa: S101  (it has a sync line)
    return Residual(float(np.abs(trial.force_time - trial.force).max()), trial.sync.errors.time)


def _late(of: Track, jitter: float, random: np.random.Generator) -> Track:
    """Arrival times: every block of 50 ms has a random delay, and blocks stay in order."""
    block = np.arange(len(of.sample_numbers)) // max(1, int(of.stream.rate_hz / 20))
    delay = random.exponential(jitter, block[-1] + 1)[block]
    arrival = of.host_time_ns + np.round(1e9 * delay).astype(np.int64)
    return replace(of, host_time_ns=np.maximum.accumulate(arrival))


def _manifest() -> Manifest:
    """Newtons are seconds."""
    return Manifest(
        cuff=CuffSite("hand", "arm", LABELS[:3], LABELS[3:]),
        test="dynamic",
        repeat=1,
        run=1,
        donning="1",
        start="sync_edge",
        sync_threshold_v=2.5,
        load_cell=LoadCell("daq", SECONDS_PER_VOLT, 1),
        start_utc_ns=0,
        timing=Timing(stop_edge="end_of_frame"),
    )


def main(trials: int) -> None:
    print(f"{'clocks apart':<14}{'both edges':>14}{'stated':>10}{'start edge only':>18}{'stated':>10}")
    for ppm in PPM:
        row = f"{ppm:>4} ppm      "
        for stops, width in ((True, 14), (False, 18)):
            found = [residual(sign * ppm, seed, stops=stops) for seed in range(trials) for sign in (1, -1)]
            worst, stated = max(drift.worst for drift in found), max(drift.stated for drift in found)
            row += f"{1e3 * worst:>{width - 3}.2f} ms{1e3 * stated:>7.2f} ms"
        print(row, flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 20)
