"""The schemas in the code, in the file and on the page are the same."""

from __future__ import annotations

import re
from io import BytesIO
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_protobuf.decoder import DecoderFactory

import recordings
from recordings import live_result, topics
from tests.recordings.trials import frames, record, scalars, skipped, trial

FIELD = re.compile(r"((?:repeated )?\w+ \w+ = \d+);")


def test_the_page_states_the_fields_that_the_code_writes() -> None:
    page = (Path(recordings.__file__).parent / "FORMAT.md").read_text(encoding="utf-8")
    on_page = dict(re.findall(r"message (\w+) \{(.*?)\n\}", page, re.DOTALL))
    assert {name: FIELD.findall(text) for name, text in on_page.items()} == {
        name.removeprefix("cuffstation."): FIELD.findall(text)
        for name, text in (topics.SCHEMAS | live_result.LIVE_SCHEMAS).items()
    }


def test_the_page_states_the_topics_in_file_order() -> None:
    page = (Path(recordings.__file__).parent / "FORMAT.md").read_text(encoding="utf-8")
    rows = re.findall(r"\| (\d+) \| `(/\w+)` \| `([\w.]+)` \|", page)
    expected = [
        (str(i), topic, schema)
        for schemas in (topics.SCHEMA_OF_TOPIC, live_result.SCHEMA_OF_TOPIC)
        for i, (topic, schema) in enumerate(schemas.items(), start=1)
    ]
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
