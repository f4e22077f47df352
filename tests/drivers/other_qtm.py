"""A QTM of which a test decides every byte."""

from __future__ import annotations

import socket
import struct
import threading
from collections.abc import Callable

import numpy as np

WELCOME = b"QTM RT Interface connected\0"
PARAMETERS = (
    b"<QTM_Parameters_Ver_1.25><General><Frequency>100</Frequency></General>"
    b"<The_3D><Label><Name>a</Name></Label><Label><Name>b</Name></Label></The_3D></QTM_Parameters_Ver_1.25>\0"
)
COMMAND, XML, DATA, EVENT = 1, 2, 3, 6


class OtherQtm:
    """A server that says what the test wants; talks to one client at a time."""

    def __init__(self, answer: Callable[[bytes], bytes]) -> None:
        self._answer = answer
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        self.client: socket.socket | None = None
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def __enter__(self) -> OtherQtm:
        return self

    def __exit__(self, *_: object) -> None:
        # Wakes a thread that still waits for its client.
        socket.create_connection(("127.0.0.1", self.port)).close()
        self._listener.close()
        if self.client is not None:
            self.client.close()
        self._thread.join()

    def send(self, data: bytes) -> None:
        assert self.client is not None
        self.client.sendall(data)

    def hang_up(self) -> None:
        """After everything that was sent; commands that still come are read, so that none of it is taken back."""
        assert self.client is not None
        self.client.shutdown(socket.SHUT_WR)

    def _serve(self) -> None:
        try:
            self.client, _ = self._listener.accept()
            self.client.sendall(packet(COMMAND, WELCOME))
            while header := self.client.recv(8):
                command = self.client.recv(struct.unpack("<II", header)[0] - 8)
                self.client.sendall(self._answer(command.rstrip(b"\0")))
        except OSError:
            return


def packet(kind: int, body: bytes) -> bytes:
    return struct.pack("<II", 8 + len(body), kind) + body


def frame(number: int, *markers: tuple[float, float, float, float]) -> bytes:
    points = np.array(markers, dtype="<f4").tobytes()
    component = struct.pack("<IIIHH", 16 + len(points), 9, len(markers), 0, 0) + points
    return packet(DATA, struct.pack("<qII", number * 10_000, number, 1) + component)


def two(number: int) -> bytes:
    """A frame of a at 1 mm and b at 2 mm."""
    return frame(number, (1, 0, 0, 0.5), (2, 0, 0, 0.5))


def proper(command: bytes) -> bytes:
    """The answers of a QTM that begins to stream with frame 1."""
    answers = {
        b"version": packet(COMMAND, b"Version set to 1.25\0"),
        b"qtmversion": packet(COMMAND, b"QTM Version is 2.17 (build 3900)\0"),
        b"getparameters": packet(XML, PARAMETERS),
    }
    return answers.get(command.split()[0], two(1))
