"""What other laboratories get: the fixture, registered with pytest by the package."""

import socket
import time
from collections.abc import Callable
from importlib.metadata import entry_points

import numpy as np
import pytest

from drivers.qualisys import Qualisys
from drivers.simulators.errors import SimulatorCode
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
