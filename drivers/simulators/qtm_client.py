"""One connection to the simulated QTM: the subscription of its client, and the frames sent."""

from __future__ import annotations

import asyncio
import struct
from dataclasses import dataclass

MOST_UNSENT_BYTES = 1_000_000  # a client that is further behind slows the world down


@dataclass(frozen=True)
class FrameSubscription:
    """Subscription of a client: every divisor-th frame of one component."""

    component: str
    divisor: int


class Client:
    """One connection."""

    def __init__(self, writer: asyncio.StreamWriter) -> None:
        self.stream: FrameSubscription | None = None
        self.port = int(writer.get_extra_info("peername")[1])
        self.sent = 0  # bytes
        self.is_closed = False
        self.awaits_frame = False
        self._writer = writer

    @property
    def is_behind(self) -> bool:
        return self._writer.transport.get_write_buffer_size() > MOST_UNSENT_BYTES

    def send(self, kind: int, body: bytes = b"") -> None:
        self.send_bytes(struct.pack("<II", 8 + len(body), kind) + body)

    def send_text(self, kind: int, text: str) -> None:
        self.send(kind, text.encode() + b"\0")

    def send_bytes(self, packets: bytes) -> None:
        self.sent += len(packets)
        self._writer.write(packets)

    def close(self) -> None:
        self.is_closed = True
        self._writer.transport.abort()
