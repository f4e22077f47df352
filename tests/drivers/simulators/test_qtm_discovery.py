"""QTM's discovery, asked by unmodified qtm_rt and by bytes written from Qualisys's protocol document."""

from __future__ import annotations

import asyncio
import errno
import socket
import struct
import sys
from collections.abc import Callable

import pytest
from qtm_rt import discovery

from drivers.simulators.qtm_discovery import QtmDiscovery
from drivers.simulators.simulated_bench import Bench
from tests.timeout import scaled_timeout


def test_qtm_rt_discovers_the_simulated_bench(
    simulated_bench: Callable[..., Bench],
) -> None:
    bench = simulated_bench(ports={"discovery": 0, "ni": None, "serial": None})
    if sys.platform == "win32":
        pytest.skip("whether a broadcast from 127.0.0.1 comes back is the network's affair there")
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


def test_a_port_that_is_taken_is_refused() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        with pytest.raises(OSError) as refused:
            QtmDiscovery(22223, other.getsockname()[1]).start()
    assert refused.value.errno == errno.EADDRINUSE
