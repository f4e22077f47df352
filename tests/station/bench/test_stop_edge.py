"""A sync line that falls within the last frame, through the real wires: the certificate covers the true clock ratio."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from drivers.simulators.settings import settings_from_dict
from drivers.simulators.simulated_bench import Bench
from station.bench.bench_clock import BenchClock
from station.bench.trial_recorder import TrialRecorder
from station.config import parse_config
from station.protocol import TrialSpec


def _record(folder: Path, before_frame_end_s: float, ppm: float, sync: dict[str, Any], hold_s: float = 12.0) -> Path:
    """One trial of three holds, which the wire's own devices time."""
    settings = {
        "ports": {"serial": None},
        "sync": {"before_frame_end_s": before_frame_end_s},
        "daq_clock": {"offset_ppm": ppm, "drift_ppm_per_hour": 0},
        "protocol": {"static": {"lead_in_s": 1.0, "hold_s": hold_s, "step_masses_kg": [3.0]}},
        "mocap": {"occlusions_per_minute": 0},
    }
    with Bench(settings_from_dict(settings), None, seed=3) as bench:
        config = {
            "daq": {"grpc_target": f"127.0.0.1:{bench.ports['ni']}"},
            "mocap": {"port": bench.ports["qtm"]},
            "sync": sync,
            "cuffs": {"waist": {"anchor_markers": bench.world.labels[:4], "cuff_markers": ["cuff_1"]}},
        }
        with BenchClock(bench.ports["clock"]) as clock:
            result = TrialRecorder(parse_config(config, "test"), clock, []).record(
                folder, TrialSpec("waist", "static", 1)
            )
    assert result.accepted
    assert result.path is not None
    return result.path


@pytest.mark.parametrize(
    ("before_frame_end_s", "ppm", "sync", "is_identified"),
    [
        (0.003, 0, {}, True),
        (0.0, 50, {}, True),
        (0.0096, -300, {}, False),
        (0.0096, 50, {"stop_edge": "end_of_exposure", "exposure_s": 0.0004}, True),
        (0.0, -300, {"stop_edge": "end_of_frame"}, True),
    ],
)
def test_the_interval_of_info_contains_the_clock_ratio(
    station, tmp_path: Path, before_frame_end_s: float, ppm: float, sync: dict[str, Any], is_identified: bool
) -> None:
    ran = station("info", _record(tmp_path, before_frame_end_s, ppm, sync), "--format", "json")
    assert ran.code == 0
    found = json.loads(ran.out)["sync"]
    low, high = found["clock_ratio_ci95_ppm"]
    assert low <= ppm <= high
    assert high - low < (60 if sync else 600)
    assert found["clock_ratio_is_identified"] == is_identified
    assert found["time_standard_error_s"] > (2e-4 if sync else 1.5e-3)


def test_the_clock_ratio_of_a_short_capture_is_not_identified(station, tmp_path: Path) -> None:
    ran = station("info", _record(tmp_path, 0.003, 20, {}, hold_s=2.0))
    assert "clock ratio not identified, between " in ran.out
    assert "the capture is too short" in ran.out
