from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from drivers.simulators.settings import Settings
from drivers.simulators.world import World
from station.bench.simulation import execute_commands, parse_fault


def test_a_line_is_a_fault_at_the_present_time() -> None:
    fault = parse_fault('qtm drop_labels for_s=2 labels=["cuff_1"]\n')
    assert (fault.device, fault.fault, fault.at_s, fault.for_s, fault.labels) == (
        "qtm",
        "drop_labels",
        0.0,
        2.0,
        ("cuff_1",),
    )
    assert parse_fault("sync early_edge capture=2").capture == 2


def test_every_line_is_executed_or_refused_with_a_sentence() -> None:
    world, replies = World(Settings(), None), list[str]()
    world.clock.advance(7.0)
    faults = world.faults
    lines = ["ni freeze\n", "\n", "ni\n", "ni fire\n", "ni unplug for_s=soon\n", "sync glitch at_s=1\n"]
    execute_commands(lines, world, replies.append)
    assert [(one.begin, one.end) for one in faults.of("ni", "freeze", "unplug")] == [(7.0, 8.0)]
    assert faults.of("sync", "glitch")[0].begin == 8.0
    assert "freeze" in replies[0] and "'ni'" in replies[1] and "'fire'" in replies[2] and "for_s=soon" in replies[3]


def test_a_known_mass_is_hung_from_the_cell_until_the_next_capture_begins() -> None:
    world, replies = World(Settings(), None), list[str]()
    rig = world.cell_force(np.array([world.now()]))[0]
    execute_commands(["hang 2\n"], world, replies.append)
    assert world.cell_force(np.array([world.now()]))[0] == pytest.approx(2 * 9.80665)
    execute_commands(["hang\n", "hang -1\n", "hang 1 2\n", "hang nan\n", "hang 0\n"], world, replies.append)
    assert world.cell_force(np.array([world.now()]))[0] == 0.0
    assert replies[0].startswith("2 kg")
    assert all("kilograms" in refused for refused in replies[1:5])
    world.clock.advance(1.0)
    world.start_capture()
    assert world.cell_force(np.array([world.now()]))[0] == pytest.approx(rig, abs=0.1)
    assert world.cell_force(np.array([world.now() - 0.5]))[0] == 0.0, "the mass before the capture"
    world.clock.advance(1.0)
    world.hang(3)
    assert world.capture.end <= world.now() + 0.01, "a mass ends the capture"


@pytest.mark.skipif(sys.platform == "win32", reason="pipes cannot be waited for there")
def test_the_simulated_devices_execute_lines_while_they_serve(tmp_path: Path) -> None:
    (tmp_path / "station.toml").write_text('[daq]\ngrpc_target = "127.0.0.1:0"\n[mocap]\nport = 0\n')
    serve = [sys.executable, "-c", "from station.cli import main; main()", "simulate"]
    with subprocess.Popen(  # noqa: S603
        [*serve, "--config", str(tmp_path / "station.toml")], stdin=subprocess.PIPE, stderr=subprocess.PIPE
    ) as serving:
        assert serving.stdin is not None and serving.stderr is not None
        serving.stdin.write(b"ni unplug for_s=2\n")
        serving.stdin.flush()
        output = b""
        while b"unplug of ni" not in output and select.select([serving.stderr], [], [], 60.0)[0]:
            output += os.read(serving.stderr.fileno(), 4096)
        serving.send_signal(signal.SIGINT)
    assert b"unplug of ni" in output
