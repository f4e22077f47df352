"""Messages ⇄ bytes, bit for bit. The host's time is the log time of a message and in no other field."""

from __future__ import annotations

from typing import Any

import numpy as np
from google.protobuf.message import DecodeError
from numpy.typing import NDArray

from documents.interval import counted
from recordings import topics
from recordings.errors import RecordingCode, RecordingError
from recordings.manifest import Manifest, TrialOutcome, manifest_from_json, manifest_to_json
from recordings.samples import Event, Item, Loss, Samples, Stream

Message = Manifest | Stream | Item | TrialOutcome

MOST_SAMPLES_IN_A_BLOCK = 1_000_000
MOST_SAMPLES_WITHOUT_VALUES = 1_000
"""In a block of no columns, whose bytes do not grow with their number."""
MOST_LABELS = 4096
LARGEST_MANIFEST = 4 * 2**20
"""Characters of its JSON."""
_CLASSES = topics.wire_classes()
_UNSIGNED, _SIGNED = np.dtype("<u8"), np.dtype("<i8")


def pack(message: Message) -> tuple[str, bytes]:
    """The topic of a message, and its bytes. Raises RecordingError for one that cannot be kept as it is."""
    match message:
        case Samples():
            topic, fields = message.stream, _fields_of_block(message)
        case Stream():
            topic, fields = topics.STREAMS, vars(message)
        case Event() | Loss():
            topic = topics.EVENTS if isinstance(message, Event) else topics.LOSSES
            fields = {name: value for name, value in vars(message).items() if name != "host_time_ns"}
        case Manifest():
            topic = topics.MANIFEST
            fields = {"format_version": topics.FORMAT_VERSION, "json": manifest_to_json(message)}
        case TrialOutcome():
            topic, fields = topics.OUTCOME, _fields_of_outcome(message)
    try:
        data: bytes = _CLASSES[topics.SCHEMA_OF_TOPIC[topic]](**fields).SerializeToString()
    except ValueError as error:  # a number out of its range, or a text that is none
        raise RecordingError(
            f"a message on {topic} cannot be kept as it is: {error}", RecordingCode.MESSAGE_NOT_KEPT
        ) from error
    return topic, data


def unpack(topic: str, host_time_ns: int, data: bytes) -> Message:
    """The message back, its arrays read-only. Raises RecordingError for other bytes or a newer format."""
    schema = topics.SCHEMA_OF_TOPIC[topic]
    try:
        wire = _CLASSES[schema].FromString(data)
    except DecodeError as error:
        raise RecordingError(
            f"a message of {len(data)} bytes on {topic} is not a {schema}: {error}", RecordingCode.WRONG_MESSAGE
        ) from error
    if topic in topics.SAMPLE_TOPICS:
        return _block(topic, host_time_ns, wire)
    fields = {field.name: getattr(wire, field.name) for field in wire.DESCRIPTOR.fields}
    match topic:
        case topics.STREAMS:
            if len(wire.labels) > MOST_LABELS:
                raise RecordingError(
                    f"a stream is described with {len(wire.labels)} labels, expected at most {MOST_LABELS}",
                    RecordingCode.TOO_LARGE,
                )
            return Stream(**fields | {"labels": tuple(wire.labels)})
        case topics.EVENTS:
            return Event(host_time_ns=host_time_ns, **fields)
        case topics.LOSSES:
            return Loss(host_time_ns=host_time_ns, **fields)
        case topics.OUTCOME:
            return _outcome(wire)
    return _manifest(wire)


def values_type(topic: str) -> np.dtype[Any]:
    """The one type a topic's values have in memory and in the file."""
    return np.dtype(np.float32 if topic == topics.MARKERS else np.float64)


def no_values(topic: str, columns: int) -> NDArray[Any]:
    """The values of no sample at all, with the type and shape that the values of a topic have."""
    return np.zeros((0, columns, 4) if topic == topics.MARKERS else (0, columns), values_type(topic))


def _fields_of_block(block: Samples) -> dict[str, Any]:
    count, kind = len(block.sample_numbers), values_type(block.stream)
    if block.values.dtype != kind:
        raise RecordingError(
            f"a block of {block.stream} holds {block.values.dtype} values, expected {kind}", RecordingCode.WRONG_BLOCK
        )
    if not (0 < count <= MOST_SAMPLES_IN_A_BLOCK and count == len(block.device_time_ns) == len(block.values)):
        raise RecordingError(
            f"a block of {block.stream} holds {count} sample numbers, {len(block.device_time_ns)} device times and "
            f"{len(block.values)} values, expected as many of each, at least 1 and at most {MOST_SAMPLES_IN_A_BLOCK}",
            RecordingCode.WRONG_BLOCK,
        )
    first_number, number_step, numbers = _compact(block.sample_numbers.astype(_UNSIGNED, copy=False))
    first_time, time_step, times = _compact(block.device_time_ns.astype(_SIGNED, copy=False))
    return {
        "sample_count": count,
        "first_sample_number": first_number,
        "sample_number_step": number_step,
        "sample_numbers": numbers,
        "first_device_time_ns": first_time,
        "device_time_step_ns": time_step,
        "device_times_ns": times,
        "values": block.values.astype(kind.newbyteorder("<"), copy=False).tobytes(),
    }


