"""QTM's auto discovery: answers a discover packet over UDP with the identity and the port of the server.

The packets are those of Qualisys's RT protocol, "Discover packet" and "Discover response packet". Only a sender on this
machine is answered.

Does not imitate: answers to other computers, more than one QTM.
"""

from __future__ import annotations

import selectors
import socket
import struct
import sys
import threading
from contextlib import suppress
from ipaddress import ip_address

QTM_VERSION = "2024.3 (build 17700), simulated"
CAMERAS = 8
COMMAND, DISCOVER = 1, 7
REQUEST = struct.Struct("<II")  # size and type; the response port follows, big endian
PORT = struct.Struct(">H")
LONGEST_REQUEST_BYTES = 64
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
        self._wake, self._woken = socket.socketpair()
        self._thread = threading.Thread(target=self._run, name="QTM discovery", daemon=True)

    def start(self) -> None:
        """Binds and answers. Raises OSError if the port is taken."""
        try:
            self._bind(LOCAL)
            if sys.platform != "win32":  # there a socket bound to an address also receives broadcasts
                self._bind(EVERYBODY)
        except OSError:
            self._close()
            raise
        self._thread.start()

    def stop(self) -> None:
        self._wake.send(b"\0")
        self._thread.join()
        self._close()

    def _bind(self, address: str) -> None:
        server = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._sockets.append(server)
        server.bind((address, self.port))
        self.port = server.getsockname()[1]

    def _close(self) -> None:
        for one in (*self._sockets, self._wake, self._woken):
            one.close()

    def _run(self) -> None:
        with selectors.DefaultSelector() as ready:
            for server in (*self._sockets, self._woken):
                ready.register(server, selectors.EVENT_READ)
            while True:
                for key, _ in ready.select():
                    if key.fileobj is self._woken:
                        return
                    with suppress(OSError):  # the closed port of an earlier answer
                        self._receive(*key.fileobj.recvfrom(LONGEST_REQUEST_BYTES))  # type: ignore[union-attr]

    def _receive(self, packet: bytes, sender: tuple[str, int]) -> None:
        if len(packet) != REQUEST.size + PORT.size or not ip_address(sender[0]).is_loopback:
            return
        if REQUEST.unpack_from(packet) == (len(packet), DISCOVER):
            (port,) = PORT.unpack_from(packet, REQUEST.size)
            self._sockets[0].sendto(self._answer, (sender[0], port))
