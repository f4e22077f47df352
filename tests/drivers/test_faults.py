"""Every fault of the simulators against the drivers, while all devices stream."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from drivers import nidaq, qualisys_connection
from drivers.simulators.faults import FAULTS
from recordings.samples import Event, Loss, Samples
from tests.drivers.fault_bench import CASES, STREAMS, Aftermath, Case, FaultBench, random_faults, unaccounted
from tests.timeout import scaled_timeout


@pytest.fixture(scope="module")
def bench() -> Iterator[FaultBench]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(nidaq, "RPC_DEADLINE_S", scaled_timeout(1.0))
        patch.setattr(nidaq, "LONGEST_WAIT_S", 0.3)
        patch.setattr(qualisys_connection, "COMMAND_TIMEOUT_S", scaled_timeout(1.0))
        with FaultBench() as bench:
            yield bench


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_a_fault_is_reported_and_counted_and_ends_and_affects_nothing_else(bench: FaultBench, case: Case) -> None:
    aftermath = bench.suffer(case)
    causes = {item.cause for item in aftermath.items(case.device) if isinstance(item, Loss)}
    assert causes == case.causes
    for device, streams in STREAMS.items():
        items = aftermath.items(device)
        for stream in streams:
            assert unaccounted(items, stream) == []
            assert_device_time_goes_forward(aftermath, device, stream)
        if device != case.device:
            assert [item for item in items if isinstance(item, Loss | Event)] == [], f"{device} suffered, too"
    if case.device == "qtm":
        assert_markers_are_where_they_belong(aftermath, bench)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_under_random_faults_every_numbered_sample_was_received_or_counted_as_lost(
    bench: FaultBench, seed: int
) -> None:
    before = {name: len(listener.heard) for name, listener in bench.listeners.items()}
    bench.suffer_all(random_faults(seed, 20))
    for device, streams in STREAMS.items():
        items = bench.listeners[device].items(before[device])
        for stream in streams:
            assert unaccounted(items, stream) == []
            assert any(isinstance(item, Loss) and item.stream == stream for item in items)


def test_every_fault_of_a_device_has_its_case() -> None:
    assert {(case.device, case.fault) for case in CASES} == {
        (device, fault) for device in STREAMS for fault in FAULTS[device]
    }


def assert_device_time_goes_forward(aftermath: Aftermath, device: str, stream: str) -> None:
    latest = -1
    for item in aftermath.items(device):
        if isinstance(item, Event) and item.kind in ("numbering_restarted", "capture_replaced"):
            latest = -1
        if isinstance(item, Samples) and item.stream == stream:
            assert np.all(np.diff(item.device_time_ns, prepend=latest) >= 0)
            latest = int(item.device_time_ns[-1])


def assert_markers_are_where_they_belong(aftermath: Aftermath, bench: FaultBench) -> None:
    """A marker is missing or at its own place: whatever was on the wire, nothing else is delivered as one."""
    now = np.array([bench.world.now()])
    places = bench.world.markers(now)[0]
    for item in aftermath.items("qtm"):
        if isinstance(item, Samples):
            away = np.linalg.norm(item.values[:, :, :3] - places, axis=2)
            assert np.all((away < 30.0) | np.isnan(away))