def _block(topic: str, host_time_ns: int, wire: Any) -> Samples:
    count, kind, width = wire.sample_count, values_type(topic), 4 if topic == topics.MARKERS else 1
    # A forged count must neither allocate memory nor move values from one sample to the next.
    if not 0 < count <= MOST_SAMPLES_IN_A_BLOCK or len(wire.values) % (count * width * kind.itemsize):
        raise RecordingError(
            f"a block of {topic} announces {counted(count, 'sample')} and holds {counted(len(wire.values), 'byte')}",
            RecordingCode.WRONG_BLOCK,
        )
    columns = len(wire.values) // (count * width * kind.itemsize)
    if not columns and count > MOST_SAMPLES_WITHOUT_VALUES:
        raise RecordingError(
            f"a block of {topic} announces {counted(count, 'sample')} without a value", RecordingCode.WRONG_BLOCK
        )
    values = np.frombuffer(wire.values, dtype=kind.newbyteorder("<"))
    numbers = wire.first_sample_number, wire.sample_number_step, wire.sample_numbers
    times = wire.first_device_time_ns, wire.device_time_step_ns, wire.device_times_ns
    return Samples(
        stream=topic,
        sample_numbers=_spread(*numbers, _UNSIGNED, count),
        device_time_ns=_spread(*times, _SIGNED, count),
        host_time_ns=host_time_ns,
        values=values.reshape((count, columns, width) if topic == topics.MARKERS else (count, columns)),
    )


def _compact(numbers: NDArray[Any]) -> tuple[int, int, bytes]:
    """(first, step, b"") of an arithmetic run, (0, 0, every number) of any other; exact modulo 2^64."""
    steps = numbers[1:] - numbers[:-1]
    if steps.tobytes() == steps[:1].tobytes() * len(steps):
        return int(numbers[0]), int(steps[0].astype(np.int64)) if len(steps) else 0, b""
    return 0, 0, numbers.tobytes()


def _spread(first: int, step: int, numbers: bytes, kind: np.dtype[Any], count: int) -> NDArray[Any]:
    if numbers:
        if len(numbers) != 8 * count:
            raise RecordingError(
                f"a block announces {counted(count, 'sample')} and has {counted(len(numbers), 'byte')} "
                "of numbers for them",
                RecordingCode.WRONG_BLOCK,
            )
        return np.frombuffer(numbers, dtype=kind)
    end = first + step * count
    if 0 <= first < end <= 2**63:
        run = np.arange(first, end, step, dtype=kind)
    else:  # modulo 2^64
        run = (np.arange(count, dtype=np.uint64) * np.uint64(step % 2**64) + np.uint64(first % 2**64)).view(kind)
    run.flags.writeable = False
    return run


def _manifest(wire: Any) -> Manifest:
    if wire.format_version > topics.FORMAT_VERSION:
        raise RecordingError(
            f"the recording has format version {wire.format_version}, expected at most {topics.FORMAT_VERSION}; "
            "update cuffstation to read it",
            RecordingCode.LATER_FORMAT,
        )
    if len(wire.json) > LARGEST_MANIFEST:
        raise RecordingError(
            f"the manifest has {len(wire.json)} characters, expected at most {LARGEST_MANIFEST}", RecordingCode.MANIFEST
        )
    return manifest_from_json(wire.json)


def _fields_of_outcome(outcome: TrialOutcome) -> dict[str, Any]:
    return vars(outcome) | {
        "topics": list(outcome.messages),
        "messages": list(outcome.messages.values()),
        "streams": list(outcome.samples),
        "samples": list(outcome.samples.values()),
    }


def _outcome(wire: Any) -> TrialOutcome:
    return TrialOutcome(
        accepted=wire.accepted,
        state=wire.state,
        sentence=wire.sentence,
        messages=dict(zip(wire.topics, wire.messages, strict=False)),
        samples=dict(zip(wire.streams, wire.samples, strict=False)),
        codes=tuple(wire.codes),
    )
