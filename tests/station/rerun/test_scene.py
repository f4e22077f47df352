from __future__ import annotations

from pathlib import Path

import numpy as np
import rerun as rr

from solver.bundled import bundled_model
from station.muscles.assessment_json import ACTIVATIONS_FILE
from station.rerun.scene import log_scene
from tests.station.foreign import static_and_dynamic


def test_fit_plateaus_body_and_suit_are_in_the_scene(tmp_path: Path) -> None:
    names = bundled_model().muscle_names
    times = np.linspace(0.0, 7.0, 20)
    rows = [",".join(["condition", "cuff", "time_s", *names])]
    rows += [",".join(["both", "hand", f"{t:g}", *(f"{a:g}" for a in np.full(len(names), 0.3))]) for t in times]
    for truth in static_and_dynamic():
        test = truth.manifest.test
        path = truth.record(tmp_path / f"cuff-hand_test-{test}_run-1.mcap")
        (tmp_path / ACTIVATIONS_FILE).write_text("\n".join(rows) + "\n")
        stream = rr.RecordingStream("test")
        file = tmp_path / f"{test}.rrd"
        stream.save(file)
        log_scene(stream, path)
        stream.disconnect()
        content = file.read_bytes()
        of_test = b"/fit/plateaus" if test == "static" else b"/fit/fitted"
        for name in (of_test, b"/fit/displacement", b"/body/muscles", b"/suit/cord", b"/suit/cuffs"):
            assert name in content
