"""The cable between a driver and its server: it can be slow, break, and refuse."""

from __future__ import annotations

import contextlib
import socket
import struct
import threading
import time
from collections.abc import Callable
from queue import SimpleQueue


class TcpProxy:
    """A context manager; forwards connections to a port of this machine, delay_s later in either direction."""

    def __init__(self, target_port: int, delay_s: float = 0.0) -> None:
        self.target_port, self.delay_s = target_port, delay_s
        self._sockets: set[socket.socket] = set()
        self._listener: socket.socket | None = None
        self.port = 0
        self.on_data: Callable[[bytes], None] = lambda data: None
        """Called with what the server sends, before it is forwarded; for breaking the link at a chosen byte."""

    def __enter__(self) -> TcpProxy:
        self.listen()
        return self

    def __exit__(self, *_: object) -> None:
        self.refuse()

    def listen(self) -> None:
        self._listener = socket.create_server(("127.0.0.1", self.port))
        self.port = self._listener.getsockname()[1]
        threading.Thread(target=self._accept, args=(self._listener,), daemon=True).start()

    def refuse(self) -> None:
        """Resets every connection and takes no new one until listen()."""
        if self._listener is not None:
            with contextlib.suppress(OSError):
                self._listener.shutdown(socket.SHUT_RDWR)  # wakes the thread that accepts
            self._listener.close()
            self._listener = None
        self.reset()

    def reset(self) -> None:
        """Resets every connection, as a switch that loses its power does; new ones are taken at once."""
        for one in list(self._sockets):
            self._drop(one)

    def _accept(self, listener: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while True:
                client, _ = listener.accept()
                server = socket.create_connection(("127.0.0.1", self.target_port))
                for one in (client, server):
                    one.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                self._sockets |= {client, server}
                self._pump(client, server, lambda _: None)
                self._pump(server, client, self._look)

    def _look(self, data: bytes) -> None:
        self.on_data(data)

    def _pump(self, source: socket.socket, sink: socket.socket, look: Callable[[bytes], None]) -> None:
        waiting: SimpleQueue[tuple[float, bytes]] = SimpleQueue()

        def receive() -> None:
            data = b"-"
            while data:
                try:
                    data = source.recv(65536)
                except OSError:
                    data = b""
                waiting.put((time.perf_counter() + self.delay_s, data))

        def send() -> None:
            while True:
                due_s, data = waiting.get()
                time.sleep(max(0.0, due_s - time.perf_counter()))
                look(data)
                try:
                    if not data:
                        return sink.shutdown(socket.SHUT_WR)
                    sink.sendall(data)
                except OSError:
                    return None

        for work in (receive, send):
            threading.Thread(target=work, daemon=True).start()

    def _drop(self, one: socket.socket) -> None:
        self._sockets.discard(one)
        with contextlib.suppress(OSError):
            one.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            one.shutdown(socket.SHUT_RDWR)
        one.close()
