"""A discover packet of this machine is answered over UDP with the identity and the port of the simulated QTM server.

As Qualisys's RT protocol 1.25 specifies ("Discover response packet").
"""

from __future__ import annotations

import select
import socket
import struct
import sys
import threading
from contextlib import suppress
from ipaddress import ip_address

from drivers.simulators.qtm_server import COMMAND, QTM_VERSION

DISCOVER, CAMERAS, LARGEST_PACKET_BYTES = 7, 8, 65_536
REQUEST = struct.Struct("<II")  # size and type; the response port follows, big endian
PORT = struct.Struct(">H")
LOCAL, EVERYBODY = "127.0.0.1", "255.255.255.255"


class QtmDiscovery:
    """Answers in a separate thread; port 0 takes a free one. start() and stop() work once each.

    qtm_port is that of QTM's little-endian server, one above its base port.
    """

    def __init__(self, qtm_port: int, port: int) -> None:
        self.port = port
        info = f"{socket.gethostname()}, QTM {QTM_VERSION}, {CAMERAS} cameras"
        body = info.encode() + b"\0" + PORT.pack(qtm_port - 1)
        self._answer = REQUEST.pack(REQUEST.size + len(body), COMMAND) + body
        self._sockets: list[socket.socket] = []
        self._thread = threading.Thread(target=self._run, name="QTM discovery", daemon=True)
        self._is_stopped = threading.Event()

    def start(self) -> None:
        """Binds and answers; on Windows one socket also receives broadcasts. Raises OSError if the port is taken."""
        try:
            for address in (LOCAL,) if sys.platform == "win32" else (LOCAL, EVERYBODY):
                self._sockets.append(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
                self._sockets[-1].bind((address, self.port))
                self.port = self._sockets[-1].getsockname()[1]
        except OSError:
            self.stop()
            raise
        self._thread.start()

    def stop(self) -> None:
        self._is_stopped.set()
        if self._thread.is_alive():
            self._sockets[0].sendto(b"", (LOCAL, self.port))  # ends the wait for a request
            self._thread.join(timeout=5.0)
        for bound in self._sockets:
            bound.close()

    def _run(self) -> None:
        head = REQUEST.pack(REQUEST.size + PORT.size, DISCOVER)
        while not self._is_stopped.is_set():
            for bound in select.select(self._sockets, [], [], 1.0)[0]:
                with suppress(OSError):  # the port of an answer is closed already
                    packet, (host, _) = bound.recvfrom(LARGEST_PACKET_BYTES)
                    is_request = packet.startswith(head) and len(packet) == len(head) + PORT.size
                    if is_request and ip_address(host).is_loopback:
                        self._sockets[0].sendto(self._answer, (host, PORT.unpack_from(packet, len(head))[0]))
