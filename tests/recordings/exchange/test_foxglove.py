"""The export for Foxglove, read by the mcap package with Foxglove's own classes, and by Rerun's own loader."""

import re
import struct
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from foxglove_schemas_protobuf import FrameTransforms_pb2, Log_pb2, PointCloud_pb2
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from recordings.exchange.foxglove import CHUNK_S, Curve, write_foxglove
from recordings.exchange.sample_tables import MarkerTable
from recordings.samples import Event

ZERO_NS = 1_750_000_000_123_456_789
FORCE = Curve(-0.5 + np.arange(2000) / 1000, np.linspace(-3.0, 40.0, 2000))
RNG = np.random.default_rng(5)


@pytest.fixture(scope="module")
def markers() -> MarkerTable:
    positions = RNG.normal(0.0, 500.0, (150, 3, 3))
    positions[40:60, 1] = np.nan
    return MarkerTable(("cuff_1", "rope_1", "rope_2"), 100.0, np.arange(150) / 100, positions, np.zeros((150, 3)))


@pytest.fixture(scope="module")
def path(markers: MarkerTable, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("foxglove") / "trial.mcap"
    events = [Event("sync_edge", "the sync line rose", ZERO_NS, "station")]
    write_foxglove(path, ZERO_NS, {"/force": FORCE}, markers, events, {"station": "{}"})
    return path


def messages(path: Path, topic: str) -> list[tuple[int, object]]:
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        return [(message.log_time, content) for _, _, message, content in reader.iter_decoded_messages(topics=[topic])]


def test_the_schemas_are_foxglove_s_own_to_the_field(path: Path) -> None:
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    schemas = {schema.name: schema for schema in summary.schemas.values()}
    for module in (PointCloud_pb2.PointCloud, FrameTransforms_pb2.FrameTransforms, Log_pb2.Log):
        descriptor = module.DESCRIPTOR
        schema = schemas[descriptor.full_name]
        assert schema.encoding == "protobuf"
        files = {file.name: file for file in FileDescriptorSet.FromString(schema.data).file}
        ours = next(one for one in files[descriptor.file.name].message_type if one.name == descriptor.name)
        assert [(one.number, one.name) for one in ours.field] == [(one.number, one.name) for one in descriptor.fields]
    assert schemas["std_msgs/msg/Float64MultiArray"].encoding == "ros2msg"


def test_every_frame_is_a_cloud_of_the_markers_that_are_seen_in_metres(path: Path, markers: MarkerTable) -> None:
    clouds = messages(path, "/markers")
    assert [time for time, _ in clouds] == [ZERO_NS + round(1e9 * t) for t in markers.time_s]
    for frame in (0, 50, 149):
        cloud = clouds[frame][1]
        points = np.frombuffer(cloud.data, "<f4").reshape(-1, 3)
        seen = np.isfinite(markers.positions[frame]).all(axis=1)
        np.testing.assert_allclose(points, 1e-3 * markers.positions[frame][seen], rtol=1e-6)
        assert [(one.name, one.offset) for one in cloud.fields] == [("x", 0), ("y", 4), ("z", 8)]
        assert cloud.timestamp.ToNanoseconds() == clouds[frame][0]


def test_every_marker_that_is_seen_is_a_frame_of_its_name(path: Path, markers: MarkerTable) -> None:
    transforms = messages(path, "/tf")[50][1].transforms
    assert [one.child_frame_id for one in transforms] == ["cuff_1", "rope_2"]
    np.testing.assert_allclose(transforms[1].translation.z, 1e-3 * markers.positions[50, 2, 2])
    assert {one.parent_frame_id for one in transforms} == {messages(path, "/markers")[0][1].frame_id}


def test_the_force_is_a_number_a_message(path: Path) -> None:
    with path.open("rb") as file:
        found = [message for _, _, message in make_reader(file).iter_messages(topics=["/force"])]
    values = [struct.unpack("<d", message.data[-8:])[0] for message in found]
    np.testing.assert_array_equal(values, FORCE.values)
    assert found[0].log_time == ZERO_NS - 500_000_000


def test_a_chunk_spans_a_tenth_of_a_second_at_most_and_follows_the_one_before(path: Path) -> None:
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None and len(summary.chunk_indexes) >= 20
    spans = [(one.message_start_time, one.message_end_time) for one in summary.chunk_indexes]
    assert all(end - start <= CHUNK_S * 1e9 for start, end in spans)
    assert all(first[1] <= second[0] for first, second in pairwise(spans))


def test_rerun_s_own_loader_draws_points_curve_and_frames(path: Path, tmp_path: Path) -> None:
    converted = tmp_path / "trial.rrd"
    for words in (["mcap", "convert", str(path), "-o", str(converted)], ["rrd", "print", "-v", str(converted)]):
        ran = subprocess.run(  # noqa: S603  (our own words)
            [sys.executable, "-m", "rerun", *words], check=True, capture_output=True, text=True
        )
    rows = dict.fromkeys(("Scalars:scalars", "Points3D:positions", "Transform3D:child_frame", "TextLog:text"), 0)
    for count, columns in re.findall(r"with (\d+) rows .*data columns: \[(.*)\]", ran.stdout):
        for component in rows:
            rows[component] += int(count) * (component in columns)
    assert rows["Scalars:scalars"] == 2000
    assert rows["Points3D:positions"] == 150
    assert rows["Transform3D:child_frame"] >= 150
    assert rows["TextLog:text"] == 1
