"""Every bit that goes in comes out, and forged bytes come to nothing."""

import re
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_protobuf.decoder import DecoderFactory

import recordings
from recordings import topics
from recordings.errors import RecordingCode, RecordingError
from recordings.packing import pack, unpack
from recordings.samples import Event, Loss, Samples, Stream
from recordings.topics import wire_classes
from tests.recordings.trials import ACCEPTED, MANIFEST, START_NS, frames, record, scalars, skipped, trial
from tests.refusals import raises_refusal

TEXT = st.text()
INT64 = st.integers(-(2**63), 2**63 - 1)
UINT64 = st.integers(0, 2**64 - 1)
FIELD = re.compile(r"((?:repeated )?\w+ \w+ = \d+);")


@st.composite
def clocks(draw: st.DrawFn, count: int, kind: type) -> np.ndarray:
    """Numbers or times of a block: a run from anywhere with any step, or any numbers at all."""
    if draw(st.booleans()):
        first, step = draw(UINT64), draw(UINT64)
        return (np.arange(count, dtype=np.uint64) * np.uint64(step) + np.uint64(first)).view(kind)
    return draw(hnp.arrays(kind, count))


@st.composite
def blocks(draw: st.DrawFn) -> Samples:
    topic = draw(st.sampled_from(topics.SAMPLE_TOPICS))
    count = draw(st.integers(1, 12))
    if topic == topics.MARKERS:
        # Bits rather than numbers: every NaN that a camera system may send must come back as it was.
        patterns = draw(hnp.arrays(np.uint32, (count, draw(st.integers(0, 5)), 4)))
        values = patterns.view(np.float32)
    else:
        columns = draw(st.integers(0, 5)) if topics.SCHEMA_OF_TOPIC[topic] == "cuffstation.AnalogBlock" else 1
        values = draw(hnp.arrays(np.uint64, (count, columns))).view(np.float64)
    numbers, times = draw(clocks(count, np.uint64)), draw(clocks(count, np.int64))
    return Samples(topic, numbers, times, draw(st.integers(0, 2**63)), values)


@given(blocks())
def test_a_block_comes_back_bit_for_bit(block: Samples) -> None:
    topic, data = pack(block)
    back = unpack(topic, block.host_time_ns, data)
    assert isinstance(back, Samples)
    assert (back.stream, back.host_time_ns) == (block.stream, block.host_time_ns)
    for found, expected in (
        (back.sample_numbers, block.sample_numbers),
        (back.device_time_ns, block.device_time_ns),
        (back.values, block.values),
    ):
        assert found.dtype == expected.dtype
        assert found.shape == expected.shape
        assert found.tobytes() == expected.tobytes()
        assert not found.flags.writeable


@settings(max_examples=40)
@given(
    st.one_of(
        st.builds(Event, TEXT, TEXT, UINT64, TEXT),
        st.builds(Loss, TEXT, TEXT, UINT64, UINT64, INT64, UINT64),
        st.builds(Stream, TEXT, TEXT, st.lists(TEXT).map(tuple), st.floats(allow_nan=False), TEXT, TEXT),
        st.just(MANIFEST),
        st.just(ACCEPTED),
    )
)
def test_every_other_message_comes_back_equal(message: Event | Loss | Stream) -> None:
    topic, data = pack(message)
    assert unpack(topic, getattr(message, "host_time_ns", 0), data) == message


def test_a_steady_block_costs_a_few_bytes_beside_its_values() -> None:
    block = scalars("/force", 5000, 100)
    assert len(pack(block)[1]) < block.values.nbytes + 40


def test_values_that_would_lose_bits_and_arrays_of_unequal_length_are_refused() -> None:
    block = frames(0, 3)
    for times_ns, values in (
        (block.device_time_ns, block.values.astype(np.float64)),
        (block.device_time_ns[1:], block.values),
    ):
        with raises_refusal(RecordingCode.WRONG_BLOCK):
            pack(Samples("/markers", block.sample_numbers, times_ns, 0, values))


