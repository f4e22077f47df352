"""A cable plugged into another mocap computer during a trial: frames of the other QTM are not recorded."""

import time
from collections.abc import Callable
from contextlib import closing

import pytest

from drivers.qualisys_wire import CameraSystem, decode_parameters
from drivers.reconnecting import make_device
from drivers.simulators.simulated_bench import Bench
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


def delivered_after_the_link_moves(
    first: Bench, second: Bench, meanwhile: Callable[[], object], *, is_ours: bool = False
) -> list[Item]:
    """What a driver delivers once its link, which led to the first bench, leads to the second."""

    def host_clock() -> int:
        return first.start_utc_ns + int(first.world.now() * 1e9)

    if not is_ours:
        first.world.start_capture()
    with TcpProxy(first.ports["qtm"]) as link:
        control = "start" if is_ours else None
        device = make_device("qualisys", host="127.0.0.1", port=link.port, host_clock=host_clock, control=control)
        with closing(device):
            device.open()
            if is_ours:
                device.start_capture()
            wait_until(first, first.world.now() + 3.0)
            read_until(device, lambda items: bool(blocks(items, "/markers")))
            link.refuse()
            read_until(device, lambda items: LOST in kinds(items))
            meanwhile()
            link.target_port = second.ports["qtm"]
            link.listen()
            items = read_until(device, lambda items: BACK in kinds(items) and bool(blocks(items, "/markers")))
            if is_ours:
                device.stop_capture()
            return items


@pytest.mark.parametrize("begins", ["before ours", "after ours"])
def test_another_qtm_that_answers_after_a_reconnection_is_detected(first: Bench, second: Bench, begins: str) -> None:
    if begins == "before ours":
        second.world.start_capture()
        wait_until(second, second.world.now() + 6.0)
    items = delivered_after_the_link_moves(
        first, second, second.world.start_capture if begins == "after ours" else lambda: None
    )
    assert REPLACED in kinds(items)
    event = next(item for item in items if isinstance(item, Event) and item.kind == REPLACED)
    assert "frame" in event.text and "mocap.host" in event.text


@pytest.mark.parametrize("other", [{"camera_serials": [21001, 21002]}, {"calibrated": "2026-01-02 08:15:00"}])
def test_another_qtm_whose_capture_is_as_old_as_ours_is_detected(
    first: Bench, simulated_bench: Callable[..., Bench], other: dict[str, object]
) -> None:
    second = simulated_bench(speed=2.0, operator={"capture": "remote"}, mocap=other)
    second.world.start_capture()
    items = delivered_after_the_link_moves(first, second, lambda: None, is_ours=True)
    event = next(item for item in items if isinstance(item, Event) and item.kind == REPLACED)
    assert "cameras" in event.text and "mocap.host" in event.text
    capture = second.world.capture
    assert capture.end > second.world.now(), "the other's capture is not ours to end"
    first_block = next(place for place, item in enumerate(items) if BACK in kinds([item]))
    assert REPLACED in kinds(items[first_block:]), "reported with the reconnection, before the other's frames are kept"


@pytest.mark.parametrize(
    ("after", "is_other"),
    [
        (((12056, 12059), "2011-07-05 12:43:38"), False),
        (((12056,), "2011-07-05 12:43:38"), False),  # a camera failed
        (((), ""), False),  # a QTM that reports neither
        (((12039,), "2011-07-05 12:43:38"), True),
        (((12056, 12059), "2011-07-06 09:00:00"), True),
    ],
)
def test_cameras_and_their_calibration_distinguish_one_qtm_from_another(
    after: tuple[tuple[int, ...], str], *, is_other: bool
) -> None:
    def cameras(serials: tuple[int, ...], calibrated: str) -> CameraSystem:
        listed = "".join(f"<Camera><Model>Oqus 300</Model><Serial>{serial}</Serial></Camera>" for serial in serials)
        general = f"<General><Frequency>100</Frequency>{listed}</General>"
        markers = f"<The_3D><CalibrationTime>{calibrated}</CalibrationTime><Label><Name>a</Name></Label></The_3D>"
        xml = f"<QTM_Parameters_Ver_1.10>{general}{markers}</QTM_Parameters_Ver_1.10>"
        return decode_parameters(xml.encode()).cameras

    before = cameras((12056, 12059), "2011-07-05 12:43:38")
    assert before.contradicts(cameras(*after)) is is_other


def test_the_same_qtm_that_answers_after_a_reconnection_is_none(first: Bench) -> None:
    assert REPLACED not in kinds(delivered_after_the_link_moves(first, first, lambda: None))
