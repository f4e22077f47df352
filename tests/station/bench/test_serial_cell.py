"""A load cell on a serial line: checked, tared, recorded and tied to the cameras as far as its lines allow."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path

import pytest
from rich.console import Console

from drivers.simulators.bench import Bench
from fitting.trial.mass_checks import read_checks
from fitting.trial.reader import read_trial
from station.bench.bench_clock import BenchClock
from station.bench.check import inspect_bench
from station.bench.known_mass import check_known_mass
from station.bench.trial_recorder import TrialRecorder
from station.config import StationConfig, parse_config
from station.protocol import TrialSpec

SPEED = 5.0
HELD = 9.80665 * 3.0 + 2.0  # N, the weight and the hook


@pytest.fixture
def bench(simulated_bench: Callable[..., Bench]) -> Bench:
    static = {"lead_in_s": 2.0, "hold_s": 4.0, "step_masses_kg": [3.0]}
    return simulated_bench(SPEED, protocol={"static": static}, mocap={"occlusions_per_minute": 0})


@pytest.fixture
def config(bench: Bench) -> StationConfig:
    return parse_config(
        {
            "daq": {"grpc_target": f"127.0.0.1:{bench.ports['ni']}"},
            "load_cell": {
                "source": "serial",
                "port": f"socket://127.0.0.1:{bench.ports['serial']}",
                "capacity_kg": 25,
                "serial_number": "S9",
                "calibrated_on": "2026-03-01",
                "gain_relative_sd": 0.001,
            },
            "mocap": {"port": bench.ports["qtm"]},
            "cuffs": {"waist": {"anchor_markers": bench.world.labels[:4], "cuff_markers": ["cuff_1"]}},
        },
        "test",
    )


def test_zero_and_certificate_are_checked(config: StationConfig, tmp_path: Path) -> None:
    out = Console(file=io.StringIO(), width=200)
    assert check_known_mass(config, tmp_path, 0.0, out, listen_s=0.5) == 0
    (zero,) = read_checks(tmp_path)
    assert zero.found == pytest.approx(2.0, abs=0.1), "the hook alone, in newtons though the line tells pounds"
    results = {result.subject: result for result in inspect_bench(config, tmp_path)}
    figures = results["calibration of the load cell"].message.figures
    assert (figures["serial_number"], figures["calibrated_on"]) == ("of S9 ", "2026-03-01")
    assert results["force at rest"].is_good


def test_a_trial_of_it_is_in_newtons_and_its_clocks_are_certified(
    bench: Bench, config: StationConfig, tmp_path: Path
) -> None:
    with BenchClock(bench.ports["clock"], speed=1000.0) as clock:
        result = TrialRecorder(config, clock).record(tmp_path, TrialSpec("waist", "static", 1))
    assert result.accepted and result.path is not None, result.sentence
    trial = read_trial(result.path)
    assert trial.force.max() == pytest.approx(HELD, rel=0.05)
    assert trial.sync is not None and trial.sync.has_both_edges
    assert trial.sync.errors.time == pytest.approx(0.05, rel=0.01), "lines are stamped when they arrive"
    assert trial.sync.errors.force == pytest.approx(0.05 * trial.sync.force_rate, rel=0.01)
    assert trial.sync.force_rate > 20.0
