"""Messages from the recorder to the live process: the request, then those of a recording.

A header (kind, host time [ns], arrival at the recorder [s, monotonic clock]) and the content, JSON for the request.
Both ends are of the same installation, so the layout has no version.
"""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass
from typing import Any

from pydantic import TypeAdapter

from recordings import topics
from recordings.packing import Message, pack, unpack
from station.protocol import TrialSpec

HEADER = struct.Struct("<Bqd")
TOPICS = tuple(topics.SCHEMA_OF_TOPIC)
REQUEST_KIND = 255


@dataclass(frozen=True)
class FedMessage:
    """A message of the recorder, passed on at arrival_s of the monotonic clock, which all processes share."""

    content: Message | dict[str, Any]
    arrival_s: float


def encode_message(message: Message, host_time_ns: int, arrival_s: float) -> bytes:
    topic, data = pack(message)
    return HEADER.pack(TOPICS.index(topic), host_time_ns, arrival_s) + data


def encode_request(request: dict[str, Any]) -> bytes:
    return HEADER.pack(REQUEST_KIND, 0, 0.0) + json.dumps(request).encode()


def decode(data: bytes) -> FedMessage:
    kind, host_time_ns, arrival_s = HEADER.unpack_from(data)
    content = data[HEADER.size :]
    return FedMessage(
        json.loads(content) if kind == REQUEST_KIND else unpack(TOPICS[kind], host_time_ns, content), arrival_s
    )


@dataclass(frozen=True)
class LiveRequest:
    """config as in station.toml; before_utc_ns: only trials that began earlier give the body of the wearer."""

    config: dict[str, Any]
    folder: str
    spec: TrialSpec
    before_utc_ns: int


REQUEST = TypeAdapter(LiveRequest)
