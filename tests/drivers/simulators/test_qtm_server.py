"""The simulated QTM, asked by unmodified qtm_rt."""

import asyncio
import errno
import math
import socket
import struct
import sys
from collections.abc import Awaitable, Callable
from typing import Any
from xml.etree import ElementTree

import pytest
import qtm_rt
from qtm_rt import discovery
from qtm_rt.packet import QRTComponentType, QRTEvent
from qtm_rt.protocol import QRTCommandException

from drivers.simulators.faults import fault_from_dict
from drivers.simulators.qtm_discovery import QtmDiscovery
from drivers.simulators.qtm_server import MOST_CLIENTS, QualisysSimulator
from drivers.simulators.settings import settings_from_dict
from drivers.simulators.simulated_bench import Bench
from drivers.simulators.world import World
from tests.drivers.simulated_qtm import serving, simulator
from tests.timeout import scaled_timeout

PATIENCE_S = 10.0


class Client:
    """A connection of qtm_rt, with the events and frames it received."""

    def __init__(self) -> None:
        self.events: list[QRTEvent] = []
        self.frames: list[Any] = []
        self.rt: Any = None

    async def wait_for(self, claim: Callable[[], bool]) -> None:
        async with asyncio.timeout(scaled_timeout(PATIENCE_S)):
            while not claim():
                await asyncio.sleep(0.005)


def talk(port: int, conversation: Callable[[Client], Awaitable[None]]) -> Client:
    """Holds the conversation on a connection of its own."""

    async def whole() -> Client:
        client = Client()
        client.rt = await qtm_rt.connect("127.0.0.1", port, on_event=client.events.append)
        await conversation(client)
        client.rt.disconnect()
        return client

    return asyncio.run(whole())


async def capture(client: Client, frames: int, component: str = "3dres", which: str = "allframes") -> None:
    """Takes control, captures until so many frames came, stops."""
    await client.rt.take_control("")
    await client.rt.new()
    await client.rt.stream_frames(which, [component], client.frames.append)
    await client.rt.start()
    await client.wait_for(lambda: len(client.frames) >= frames)
    await client.rt.stop()
    await client.wait_for(lambda: QRTEvent.EventCaptureStopped in client.events)


def test_it_identifies_itself_in_the_words_of_qtm_and_its_settings_name_the_markers_and_the_rate() -> None:
    async def ask(client: Client) -> None:
        assert (await client.rt.qtm_version()).startswith(b"QTM Version is ")
        assert await client.rt.byte_order() == b"Byte order is little endian"
        assert await client.rt.get_state() == QRTEvent.EventConnectionClosed
        root = ElementTree.fromstring(await client.rt.get_parameters(["general", "3d"]))  # noqa: S314
        assert root.tag == "QTM_Parameters_Ver_1.25"
        assert root.findtext("General/Frequency") == "100"
        labels = [node.text for node in root.findall("The_3D/Label/Name")]
        assert labels == ["anchor_1", "anchor_2", "anchor_3", "anchor_4", "cuff_1", "rope_1", "rope_2"]
        assert root.findtext("The_3D/Labels") == "7"

    with simulator() as qtm:
        talk(qtm.port, ask)


def test_labelled_3d_comes_with_and_without_residuals() -> None:
    with simulator(occlusions_per_minute=0) as qtm:
        plain = talk(qtm.port, lambda client: capture(client, 10, component="3d"))
    with simulator(occlusions_per_minute=0) as qtm:
        rich = talk(qtm.port, lambda client: capture(client, 10))
    _, markers = plain.frames[0].get_3d_markers()
    _, with_residuals = rich.frames[0].get_3d_markers_residual()
    assert len(markers) == len(with_residuals) == 7
    assert markers[0].z == pytest.approx(with_residuals[0].z, abs=20.0)
    assert 0 < with_residuals[0].residual < 5


def test_a_hidden_marker_has_all_bits_of_its_place_set() -> None:
    with simulator(occlusions_per_minute=60.0, mean_occlusion_s=1.0) as qtm:
        client = talk(qtm.port, lambda client: capture(client, 1500))
    hidden = 0
    for packet in client.frames:
        _, markers = packet.get_3d_markers_residual()
        first = packet.components[QRTComponentType.Component3dRes] + 8
        for n, marker in enumerate(markers):
            if math.isnan(marker.x):
                hidden += 1
                assert packet.data[first + 16 * n : first + 16 * n + 12] == b"\xff" * 12
    assert hidden > 50


