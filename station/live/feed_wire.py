"""Frames of the pipe from the recorder to the live process: messages as in a recording, and requests as JSON.

A frame is a header (kind, host time [ns], arrival at the recorder [s, monotonic clock], length) and its bytes. Both
ends are of the same installation, so the layout has no version.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, BinaryIO

from recordings import topics
from recordings.packing import Message, pack, unpack

HEADER = struct.Struct("<BqdI")
TOPICS = tuple(topics.SCHEMA_OF_TOPIC)
REQUEST = 255


@dataclass(frozen=True)
class FedMessage:
    """A message of the recorder, passed on at arrival_s of the monotonic clock, which all processes share."""

    content: Message | dict[str, Any]
    arrival_s: float


def encode_message(message: Message, host_time_ns: int, arrival_s: float) -> bytes:
    topic, data = pack(message)
    return HEADER.pack(TOPICS.index(topic), host_time_ns, arrival_s, len(data)) + data


def encode_request(request: dict[str, Any]) -> bytes:
    data = json.dumps(request).encode()
    return HEADER.pack(REQUEST, 0, 0.0, len(data)) + data


def read_messages(stream: BinaryIO) -> Iterator[FedMessage]:
    """Until the end of the stream; a frame that was cut is left out."""
    while len(header := stream.read(HEADER.size)) == HEADER.size:
        kind, host_time_ns, arrival_s, length = HEADER.unpack(header)
        data = stream.read(length)
        if len(data) < length:
            return
        content = json.loads(data) if kind == REQUEST else unpack(TOPICS[kind], host_time_ns, data)
        yield FedMessage(content, arrival_s)
