from __future__ import annotations

import time
from contextlib import nullcontext

from drivers.errors import DeviceCode
from drivers.qualisys import Qualisys
from station.bench.simulation import SimulatedBench, SimulationError, simulator_settings
from station.config import parse_config
from station.messages.setup_codes import SimulationCode
from tests.drivers.contract import raises_refusal as raises_device_refusal
from tests.station.refusals import raises_refusal


def test_the_simulated_bench_has_the_wiring_of_the_configuration() -> None:
    daq = {"device": "cDAQ7", "force_channel": "ai2", "sync_channel": "ai3"}
    settings = simulator_settings(parse_config({"daq": daq, "load_cell": {"capacity_kg": 100}}, "t"))
    assert settings["wiring"] == {**daq, "emg": {}}
    assert settings["amplifier"]["capacity_kg"] == 100


def test_the_simulation_section_overrides_the_other_sections_key_by_key() -> None:
    simulation = {"protocol": {"static": {"hold_s": 2}}, "amplifier": {"noise_v": 0}}
    settings = simulator_settings(parse_config({"simulation": simulation, "protocol": {"repeats": 2}}, "t"))
    assert settings["protocol"] == {"repeats": 2, "static": {"hold_s": 2}}
    assert settings["amplifier"] == {"capacity_kg": 50, "full_scale_v": 5, "noise_v": 0}


def test_the_simulated_qtm_requires_the_password_of_the_configuration() -> None:
    config = parse_config({"mocap": {"password": "secret"}}, "t")
    with SimulatedBench({**simulator_settings(config), "operator": {"capture": "remote"}}, 30.0, 1) as bench:
        port = bench.ready["ports"]["qtm"]
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
        with raises_refusal(SimulationError, SimulationCode.REFUSED):
            bench.request({"don": "knee"})
        assert bench.request({"truth": True})["truth"]["cuffs"]["hand"]["stiffness_n_per_m"] == 8520
    with raises_refusal(SimulationError, SimulationCode.NOT_RUNNING):
        bench.request({"truth": True})


def test_unknown_settings_are_refused() -> None:
    with raises_refusal(SimulationError, SimulationCode.REFUSED) as caught, SimulatedBench({"gravity": 3}, 1.0, 1):
        pass
    assert "gravity" in caught.value.cause.figures["reason"]
