"""Topics and message schemas, in file order. FORMAT.md is the contract; fields and topics are only ever added."""

from __future__ import annotations

import re
from typing import Any, Literal

from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorProto, FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from mcap.writer import Writer

FORMAT_VERSION = 1
PROFILE = "cuffstation"

MANIFEST = "/manifest"
STREAMS = "/streams"
FORCE = "/force"
SYNC = "/sync"
MARKERS = "/markers"
EVENTS = "/events"
LOSSES = "/losses"
OUTCOME = "/outcome"
EMG = "/emg"
EMG_SYNC = "/emg_sync"
EMG_CLOCK = "/emg_clock"
ANALOG = "/analog"

SAMPLE_TOPICS = (FORCE, SYNC, MARKERS, EMG, EMG_SYNC, EMG_CLOCK, ANALOG)
SCHEMA_OF_TOPIC = {
    MANIFEST: "cuffstation.Manifest",
    STREAMS: "cuffstation.Stream",
    FORCE: "cuffstation.ScalarBlock",
    SYNC: "cuffstation.ScalarBlock",
    MARKERS: "cuffstation.MarkerBlock",
    EVENTS: "cuffstation.Event",
    LOSSES: "cuffstation.Loss",
    OUTCOME: "cuffstation.Outcome",
    EMG: "cuffstation.AnalogBlock",
    EMG_SYNC: "cuffstation.ScalarBlock",
    EMG_CLOCK: "cuffstation.AnalogBlock",
    ANALOG: "cuffstation.AnalogBlock",
}

_CLOCKED = """
    uint32 sample_count = 1;
    fixed64 first_sample_number = 2;
    sint64 sample_number_step = 3;
    repeated fixed64 sample_numbers = 4;
    sfixed64 first_device_time_ns = 5;
    sint64 device_time_step_ns = 6;
    repeated sfixed64 device_times_ns = 7;
"""

SCHEMAS = {
    "cuffstation.Manifest": """
        uint32 format_version = 1;
        string json = 2;
    """,
    "cuffstation.Stream": """
        string name = 1;
        string unit = 2;
        repeated string labels = 3;
        double rate_hz = 4;
        string source = 5;
        string serial_number = 6;
    """,
    "cuffstation.ScalarBlock": _CLOCKED + "repeated double values = 8;",
    "cuffstation.MarkerBlock": _CLOCKED + "repeated float values = 8;",
    "cuffstation.Event": """
        string kind = 1;
        string text = 2;
        string source = 3;
    """,
    "cuffstation.Loss": """
        string stream = 1;
        string cause = 2;
        uint64 first_missing = 3;
        uint64 count = 4;
        sfixed64 last_device_time_ns = 5;
    """,
    "cuffstation.Outcome": """
        bool accepted = 1;
        string state = 2;
        string sentence = 3;
        repeated string topics = 4;
        repeated uint64 messages = 5;
        repeated string streams = 6;
        repeated uint64 samples = 7;
        repeated string codes = 8;
    """,
    "cuffstation.AnalogBlock": _CLOCKED + "repeated double values = 8;",
}
"""The fields of every message, written as in a .proto file."""
_FIXED_WIDTH = {"fixed64", "sfixed64", "double", "float"}


def register_topics(writer: Writer) -> dict[str, int]:
    """Declares every topic with its embedded schema, in file order, so that channel ids are the same in every file.

    Returns the channel id of each topic.
    """
    schema_ids = {
        name: writer.register_schema(name=name, encoding="protobuf", data=_embedded(name, fields))
        for name, fields in SCHEMAS.items()
    }
    return {
        topic: writer.register_channel(topic=topic, message_encoding="protobuf", schema_id=schema_ids[schema])
        for topic, schema in SCHEMA_OF_TOPIC.items()
    }


def wire_classes() -> dict[str, Any]:
    """A protobuf class for every schema, with packed numbers of fixed width read and written as bytes.

    On the wire a packed field of fixed-width numbers *is* a byte string of little-endian numbers, so a numpy array
    goes in and out untouched: every NaN keeps its bits, and no sample passes through a Python float.
    """
    pool = DescriptorPool()
    for name, fields in SCHEMAS.items():
        pool.AddSerializedFile(_describe(name, fields, "bytes").SerializeToString())
    return {name: GetMessageClass(pool.FindMessageTypeByName(name)) for name in SCHEMAS}


def _embedded(name: str, declared: str) -> bytes:
    return FileDescriptorSet(file=[_describe(name, declared, "repeated")]).SerializeToString()


def _describe(name: str, declared: str, packed_numbers: Literal["repeated", "bytes"]) -> FileDescriptorProto:
    package, message = name.split(".")
    file = FileDescriptorProto(name=f"{package}/{message}.proto", package=package, syntax="proto3")
    fields = file.message_type.add(name=message).field
    for repeated, kind, field, number in re.findall(r"(repeated )?(\w+) (\w+) = (\d+);", declared):
        as_bytes = packed_numbers == "bytes" and bool(repeated) and kind in _FIXED_WIDTH
        fields.add(
            name=field,
            number=int(number),
            type=FieldDescriptorProto.Type.Value("TYPE_BYTES" if as_bytes else f"TYPE_{kind.upper()}"),
            label=FieldDescriptorProto.Label.Value("LABEL_REPEATED" if repeated and not as_bytes else "LABEL_OPTIONAL"),
        )
    return file
