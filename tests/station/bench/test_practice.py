"""The commands of the README on the simulated bench: known mass, and a bounce that is armed during a capture."""

import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

from drivers.errors import DeviceCode
from drivers.qualisys import Qualisys
from drivers.simulators.settings import Settings, settings_from_dict
from drivers.simulators.simulated_bench import Bench
from drivers.simulators.world import World
from recordings.reader import open_recording
from station.bench.bench_clock import BenchClock
from station.bench.simulation import (
    SimulatedBench,
    SimulationError,
    execute_commands,
    is_served_by_simulator,
    parse_fault,
    simulator_settings,
)
from station.bench.trial_recorder import TrialRecorder
from station.bench.view import Snapshot, TrialState
from station.config import load_config, parse_config
from station.messages.bench_messages import TrialCode
from station.messages.setup_messages import SimulationCode
from station.protocol import TrialSpec
from tests.drivers.contract import raises_refusal as raises_device_refusal
from tests.refusals import raises_refusal
from tests.station.child_process import press
from tests.station.command import Ran
from tests.station.fake_devices import view
from tests.station.session.benched import config_at

Station = Callable[..., Ran]
MakeBench = Callable[..., Bench]
CONFIG = """
[daq]
grpc_target = "127.0.0.1:{ni}"
[mocap]
port = {qtm}
[bounce]
mass_kg = 2.5
marker = "weight"
[simulation.ports]
clock = {clock}
[cuffs.waist]
anchor_markers = ["anchor_1", "anchor_2", "anchor_3"]
cuff_markers = ["cuff_1"]
"""
WEIGHT = {"mass_kg": 2.5, "marker": "weight"}
BOUNCE = {"mass_kg": 2.5, "bounce_s": 8.0}
STATIC = {"lead_in_s": 1.0, "hold_s": 2.0, "step_masses_kg": [3.0]}


def written(bench: Bench, folder: Path) -> Path:
    path = folder / "station.toml"
    path.write_text(CONFIG.format(**bench.ports))
    return path


@pytest.mark.parametrize("into_the_capture_s", [0.1, 5.0, 10.9])
def test_a_trial_that_arms_in_the_middle_of_a_capture_records_the_next_one_whole(
    simulated_bench: MakeBench, station: Station, tmp_path: Path, into_the_capture_s: float
) -> None:
    bench = simulated_bench(bounce=BOUNCE)
    bench.world.select_trial(None, "bounce")
    end = bench.world.start_capture().end
    bench.clock.advance(into_the_capture_s)
    codes: set[TrialCode] = set()

    def show(snapshot: Snapshot) -> None:
        if snapshot.state is TrialState.ARMED:
            codes.update(message.code for message in snapshot.messages)

    with BenchClock(bench.ports["clock"]) as clock:
        result = TrialRecorder(config_at(bench.ports, bounce=WEIGHT), clock, [view(show)]).record(
            tmp_path, TrialSpec(None, "bounce", 1)
        )
    assert result.accepted and not result.lost_samples and result.path is not None
    if into_the_capture_s < 10.0:  # else the line falls in the first block, before its level has settled
        assert TrialCode.CAPTURE_RUNNING in codes
    assert open_recording(result.path).load("/markers").sample_numbers[0] == 1
    assert open_recording(result.path).load("/sync").values[0] < 0.5, "nothing of the earlier capture is in the file"
    assert station("info", result.path).code == 0
    assert bench.world.capture.start - end >= Settings().operator.delay_s, "the simulated operator takes his time"


def test_the_calibration_of_the_readme_s_walk_is_used_by_the_fit(
    simulated_bench: MakeBench, station: Station, tmp_path: Path
) -> None:
    bench = simulated_bench(speed=40.0, bounce={**BOUNCE, "bounce_s": 28.0}, protocol={"static": STATIC})
    bench.world.select_trial(None, "bounce")
    config, monday = written(bench, tmp_path), tmp_path / "simulated" / "monday"
    bench.world.start_capture()
    assert station("record", "--config", config, "--session", monday, "--test", "bounce").code == 0
    bench.world.select_trial("waist", "static")
    record = station("record", "--config", config, "--session", monday, "--cuff", "waist", "--test", "static")
    assert record.code == 0, record.err
    fit = station("fit", monday)
    assert fit.code == 0, fit.err
    cuffs = json.loads((monday / "cuffs.json").read_text())
    assert list(cuffs["calibration"]["sources"]) == ["test-bounce_run-1.mcap"]
    assert cuffs["calibration"]["gain_is_used"] and not cuffs["rejected"]


