"""Write format_1_live.mcap, the golden file of live results: `python -m tests.recordings.golden.make_format_1_live`.

Written once with version 1 of the format, and never again: the tests open it with every later version.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from recordings.live_result import LiveFrame, LiveManifest, LiveOutcome, LiveResultWriter
from recordings.samples import Event

PATH = Path(__file__).with_name("format_1_live.mcap")
START_NS = 1_760_000_000_000_000_000
MANIFEST = LiveManifest(
    recording="condition-tight_test-motion_run-1.mcap",
    columns={"coordinate/elevation": "rad", "slack/effort": "", "worn/cord_force": "N"},
    suits=("slack", "worn"),
    model="thoracoscapular",
    is_scaled=True,
    lag_s=0.15,
    origin="simulated",
    versions={"cuffstation": "0.1.0"},
    settings={"lag_s": 0.15},
)
FRAMES = tuple(
    LiveFrame(
        frame=k + 1,
        time_s=k / 100,
        outcome="solved" if k != 3 else "no_markers",
        suit_outcomes=("solved", "infeasible") if k == 4 else ("solved", "solved"),
        values=np.array([k / 10, np.nan if k == 3 else 0.25, 1e-3 + k]),
        hidden=("ac", "EpL") if k == 3 else (),
        exchanged=("ac aa",) if k == 5 else (),
        latency_s=0.002,
        dropped_frames=k // 5,
        every=1 + k // 8,
    )
    for k in range(10)
)
EVENT = Event("rest_length", "worn: 0.7000 m", START_NS, "live")
OUTCOME = LiveOutcome(
    complete=True,
    sentence="the trial has ended",
    recording=MANIFEST.recording,
    recording_sha256="0" * 64,
    frames=10,
    dropped_frames=1,
)


def main() -> None:
    writer = LiveResultWriter(PATH, MANIFEST)
    for frame in FRAMES:
        writer.write(frame, START_NS + round(1e9 * frame.time_s))
    writer.note(EVENT)
    writer.close(OUTCOME, START_NS + 100_000_000)


if __name__ == "__main__":
    main()