@pytest.mark.parametrize(("which", "step"), [("frequencydivisor:4", 4), ("frequency:50", 2)])
def test_a_client_may_ask_for_fewer_frames(which: str, step: int) -> None:
    with simulator() as qtm:
        client = talk(qtm.port, lambda client: capture(client, 50, which=which))
    assert [packet.framenumber for packet in client.frames] == [1 + step * n for n in range(len(client.frames))]


def test_a_capture_sends_events_at_its_start_its_end_and_when_it_is_saved() -> None:
    async def whole(client: Client) -> None:
        await capture(client, 10)
        assert await client.rt.save("trial") == b"Measurement saved"
        assert await client.rt.close() == b"No connection to close"

    with simulator() as qtm:
        client = talk(qtm.port, whole)
    assert client.events == [
        QRTEvent.EventConnected,
        QRTEvent.EventCaptureStarted,
        QRTEvent.EventCaptureStopped,
        QRTEvent.EventCaptureSaved,
    ]


def test_a_capture_that_follows_at_once_begins_after_the_end_of_the_one_before() -> None:
    world = World(settings_from_dict({"operator": {"capture": "remote"}}), speed=30.0)

    async def watch(client: Client) -> None:
        await client.rt.stream_frames("allframes", ["3d"], client.frames.append)
        world.start_capture()
        await client.wait_for(lambda: len(client.frames) > 10)
        world.stop_capture()
        world.start_capture()
        await client.wait_for(lambda: client.events.count(QRTEvent.EventCaptureStarted) == 2)

    with serving(world) as qtm:
        client = talk(qtm.port, watch)
    assert client.events == [QRTEvent.EventCaptureStarted, QRTEvent.EventCaptureStopped, QRTEvent.EventCaptureStarted]


def test_frames_are_late_when_the_sync_line_rises_early() -> None:
    early = fault_from_dict({"device": "sync", "fault": "early_edge", "for_s": 2.0})
    world = World(settings_from_dict({"operator": {"capture": "remote"}}), speed=30.0, fault_plan=[early])

    async def watch(client: Client) -> None:
        await client.rt.stream_frames("allframes", ["3d"], client.frames.append)
        start = world.start_capture().start
        await client.wait_for(lambda: len(client.frames) > 100)
        assert client.frames[0].framenumber == 1
        assert len(client.frames) / 100 <= world.now() - start - 2.0 + 0.01

    with serving(world) as qtm:
        talk(qtm.port, watch)


def test_an_unsaved_measurement_prevents_a_new_one() -> None:
    async def again(client: Client) -> None:
        await capture(client, 10)
        with pytest.raises(QRTCommandException, match="has not been saved or closed"):
            await client.rt.new()
        assert await client.rt.close() == b"Closing file"
        assert await client.rt.new() == b"Creating new connection"

    with simulator() as qtm:
        talk(qtm.port, again)


def test_only_one_client_is_master_and_only_with_the_password() -> None:
    async def both(client: Client) -> None:
        with pytest.raises(QRTCommandException, match="Wrong or missing password"):
            await client.rt.take_control("guess")
        with pytest.raises(QRTCommandException, match="You must be master"):
            await client.rt.start()
        await client.rt.take_control("secret")
        other = await qtm_rt.connect("127.0.0.1", client.rt._protocol.transport.get_extra_info("peername")[1])
        with pytest.raises(QRTCommandException, match="already master"):
            await other.take_control("secret")
        other.disconnect()
        await client.rt.release_control()

    with simulator(password="secret") as qtm:  # noqa: S106
        talk(qtm.port, both)
        assert not qtm.is_controlled


def test_commands_out_of_turn_are_refused_in_qtms_words_and_any_password_does_where_none_is_required() -> None:
    async def ask(client: Client) -> None:
        assert await client.rt.take_control("any") == b"You are now master"
        for command, words in [
            (lambda: client.rt.take_control("any"), "You are already master"),
            (client.rt.start, "Not connected"),
            (client.rt.stop, "No measurement is running"),
            (lambda: client.rt.save("x"), "No measurement to save"),
            (client.rt.set_qtm_event, "QTM is not capturing"),
            (client.rt.trig, "Parse error"),
        ]:
            with pytest.raises(QRTCommandException, match=words):
                await command()

    with simulator() as qtm:
        talk(qtm.port, ask)