def test_a_known_mass_on_the_simulated_cell_is_right(
    simulated_bench: MakeBench, station: Station, tmp_path: Path
) -> None:
    bench = simulated_bench(speed=5.0, bounce=BOUNCE)
    bench.world.select_trial(None, "bounce")
    config, weighs = written(bench, tmp_path), ("check", "--session", tmp_path / "simulated" / "monday", "--known-mass")
    bench.world.hang(0)
    assert station(*weighs, 0, "--config", config).code == 0
    bench.world.hang(2)
    good = station(*weighs, 2, "--config", config)
    assert good.code == 0, good.out
    assert "expected 19.61" in good.out
    bench.world.hang(2.1)
    assert station(*weighs, 2, "--config", config).code == 1
    assert bench.world.capture is None, "a known mass starts no capture"


def test_record_uses_the_clock_of_the_simulated_bench_of_its_configuration_only(
    simulated_bench: MakeBench, tmp_path: Path
) -> None:
    bench, other = simulated_bench(), simulated_bench()
    assert is_served_by_simulator(load_config(written(bench, tmp_path)))
    for clock in (other.ports["clock"], bench.ports["qtm"]):
        (tmp_path / "station.toml").write_text(CONFIG.format(**{**bench.ports, "clock": clock}))
        assert not is_served_by_simulator(load_config(tmp_path / "station.toml")), "another program answers there"


def test_the_simulated_bench_has_the_wiring_of_the_configuration_unless_its_own_section_overrides_it() -> None:
    daq = {"device": "cDAQ7", "force_channel": "ai2", "sync_channel": "ai3"}
    simulation = {"protocol": {"static": {"hold_s": 2}}, "amplifier": {"noise_v": 0}}
    plain = {"daq": daq, "load_cell": {"capacity_kg": 100}, "simulation": simulation, "protocol": {"repeats": 2}}
    settings = simulator_settings(parse_config(plain, "t"))
    assert settings["wiring"] == {**daq, "emg": {}}
    assert settings["protocol"] == {"repeats": 2, "static": {"hold_s": 2}}
    assert settings["amplifier"] == {"capacity_kg": 100, "full_scale_v": 5, "noise_v": 0}


def test_the_simulated_qtm_requires_the_password_of_the_configuration() -> None:
    config = parse_config({"mocap": {"password": "secret"}}, "t")
    settings = settings_from_dict({**simulator_settings(config), "operator": {"capture": "remote"}})
    with Bench(settings, 30.0, 1) as bench:
        port = bench.ports["qtm"]
        for password, is_wrong in (("guess", True), ("secret", False)):
            qtm = Qualisys(host="127.0.0.1", port=port, host_clock=time.time_ns, control="start", password=password)
            with raises_device_refusal(DeviceCode.REFUSED, "Wrong or missing password") if is_wrong else nullcontext():
                qtm.open()
            qtm.close()


def test_a_bench_answers_until_it_is_closed_and_refuses_with_a_code() -> None:
    config = parse_config({"daq": {"device": "Dev7"}}, "t")
    with SimulatedBench(simulator_settings(config), 30.0, 1) as bench:
        pointed = bench.configure(config)
        assert pointed.daq.grpc_target == f"127.0.0.1:{bench.ready['ports']['ni']}"
        assert pointed.mocap.port == bench.ready["ports"]["qtm"]
        with raises_refusal(SimulationCode.REFUSED, kind=SimulationError):
            bench.request({"don": "knee"})
        assert bench.request({"truth": True})["truth"]["cuffs"]["hand"]["stiffness_n_per_m"] == 8520
    with raises_refusal(SimulationCode.NOT_RUNNING, kind=SimulationError):
        bench.request({"truth": True})


def test_unknown_settings_are_refused() -> None:
    with (
        raises_refusal(SimulationCode.REFUSED, "gravity", kind=SimulationError),
        SimulatedBench({"gravity": 3}, 1.0, 1),
    ):
        pass


def test_a_line_is_a_fault_at_the_present_time() -> None:
    fault = parse_fault('qtm drop_labels for_s=2 labels=["cuff_1"]\n')
    assert (fault.device, fault.fault, fault.labels) == ("qtm", "drop_labels", ("cuff_1",))
    assert (fault.at_s, fault.for_s) == (0.0, 2.0)
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


def test_the_simulated_devices_execute_lines_while_they_serve(tmp_path: Path) -> None:
    (tmp_path / "station.toml").write_text('[daq]\ngrpc_target = "127.0.0.1:0"\n[mocap]\nport = 0\n')
    serve = [sys.executable, "-c", "from station.cli import main; main()", "simulate"]
    with subprocess.Popen(  # noqa: S603
        [*serve, "--config", str(tmp_path / "station.toml")], stdin=subprocess.PIPE, stderr=subprocess.PIPE
    ) as serving:
        assert serving.stdin is not None and serving.stderr is not None
        serving.stdin.write(b"ni unplug for_s=2\n")
        serving.stdin.flush()
        is_executed = any(b"unplug of ni" in line for line in serving.stderr)
        press(signal.SIGINT, serving.pid)
    assert is_executed and serving.returncode == 0
