from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import rerun as rr

from solver.bundled import bundled_model
from station.assessment.assessment_json import ACTIVATIONS_FILE, ASSESSMENT_FILE
from station.assessment.sources import BUNDLED, named_hashes
from station.viewer.layout import Framed
from station.viewer.scene import log_scene
from tests.station.foreign import static_and_dynamic

EDGE_NS = 1_750_000_000_000_000_000


def write_assessment(folder: Path, inputs: dict[str, str]) -> None:
    names = bundled_model().muscle_names
    rows = [",".join(["condition", "cuff", "time_s", *names])]
    rows += [
        ",".join(["both", "hand", f"{t:g}", *(f"{a:g}" for a in np.full(len(names), 0.3))])
        for t in np.linspace(0.0, 7.0, 20)
    ]
    (folder / ACTIVATIONS_FILE).write_text("\n".join(rows) + "\n")
    (folder / ASSESSMENT_FILE).write_text(json.dumps({"inputs": inputs}))


def scene_of(recording: Path) -> bytes:
    stream, file = rr.RecordingStream("test"), recording.with_suffix(".rrd")
    stream.save(file)
    log_scene(stream, recording, EDGE_NS, Framed((0.1, 0.2, 1.2), 0.6))
    stream.disconnect()
    return file.read_bytes()


def test_fit_plateaus_body_and_suit_are_in_the_scene(tmp_path: Path) -> None:
    write_assessment(tmp_path, named_hashes(BUNDLED, None, None))
    for truth in static_and_dynamic():
        test = truth.manifest.test
        content = scene_of(truth.record(tmp_path / f"cuff-hand_test-{test}_run-1.mcap"))
        of_test = b"/fit/plateaus" if test == "static" else b"/fit/predicted"
        for name in (of_test, b"/fit/displacement", b"/body/muscles", b"/body/cord", b"/body/cuffs", b"Force [N]"):
            assert name in content


@pytest.mark.parametrize("role", ["model", "motion"])
def test_activations_of_another_body_or_motion_do_not_colour_the_bundled_one(tmp_path: Path, role: str) -> None:
    write_assessment(tmp_path, named_hashes(BUNDLED, None, None) | {role: "another"})
    truth, _ = static_and_dynamic()
    content = scene_of(truth.record(tmp_path / "cuff-hand_test-static_run-1.mcap"))
    assert b"/fit/plateaus" in content
    assert b"/body" not in content