def test_the_eleventh_client_is_turned_away() -> None:
    with simulator() as qtm:
        clients = [socket.create_connection(("127.0.0.1", qtm.port)) for _ in range(MOST_CLIENTS)]
        for client in clients:
            client.recv(100)  # the welcome: it is counted
        eleventh = socket.create_connection(("127.0.0.1", qtm.port))
        assert b"Max number of clients reached" in eleventh.recv(100)
        for client in [*clients, eleventh]:
            client.close()


def test_a_taken_port_of_the_server_or_the_discovery_is_refused_at_the_start() -> None:
    with simulator() as qtm, pytest.raises(OSError, match=r"in use|10048"):
        QualisysSimulator(World(settings_from_dict({})), port=qtm.port).start()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        with pytest.raises(OSError) as refused:
            QtmDiscovery(22223, other.getsockname()[1]).start()
    assert refused.value.errno == errno.EADDRINUSE


def test_a_silent_server_ends_though_a_client_waits_for_its_answer() -> None:
    world = World(settings_from_dict({}))
    qtm = QualisysSimulator(world)
    qtm.start()
    world.faults.inject(fault_from_dict({"device": "qtm", "fault": "silent", "for_s": math.inf}))
    with socket.create_connection(("127.0.0.1", qtm.port)) as client:
        client.recv(100)
        client.sendall(b"\x13\0\0\0\1\0\0\0qtmversion\0")
        with pytest.raises(TimeoutError):
            client.settimeout(0.2)
            client.recv(100)
        qtm.stop()


# QTM's discovery, asked by unmodified qtm_rt and by bytes written from Qualisys's protocol document.


def test_qtm_rt_discovers_the_simulated_bench(simulated_bench: Callable[..., Bench]) -> None:
    bench = simulated_bench(ports={"discovery": 0, "ni": None, "serial": None})
    if sys.platform == "win32":
        pytest.skip("Windows documents no broadcast that comes back to 127.0.0.1; under Wine, none arrives")
    found: list[discovery.QRTDiscoveryResponse] = []

    async def discover() -> None:
        class AtOurPort(discovery.QRTDiscoveryProtocol):
            """The package's own packet, to the port of this bench in the place of 22226."""

            def connection_made(self, transport: asyncio.DatagramTransport) -> None:
                super().connection_made(transport)
                self.transport = self

            def sendto(self, packet: bytes, address: tuple[str, int]) -> None:
                assert address == ("255.255.255.255", 22226)
                given.sendto(packet, (address[0], bench.ports["discovery"]))

        given, protocol = await asyncio.get_running_loop().create_datagram_endpoint(
            lambda: AtOurPort(receiver=found.append), local_addr=("127.0.0.1", 0), allow_broadcast=True
        )
        protocol.send_discovery_packet()
        async with asyncio.timeout(scaled_timeout(10.0)):
            while not found:
                await asyncio.sleep(0.005)
        given.close()

    asyncio.run(discover())
    (answer,) = found
    assert answer.port == bench.ports["qtm"] - 1, "the base port; the little-endian server is one above it"
    host, version, cameras = answer.info.decode().split(", ", 2)
    assert (host, version[:4]) == (socket.gethostname(), "QTM ")
    assert cameras.endswith("cameras")


def test_the_answer_goes_to_the_port_that_the_packet_names_and_what_is_no_request_has_none() -> None:
    responder = QtmDiscovery(22223, 0)
    responder.start()
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asking,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listening,
    ):
        listening.bind(("127.0.0.1", 0))
        listening.settimeout(scaled_timeout(10.0))
        port = listening.getsockname()[1]
        for packet in (b"", b"\0" * 10, struct.pack("<II", 10, 1) + struct.pack(">H", port), b"\xff" * 60):
            asking.sendto(packet, ("127.0.0.1", responder.port))
        asking.sendto(struct.pack("<II", 10, 7) + struct.pack(">H", port), ("127.0.0.1", responder.port))
        packet, _ = listening.recvfrom(1000)
        assert struct.unpack_from("<II", packet) == (len(packet), 1)
        assert struct.unpack(">H", packet[-2:]) == (22222,)
        assert packet[-3] == 0 and b"QTM" in packet[8:-3]
        listening.setblocking(False)
        with pytest.raises(BlockingIOError):
            listening.recvfrom(1000)
    responder.stop()
