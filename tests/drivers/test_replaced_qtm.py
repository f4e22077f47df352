"""A cable that is plugged into another mocap computer in mid trial: the other QTM's frames are not taken for ours."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import closing

import pytest

from drivers.catalogue import make_device
from drivers.simulators.bench import Bench
from recordings.samples import Event, Item
from tests.drivers.contract import blocks, read_until
from tests.drivers.tcp_proxy import TcpProxy

LOST, BACK, REPLACED = "connection_lost", "connection_restored", "capture_replaced"


@pytest.fixture
def first(simulated_bench: Callable[..., Bench]) -> Bench:
    return simulated_bench(speed=2.0, operator={"capture": "remote"})


@pytest.fixture
def second(simulated_bench: Callable[..., Bench]) -> Bench:
    return simulated_bench(speed=2.0, operator={"capture": "remote"})


def kinds(items: list[Item]) -> list[str]:
    return [item.kind for item in items if isinstance(item, Event) and item.kind in (LOST, BACK, REPLACED)]


def wait_until(bench: Bench, world_s: float) -> None:
    while bench.world.now() < world_s:
        time.sleep(0.01)


def delivered_after_the_link_moves(first: Bench, second: Bench, meanwhile: Callable[[], object]) -> list[Item]:
    """What a driver delivers once its link, which led to the first bench, leads to the second."""

    def host_clock() -> int:
        return first.start_utc_ns + int(first.world.now() * 1e9)

    first.world.start_capture()
    with TcpProxy(first.ports["qtm"]) as link:
        device = make_device("qualisys", host="127.0.0.1", port=link.port, host_clock=host_clock)
        with closing(device):
            device.open()
            wait_until(first, first.world.now() + 3.0)
            read_until(device, lambda items: bool(blocks(items, "/markers")))
            link.refuse()
            read_until(device, lambda items: LOST in kinds(items))
            meanwhile()
            link.target_port = second.ports["qtm"]
            link.listen()
            return read_until(device, lambda items: BACK in kinds(items) and bool(blocks(items, "/markers")))


@pytest.mark.parametrize("begins", ["before ours", "after ours"])
def test_another_qtm_that_answers_after_a_reconnection_is_noticed(first: Bench, second: Bench, begins: str) -> None:
    if begins == "before ours":
        second.world.start_capture()
        wait_until(second, second.world.now() + 6.0)
    items = delivered_after_the_link_moves(
        first, second, second.world.start_capture if begins == "after ours" else lambda: None
    )
    assert REPLACED in kinds(items)
    event = next(item for item in items if isinstance(item, Event) and item.kind == REPLACED)
    assert "is back with another capture: frame" in event.text and "check that mocap.host" in event.text


def test_the_same_qtm_that_answers_after_a_reconnection_is_none(first: Bench) -> None:
    assert REPLACED not in kinds(delivered_after_the_link_moves(first, first, lambda: None))
