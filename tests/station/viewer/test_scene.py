"""Bodies and live values in Rerun."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import rerun as rr

from fitting.trial.analog_signals import AnalogSignals
from solver.bundled import bundled_model
from station.assessment.assessment_json import ACTIVATIONS_FILE, ASSESSMENT_FILE
from station.live.published import LiveFinding
from station.live.subscription import LiveSubscription, find_address
from station.sources import BUNDLED, named_hashes
from station.viewer.scene import LiveScene, emg_rms, log_scene, show_live
from station.viewer.viewer import SceneExtent
from tests.station.console.live_source import LiveSource
from tests.station.foreign import static_and_dynamic
from tests.station.wearer import SPECS, WearerSession

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


def scene_of(recording: Path, file: Path) -> bytes:
    stream = rr.RecordingStream("test")
    stream.save(file)
    log_scene(stream, recording, EDGE_NS, SceneExtent((0.1, 0.2, 1.2), 0.6))
    stream.disconnect()
    return file.read_bytes()


def test_fit_plateaus_body_and_suit_are_in_the_scene(tmp_path: Path) -> None:
    write_assessment(tmp_path, named_hashes(BUNDLED, None, None))
    for truth in static_and_dynamic():
        test = truth.manifest.test
        content = scene_of(truth.record(tmp_path / f"cuff-hand_test-{test}_run-1.mcap"), tmp_path / f"{test}.rrd")
        of_test = b"/fit/plateaus" if test == "static" else b"/fit/predicted"
        for name in (of_test, b"/fit/displacement", b"/body/muscles", b"/body/cord", b"/body/cuffs", b"Force [N]"):
            assert name in content


@pytest.mark.parametrize("role", ["model", "motion"])
def test_activations_of_another_body_or_motion_do_not_colour_the_bundled_one(tmp_path: Path, role: str) -> None:
    write_assessment(tmp_path, named_hashes(BUNDLED, None, None) | {role: "another"})
    truth, _ = static_and_dynamic()
    content = scene_of(truth.record(tmp_path / "cuff-hand_test-static_run-1.mcap"), tmp_path / "static.rrd")
    assert b"/fit/plateaus" in content
    assert b"/body" not in content


def test_elevation_and_emg_of_a_motion_are_in_the_scene(wearer: WearerSession, tmp_path: Path) -> None:
    tight = SPECS[-1]
    content = scene_of(wearer.path(tight), tmp_path / "tight.rrd")
    for name in (b"/wearer/elevation_deg", b"/wearer/emg_uv/deltoid", b"/wearer/emg_uv/trapezius", b"EMG RMS"):
        assert name in content
    assert b"/fit/" not in content


def test_the_rms_of_white_noise_is_its_standard_deviation_in_windows_of_a_tenth_of_a_second() -> None:
    numbers = np.arange(10_050)
    noise = np.random.default_rng(2).normal(0.0, [20e-6, 80e-6], (len(numbers), 2)) + 1.0
    emg = AnalogSignals(("a", "b"), "V", 1000.0, numbers, numbers / 1000.0, noise, 0.0)
    time, rms = emg_rms(emg)
    assert time[:2] == pytest.approx([0.0495, 0.1495]), "centres of the windows"
    assert rms.shape == (100, 2)
    assert np.sqrt(np.mean(rms**2, axis=0)) == pytest.approx([20e-6, 80e-6], rel=0.03)


FRAMES = 50
COMPONENTS = "scalars|strips|text"


def rows_in(file: Path) -> Counter[str]:
    """Rows over time by entity, counted by Rerun's own reader."""
    words = [sys.executable, "-m", "rerun", "rrd", "print", "-v", str(file)]
    printed = subprocess.run(words, check=True, capture_output=True, encoding="utf-8").stdout  # noqa: S603  (our own words)
    rows: Counter[str] = Counter()
    for count, name in re.findall(rf"with (\d+) rows .* - /([\w/]+) - .*:(?:{COMPONENTS})\]", printed):
        rows[name] += int(count)
    return rows


def test_a_live_process_fills_body_curves_and_findings(tmp_path: Path) -> None:
    file = tmp_path / "live.rrd"
    findings = (LiveFinding("live.not_held", "elbow_flexion is an estimate"),)
    with LiveScene(file) as scene:
        with LiveSource(tmp_path, findings=findings) as source:
            address = find_address(tmp_path)
            assert address is not None
            subscription = LiveSubscription(address)
            for _ in range(FRAMES):
                source.publish()
        with subscription:
            show_live(subscription, [scene])
    rows = rows_in(file)
    for name in ("effort/slack", "effort/worn", "cord_force_n/predicted", "cord_force_n/measured", "emg_uv/deltoid"):
        assert rows[f"live/{name}"] == FRAMES, name
    for name in ("muscles", "bones", "cord"):
        assert rows[f"body/{name}"] == FRAMES, "frames are 0.04 s apart"
    assert rows["events"] == 2, "whose body it is, and a finding once"
