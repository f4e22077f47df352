"""One connection to the simulated QTM: the subscription of its client, and the frames sent.

GetParameters gives the general settings and those of 3D. Does not imitate: the settings of every other component, and
most of those two.
"""

from __future__ import annotations

import asyncio
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from xml.sax.saxutils import escape

from drivers.simulators.settings import MocapSettings

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


def parameters_xml(wanted: Sequence[str], version: str, mocap: MocapSettings, labels: Sequence[str]) -> str | None:
    """The XML of the settings that are wanted ("general", "3d", "all"); None where none of them is known."""
    names = "".join(f"<Label><Name>{escape(name)}</Name><RGBColor>65280</RGBColor></Label>" for name in labels)
    cameras = "".join(
        f"<Camera><ID>{number}</ID><Serial>{serial}</Serial></Camera>"
        for number, serial in enumerate(mocap.camera_serials, 1)
    )
    blocks = {
        "general": f"<General><Frequency>{mocap.rate_hz:g}</Frequency>{cameras}</General>",
        "3d": f"<The_3D><AxisUpwards>+Z</AxisUpwards><CalibrationTime>{escape(mocap.calibrated)}</CalibrationTime>"
        f"<Labels>{len(labels)}</Labels>{names}</The_3D>",
    }
    chosen = "".join(block for name, block in blocks.items() if name in wanted or "all" in wanted)
    return f"<QTM_Parameters_Ver_{version}>{chosen}</QTM_Parameters_Ver_{version}>" if chosen else None
