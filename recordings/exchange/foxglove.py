"""A trial as MCAP in schemas that other programs know: Foxglove and Rerun's own loader draw points and curves of it.

    /force      std_msgs/msg/Float64MultiArray (ROS 2, CDR)   one sample a message, in newtons
    /markers    foxglove.PointCloud (protobuf)                the markers that are seen, in metres
    /tf         foxglove.FrameTransforms (protobuf)           the same by name: a frame for each, in the laboratory's
    /events     foxglove.Log (protobuf)                       what happened

Foxglove has no schema of its own for a curve; the ROS message is the one that both programs draw. A message is stamped
with the UTC of its sample, and a chunk spans CHUNK_S at most, so that a program which follows the file is no later.
"""

from __future__ import annotations

import heapq
import struct
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from mcap.writer import CompressionType, Writer
from mcap_protobuf.schema import build_file_descriptor_set
from numpy.typing import NDArray

from recordings.exchange.sample_tables import MarkerTable
from recordings.samples import Event

CHUNK_S = 0.1
LABORATORY = "laboratory"
METRES_A_MM = 1e-3
FLOAT64_ARRAY = "std_msgs/msg/Float64MultiArray"
RULE = "=" * 80
FLOAT64_ARRAY_DEFINITION = f"""MultiArrayLayout layout
float64[] data
{RULE}
MSG: std_msgs/MultiArrayLayout
MultiArrayDimension[] dim
uint32 data_offset
{RULE}
MSG: std_msgs/MultiArrayDimension
string label
uint32 size
uint32 stride
"""
_CDR = bytes([0, 1, 0, 0])  # little endian
_ONE_NUMBER = struct.Struct("<III4xd")  # no dimensions, no offset, one number, aligned to its size
_WHERE = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4")])

Messages = Iterator[tuple[int, int, bytes]]
"""Time [UTC, ns], channel, content; in the order of time."""


@dataclass(frozen=True)
class Curve:
    """time (n,) s from the trial's zero, values (n,)."""

    time: NDArray[np.float64]
    values: NDArray[np.float64]


def write_foxglove(
    path: Path,
    zero_utc_ns: int,
    curves: Mapping[str, Curve],
    markers: MarkerTable,
    events: Iterable[Event],
    notes: Mapping[str, str],
) -> None:
    """curves by topic; times of curves and markers count from zero_utc_ns; notes go into the file's metadata.

    Raises OSError.
    """
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        writer.start()
        writer.add_metadata("cuffstation", dict(notes))
        array = writer.register_schema(FLOAT64_ARRAY, "ros2msg", FLOAT64_ARRAY_DEFINITION.encode())
        messages = [
            _samples(writer.register_channel(topic, "cdr", array), zero_utc_ns, curve)
            for topic, curve in curves.items()
        ]
        messages.append(_points(_channel(writer, "/markers", PointCloud), zero_utc_ns, markers))
        messages.append(_frames(_channel(writer, "/tf", FrameTransforms), zero_utc_ns, markers))
        messages.append(_log(_channel(writer, "/events", Log), events))
        _write(writer, heapq.merge(*messages))
        writer.finish()  # type: ignore[no-untyped-call]


def _channel(writer: Writer, topic: str, message: Any) -> int:
    schema = build_file_descriptor_set(message).SerializeToString()
    return writer.register_channel(
        topic, "protobuf", writer.register_schema(message.DESCRIPTOR.full_name, "protobuf", schema)
    )


def _write(writer: Writer, messages: Messages) -> None:
    chunk_until_ns = None
    for time_ns, channel, content in messages:
        if chunk_until_ns is None or time_ns >= chunk_until_ns:
            if chunk_until_ns is not None:
                writer.flush()  # type: ignore[no-untyped-call]
            chunk_until_ns = time_ns + round(CHUNK_S * 1e9)
        writer.add_message(channel, log_time=time_ns, data=content, publish_time=time_ns)


def _samples(channel: int, zero_utc_ns: int, curve: Curve) -> Messages:
    times_ns = zero_utc_ns + np.rint(1e9 * curve.time).astype(np.int64)
    for time_ns, value in zip(times_ns.tolist(), curve.values.tolist(), strict=True):
        yield time_ns, channel, _CDR + _ONE_NUMBER.pack(0, 0, 1, value)


def _points(channel: int, zero_utc_ns: int, markers: MarkerTable) -> Messages:
    for time_ns, points, seen in _seen(zero_utc_ns, markers):
        cloud = PointCloud(frame_id=LABORATORY, point_stride=_WHERE.itemsize, data=points[seen].astype("<f4").tobytes())
        cloud.timestamp.FromNanoseconds(time_ns)
        cloud.pose.orientation.w = 1.0
        for axis in "xyz":
            offset = _WHERE.fields[axis][1]  # type: ignore[index]
            cloud.fields.add(name=axis, offset=offset, type=PackedElementField.FLOAT32)
        yield time_ns, channel, cloud.SerializeToString()


def _frames(channel: int, zero_utc_ns: int, markers: MarkerTable) -> Messages:
    for time_ns, points, seen in _seen(zero_utc_ns, markers):
        transforms = FrameTransforms()
        for number in np.flatnonzero(seen):
            one = transforms.transforms.add(parent_frame_id=LABORATORY, child_frame_id=markers.labels[number])
            one.timestamp.FromNanoseconds(time_ns)
            one.translation.x, one.translation.y, one.translation.z = points[number].tolist()
            one.rotation.w = 1.0
        yield time_ns, channel, transforms.SerializeToString()


def _seen(zero_utc_ns: int, markers: MarkerTable) -> Iterator[tuple[int, NDArray[np.float64], NDArray[np.bool_]]]:
    """Of each frame its time, its points (labels, 3) in metres, and which of them are seen (labels,)."""
    times_ns = zero_utc_ns + np.rint(1e9 * markers.time_s).astype(np.int64)
    metres = METRES_A_MM * markers.positions
    seen = np.isfinite(metres[..., 0])
    for frame, time_ns in enumerate(times_ns.tolist()):
        yield time_ns, metres[frame], seen[frame]


def _log(channel: int, events: Iterable[Event]) -> Messages:
    for event in sorted(events, key=lambda event: event.host_time_ns):
        message = Log(level=Log.INFO, message=event.text, name=event.source)
        message.timestamp.FromNanoseconds(event.host_time_ns)
        yield event.host_time_ns, channel, message.SerializeToString()