@pytest.mark.parametrize(
    "fields",
    [
        {"sample_count": 2**32 - 1, "values": b""},
        {"sample_count": 0, "values": bytes(8)},
        {"sample_count": 3, "values": bytes(16)},
        {"sample_count": 2, "values": bytes(16), "sample_numbers": bytes(8)},
        {"sample_count": 1, "values": bytes(8), "device_times_ns": bytes(9)},
    ],
)
def test_a_forged_block_is_refused_before_anything_is_allocated(fields: dict[str, object]) -> None:
    data = wire_classes()["cuffstation.ScalarBlock"](**fields).SerializeToString()
    with raises_refusal(RecordingCode.WRONG_BLOCK):
        unpack("/force", 0, data)


@given(st.sampled_from(list(topics.SCHEMA_OF_TOPIC)), st.binary(max_size=200))
def test_any_other_bytes_are_refused_or_mean_something(topic: str, data: bytes) -> None:
    try:
        unpack(topic, 0, data)
    except RecordingError as error:
        assert str(error)


def test_a_newer_format_is_refused_with_the_way_out() -> None:
    data = wire_classes()["cuffstation.Manifest"](format_version=2, json="{}").SerializeToString()
    with raises_refusal(RecordingCode.LATER_FORMAT):
        unpack("/manifest", 0, data)


@pytest.mark.parametrize(
    "message",
    [
        Event("note", "a folder's name \udcff", START_NS, "station"),
        Loss("/markers", "skipped", 3, 1, 2**70, START_NS),
        Loss("/markers", "skipped", 3, -1, 0, START_NS),
    ],
    ids=["text that is none", "time out of range", "negative count"],
)
def test_what_cannot_be_kept_as_it_is_is_refused_in_a_sentence(message: Event | Loss) -> None:
    with raises_refusal(RecordingCode.MESSAGE_NOT_KEPT):
        pack(message)


def test_the_page_states_the_fields_that_the_code_writes_and_the_topics_in_file_order() -> None:
    page = (Path(recordings.__file__).parent / "FORMAT.md").read_text(encoding="utf-8")
    on_page = dict(re.findall(r"message (\w+) \{(.*?)\n\}", page, re.DOTALL))
    assert {name: FIELD.findall(text) for name, text in on_page.items()} == {
        name.removeprefix("cuffstation."): FIELD.findall(text) for name, text in topics.SCHEMAS.items()
    }
    page = (Path(recordings.__file__).parent / "FORMAT.md").read_text(encoding="utf-8")
    rows = re.findall(r"\| (\d+) \| `(/\w+)` \| `([\w.]+)` \|", page)
    expected = [(str(i), topic, schema) for i, (topic, schema) in enumerate(topics.SCHEMA_OF_TOPIC.items(), start=1)]
    assert rows == expected


def test_channel_ids_follow_the_file_order() -> None:
    writer = Writer(BytesIO())
    writer.start()
    assert list(topics.register_topics(writer).items()) == [(t, i) for i, t in enumerate(topics.SCHEMA_OF_TOPIC, 1)]


def test_a_program_that_never_heard_of_us_reads_every_number(tmp_path: Path) -> None:
    block = frames(3, 5)
    path = record(tmp_path / "a.mcap", [*trial(0.3), block, skipped(8, 2), scalars("/force", 900, 7)])
    with path.open("rb") as file:
        decoded = list(
            make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages(log_time_order=False)
        )
    last_markers = [message for _, channel, _, message in decoded if channel.topic == "/markers"][-1]
    np.testing.assert_array_equal(np.array(last_markers.values, np.float32).reshape(5, 4, 4), block.values)
    assert last_markers.first_sample_number == 3
    assert last_markers.device_time_step_ns == 10_000_000
    last_force = [message for _, channel, _, message in decoded if channel.topic == "/force"][-1]
    assert list(last_force.values) == scalars("/force", 900, 7).values[:, 0].tolist()
    assert decoded[-1][3].sentence == "the mocap capture ended"
