"""What other laboratories get: the fixture, registered with pytest by the package."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable
from importlib.metadata import entry_points

import numpy as np
import pytest

from drivers.qualisys import Qualisys
from drivers.simulators.errors import SimulatorCode
from drivers.simulators.faults import fault_from_dict
from drivers.simulators.simulated_bench import Bench
from recordings.samples import Loss
from tests.drivers.contract import blocks, read_until
from tests.refusals import raises_refusal

pytest_plugins = ["pytester"]


def test_the_package_registers_it() -> None:
    (plugin,) = (point for point in entry_points(group="pytest11") if point.name == "cuffstation")
    assert plugin.value == "cuffstation.pytest_plugin"


def test_the_bench_streams_and_has_the_requested_faults(simulated_bench: Callable[..., Bench]) -> None:
    bench = simulated_bench(
        speed=30,
        faults=[{"device": "qtm", "fault": "skip_frames", "at_s": 1, "for_s": 0.5}],
        operator={"capture": "remote"},
    )
    qtm = Qualisys(host="127.0.0.1", port=bench.ports["qtm"], host_clock=time.time_ns)
    qtm.open()
    bench.world.start_capture()
    items = read_until(qtm, lambda items: any(isinstance(item, Loss) for item in items))
    qtm.close()
    (loss,) = (item for item in items if isinstance(item, Loss))
    assert (loss.first_missing, loss.count) == (101, 50)
    assert np.isfinite(blocks(items, "/markers")[0].values).any()


def test_the_sync_line_of_the_bench_misbehaves_too_by_plan_and_at_run_time(
    simulated_bench: Callable[..., Bench],
) -> None:
    double = {"device": "sync", "fault": "double_edge", "at_s": 0.02, "for_s": 0.05}
    world = simulated_bench(faults=[double], operator={"capture": "remote"}).world
    start = world.start_capture().start
    world.faults.inject(fault_from_dict({"device": "sync", "fault": "glitch", "at_s": 100.0}))
    (glitch,) = world.faults.of("sync", "glitch")
    moments = np.array([start + 0.01, start + 0.05, start + 0.08, glitch.begin - 0.001, glitch.begin + 0.001])
    assert (world.sync_voltage(moments) > 2.5).tolist() == [True, False, True, False, True], "100 s on it is at rest"


def test_every_bench_ends_with_the_test(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(
        """
        import pathlib
        def test_two(simulated_bench):
            ports = [simulated_bench(ports={"ni": None, "serial": None}).ports["qtm"] for _ in range(2)]
            pathlib.Path("ports").write_text(" ".join(map(str, ports)))
        """
    )
    pytester.runpytest_inprocess("-W", "ignore::pytest.PytestAssertRewriteWarning").assert_outcomes(passed=1)
    for port in (pytester.path / "ports").read_text().split():
        with pytest.raises(ConnectionRefusedError):
            socket.create_connection(("127.0.0.1", int(port)))


def test_what_cannot_be_used_is_refused_in_a_sentence(simulated_bench: Callable[..., Bench]) -> None:
    with raises_refusal(SimulatorCode.WRONG_FAULT, "'fire'"):
        simulated_bench(faults=[{"device": "serial", "fault": "fire"}])
    with raises_refusal(SimulatorCode.WRONG_SETTING, "moocap"):
        simulated_bench(moocap={})
