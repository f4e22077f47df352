"""C3D files, as other programs write them and as written here: markers and analog signals, and refusals."""

import re
import struct
import warnings
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import c3d
import ezc3d
import numpy as np
import pytest
from numpy.typing import NDArray

from recordings.errors import ForeignFile, RecordingCode
from recordings.exchange.c3d import read_c3d_markers, read_c3d_signals, write_c3d
from recordings.exchange.sample_tables import MarkerTable
from tests.recordings.exchange.walk import FRAMES, same, walk
from tests.refusals import raises_refusal

POINTS, RAW_FRAMES, CHANNELS, PER_FRAME, SCALE = 3, 60, 2, 4, 0.1
POSITIONS = np.arange(RAW_FRAMES * POINTS * 3).reshape(RAW_FRAMES, POINTS, 3) + 10
INTEL, DEC, MIPS = 84, 85, 86
CHARACTER, INTEGER, REAL = -1, 2, 4
FORCE = np.sin(np.arange(10 * FRAMES) / 7)
PROCESSORS = pytest.mark.parametrize("processor", [INTEL, DEC, MIPS], ids=["intel", "dec", "mips"])


def write_raw_c3d(
    path: Path,
    labels: Sequence[str] = ("a", "b", "c"),
    *,
    header_analog: int = CHANNELS * PER_FRAME,
    used_analog: int = CHANNELS,
    processor: int = INTEL,
    is_real: bool = False,
    rate: float = 100.0,
    offset: float = 0,
    offset_kind: int = INTEGER,
    analog_format: str = "",
    gen_scale: float = 1.0,
    counts: NDArray[np.int64] | None = None,
    unit: str = "mm",
) -> Path:
    """POSITIONS × 0.1 (or POSITIONS, if real) at 100 Hz and 2 channels at 400 Hz, which are there whatever is stated.

    counts (RAW_FRAMES × PER_FRAME, CHANNELS): stored numbers of the channels, whose SCALE is 1 and 0.5.
    """
    numbers = _Numbers(processor)
    scale = -SCALE if is_real else SCALE
    width = max(map(len, labels))
    stated_format = [(2, "FORMAT", CHARACTER, (len(analog_format),), analog_format.encode())] if analog_format else []
    parameters = [
        (1, "USED", INTEGER, (), numbers.integers(POINTS)),
        (1, "FRAMES", INTEGER, (), numbers.integers(RAW_FRAMES)),
        (1, "DATA_START", INTEGER, (), numbers.integers(4)),
        (1, "SCALE", REAL, (), numbers.reals(scale)),
        (1, "RATE", REAL, (), numbers.reals(rate)),
        (1, "UNITS", CHARACTER, (len(unit),), unit.encode()),
        (1, "LABELS", CHARACTER, (width, len(labels)), "".join(x.ljust(width) for x in labels).encode()),
        (2, "USED", INTEGER, (), numbers.integers(used_analog)),
        (2, "RATE", REAL, (), numbers.reals(rate * PER_FRAME)),
        (2, "GEN_SCALE", REAL, (), numbers.reals(gen_scale)),
        (2, "SCALE", REAL, (CHANNELS,), numbers.reals(1, 0.5)),
        (2, "OFFSET", offset_kind, (CHANNELS,), numbers.of(offset_kind, offset, offset)),
        *stated_format,
        (2, "LABELS", CHARACTER, (2, CHANNELS), b"f1f2"),
    ]
    records = [_record(numbers, -1, "POINT", b"\0"), _record(numbers, -2, "ANALOG", b"\0")]
    records += [
        _record(numbers, group, name, struct.pack("bB", kind, len(dimensions)) + bytes(dimensions) + data + b"\0")
        for group, name, kind, dimensions, data in parameters
    ]
    section = (bytes([1, 0x50, 2, processor]) + b"".join(records)).ljust(1024, b"\0")
    counted = numbers.integers(POINTS, header_analog, 1, RAW_FRAMES, 0)
    header = b"\2\x50" + counted + numbers.reals(scale) + numbers.integers(4, PER_FRAME) + numbers.reals(rate)
    points = np.concatenate([POSITIONS, np.zeros((RAW_FRAMES, POINTS, 1), dtype=int)], axis=2).reshape(RAW_FRAMES, -1)
    stored = np.full((RAW_FRAMES * PER_FRAME, CHANNELS), 7) if counts is None else counts
    frames = np.hstack([points, stored.reshape(RAW_FRAMES, -1)])
    data = numbers.reals(*frames.ravel()) if is_real else numbers.integers(*frames.ravel())
    path.write_bytes(header.ljust(512, b"\0") + section + data)
    return path


class _Numbers:
    """Numbers in the bytes of a processor."""

    def __init__(self, processor: int) -> None:
        self._order, self._is_vax = ">" if processor == MIPS else "<", processor == DEC

    def integers(self, *values: float) -> bytes:
        """Of either sign: 40000 and −25536 are the same 16 bits."""
        return (np.array(values).astype(np.int64) & 0xFFFF).astype(f"{self._order}u2").tobytes()

    def reals(self, *values: float) -> bytes:
        """VAX: the halves of four times the number, exchanged."""
        if not self._is_vax:
            return np.array(values, f"{self._order}f4").tobytes()
        return (4 * np.array(values, "<f4")).view("<u2").reshape(-1, 2)[:, ::-1].tobytes()

    def of(self, kind: int, *values: float) -> bytes:
        return self.reals(*values) if kind == REAL else self.integers(*values)


def _record(numbers: _Numbers, group: int, name: str, body: bytes) -> bytes:
    return struct.pack("<bb", len(name), group) + name.encode() + numbers.integers(2 + len(body)) + body


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "trial.c3d"
    write_c3d(path, walk(), {"force_n": FORCE, "sync_v": 5 * (FORCE > 0)}, {"force_n": "N", "sync_v": "V"})
    return path


def rewritten(path: Path, change) -> Path:
    file = ezc3d.c3d(str(path))
    change(file)
    file.write(str(path))
    return path


def relabelled(path: Path, group: str, labels: list[str]) -> Path:
    def change(file: ezc3d.c3d) -> None:
        file["parameters"][group]["LABELS"]["value"] = labels

    return rewritten(path, change)


def patched(path: Path, place: int, data: bytes) -> Path:
    """With other bytes from a place on."""
    content = bytearray(path.read_bytes())
    content[place : place + len(data)] = data
    path.write_bytes(content)
    return path


def test_markers_and_analog_channels_come_back_with_their_units_on_one_clock(file: Path) -> None:
    assert same(read_c3d_markers(file), walk(), tolerance_mm=1e-4)
    read = read_c3d_signals(file, ["force_n", "elsewhere"])
    assert read.names == ("force_n", "sync_v")
    assert read.units == {"force_n": "N"}
    assert read.signals["force_n"] == pytest.approx(FORCE, abs=1e-6)
    assert read.time_s == pytest.approx(np.arange(10 * FRAMES) / 1000)


def test_a_marker_of_negative_residual_is_missing_and_zeros_beside_it_are_no_position(file: Path) -> None:
    def hide(file: ezc3d.c3d) -> None:
        file["data"]["points"][:3, 0, 4] = 0.0
        file["data"]["meta_points"]["residuals"][0, 0, 4] = -1

    assert read_c3d_markers(rewritten(file, hide)).missing[4, 0]


def test_metres_and_a_capture_that_was_cut_are_understood(file: Path) -> None:
    def change(file: ezc3d.c3d) -> None:
        file["parameters"]["POINT"]["UNITS"]["value"] = ["m"]
        file["data"]["points"][:3] /= 1000
        file["header"]["points"]["first_frame"] = 50

    read = read_c3d_markers(rewritten(file, change))
    assert same(read, walk(first=0.5), tolerance_mm=1e-3)
    assert read_c3d_signals(file, ["force_n"]).time_s[0] == pytest.approx(0.5)


def test_unlabelled_trajectories_are_passed_over_and_alone_are_no_markers(file: Path) -> None:
    assert read_c3d_markers(relabelled(file, "POINT", ["LShoulderTop", "*17", ""])).labels == ("LShoulderTop",)
    with raises_refusal(RecordingCode.FOREIGN_NO_MARKERS):
        read_c3d_markers(relabelled(file, "POINT", ["*1", "*2", "*3"]))


def test_files_that_are_none_are_refused_in_a_sentence(tmp_path: Path) -> None:
    with raises_refusal(RecordingCode.FOREIGN_UNREADABLE, "none.c3d"):
        read_c3d_markers(tmp_path / "none.c3d")
    (tmp_path / "text.c3d").write_text("NO_OF_FRAMES\t3\n" * 100, encoding="utf-8")
    with raises_refusal(RecordingCode.FOREIGN_WRONG_TYPE, "text.c3d"):
        read_c3d_markers(tmp_path / "text.c3d")
    write_c3d(tmp_path / "silent.c3d", walk(), {}, {})
    with raises_refusal(RecordingCode.FOREIGN_NO_CHANNEL, "silent.c3d"):
        read_c3d_signals(tmp_path / "silent.c3d", ["force_n"])
    table = walk()
    first = replace(table, time_s=table.time_s[:1], positions=table.positions[:1], residuals=table.residuals[:1])
    write_c3d(tmp_path / "one.c3d", first, {}, {})
    with raises_refusal(RecordingCode.FOREIGN_TOO_SHORT, "one.c3d"):
        read_c3d_markers(tmp_path / "one.c3d")


def test_every_cut_of_a_file_is_a_sentence_or_what_was_in_it(file: Path, tmp_path: Path) -> None:
    whole, cut = file.read_bytes(), tmp_path / "cut.c3d"
    for size in range(0, len(whole), 997):
        cut.write_bytes(whole[:size])
        try:
            read = read_c3d_markers(cut)
        except ForeignFile:
            continue
        assert len(read.labels) == 3


def test_labels_beyond_the_points_are_of_nothing_and_one_that_occurs_twice_is_numbered(tmp_path: Path) -> None:
    read = read_c3d_markers(write_raw_c3d(tmp_path / "more.c3d", ["a", "b", "c", "late", "later"]))
    assert read.labels == ("a", "b", "c")
    assert read.positions == pytest.approx(SCALE * POSITIONS, abs=1e-4)
    fewer = read_c3d_markers(write_raw_c3d(tmp_path / "fewer.c3d", ["a", "b"]))
    assert fewer.labels == ("a", "b")
    read = read_c3d_markers(write_raw_c3d(tmp_path / "twice.c3d", ["RTHI", "RKNE", "RTHI"]))
    assert read.labels == ("RTHI#1", "RKNE", "RTHI#2")
    assert read.positions == pytest.approx(SCALE * POSITIONS, abs=1e-4)
    (note,) = read.notes
    assert "more than one marker RTHI" in note and "--label RTHI#1=RTHI" in note


def test_a_wanted_channel_that_occurs_twice_is_refused(file: Path) -> None:
    relabelled(file, "ANALOG", ["force_n", "force_n"])
    with raises_refusal(RecordingCode.FOREIGN_REPEATED_NAME, "'force_n' twice"):
        read_c3d_signals(file, ["force_n"])
    assert read_c3d_signals(file, ["sync_v"]).signals == {}


def test_a_header_that_counts_channels_is_overruled_by_the_file_s_size(tmp_path: Path) -> None:
    # as in c3d.org's sample 24
    read = read_c3d_markers(write_raw_c3d(tmp_path / "channels.c3d", header_analog=CHANNELS))
    assert read.positions == pytest.approx(SCALE * POSITIONS, abs=1e-4)


def test_a_file_that_lost_its_end_is_cut(tmp_path: Path) -> None:
    file = write_raw_c3d(tmp_path / "cut.c3d")
    file.write_bytes(file.read_bytes()[:-10])
    with raises_refusal(RecordingCode.FOREIGN_CUT, "59"):
        read_c3d_markers(file)


@PROCESSORS
@pytest.mark.parametrize("is_real", [False, True], ids=["integers", "reals"])
@pytest.mark.parametrize("analog_format", ["", "SIGNED", "UNSIGNED", "unsign"])  # cut to the width of another text
@pytest.mark.parametrize("offset_kind", [INTEGER, REAL])
def test_the_format_states_the_sign_of_offset_and_samples(
    tmp_path: Path, processor: int, is_real: bool, analog_format: str, offset_kind: int
) -> None:
    low, offset = (0, 40_000) if analog_format.upper().startswith("UNSIGN") else (-32_768, -200)
    counts = np.linspace(low, low + 65_535, RAW_FRAMES * PER_FRAME * CHANNELS).astype(np.int64).reshape(-1, CHANNELS)
    file = write_raw_c3d(
        tmp_path / "a.c3d",
        processor=processor,
        is_real=is_real,
        analog_format=analog_format,
        offset=offset,
        offset_kind=offset_kind,
        counts=counts,
        gen_scale=0.25,
    )
    truth = (counts - offset) * np.array([0.25, 0.125])
    read = read_c3d_signals(file, ["f1", "f2"])
    assert np.column_stack([read.signals["f1"], read.signals["f2"]]) == pytest.approx(truth, abs=1e-9)
    assert read_c3d_markers(file).positions == pytest.approx((1.0 if is_real else SCALE) * POSITIONS, rel=1e-6)
    if offset_kind == INTEGER and analog_format != "unsign":  # the package c3d takes no other
        with warnings.catch_warnings(), file.open("rb") as opened:
            warnings.simplefilter("ignore")
            other = np.concatenate([analog for *_, analog in c3d.Reader(opened).read_frames()], axis=1).T
        assert other == pytest.approx(truth, abs=1e-9)


@pytest.mark.parametrize("rate", [150.001, 149.999, 59.94, 29.97, 1e-3, 3000.0])
def test_a_quotient_of_rates_that_is_not_whole_in_single_precision_is_rounded(tmp_path: Path, rate: float) -> None:
    read = read_c3d_signals(write_raw_c3d(tmp_path / "odd.c3d", rate=rate), ["f1"])
    assert len(read.time_s) == RAW_FRAMES * PER_FRAME
    assert np.diff(read.time_s) == pytest.approx(1 / (PER_FRAME * rate), rel=1e-4)


def test_a_header_that_contradicts_the_parameters_or_the_size_is_refused(tmp_path: Path) -> None:
    # as in c3d.org's sample 28: the parameters know of no analog values, and every frame after the first is shifted
    shifted = write_raw_c3d(tmp_path / "shifted.c3d", used_analog=0)
    fewer = patched(write_raw_c3d(tmp_path / "frames.c3d"), 8, struct.pack("<H", 10))
    for file, naming in ((shifted, "3 points and 8 analog values"), (fewer, "10 frames")):
        with raises_refusal(RecordingCode.FOREIGN_CONTRADICTORY, naming):
            read_c3d_markers(file)
    rates = write_raw_c3d(tmp_path / "rates.c3d")
    rates.write_bytes(rates.read_bytes().replace(struct.pack("<f", 400.0), struct.pack("<f", 150.0)))
    assert read_c3d_markers(rates).positions == pytest.approx(SCALE * POSITIONS, abs=1e-4)
    for file, naming in ((shifted, ""), (rates, "150 analog samples")):
        with raises_refusal(RecordingCode.FOREIGN_CONTRADICTORY, naming):
            read_c3d_signals(file, ["f1"])


def test_a_frame_rate_that_the_header_contradicts_is_a_note(tmp_path: Path) -> None:
    file = write_raw_c3d(tmp_path / "rates.c3d")
    assert not read_c3d_markers(file).notes
    read = read_c3d_markers(patched(file, 20, struct.pack("<f", 60.0)))
    assert read.rate_hz == 100
    assert "60 Hz in its header" in read.notes[0]


@pytest.mark.parametrize(
    ("group", "name", "value"),
    [
        *((group, "RATE", rate) for group in (1, 2) for rate in (np.nan, np.inf, 0.0, -100.0)),
        *((1, "SCALE", scale) for scale in (np.nan, -np.inf)),
        *((2, "GEN_SCALE", scale) for scale in (np.nan, np.inf, 0.0)),
        *((2, "SCALE", scale) for scale in (np.nan, 0.0)),
        (2, "OFFSET", np.nan),
    ],
)
def test_a_rate_or_scale_that_is_no_usable_number_is_refused(
    tmp_path: Path, group: int, name: str, value: float
) -> None:
    """The header's rate, or 1, was read in its place."""
    file = write_raw_c3d(tmp_path / "number.c3d", offset_kind=REAL)
    record = bytes([len(name), group]) + name.encode()
    behind = 5 if name in ("SCALE", "OFFSET") and group == 2 else 4
    patched(file, file.read_bytes().index(record) + len(record) + behind, struct.pack("<f", value))
    with raises_refusal(RecordingCode.FOREIGN_DAMAGED, f" {value:g}"):
        read_c3d_signals(file, ["f1"])


def test_a_scale_of_zero_for_integer_positions_is_refused(tmp_path: Path) -> None:
    """The header's scale was read in its place."""
    file = write_raw_c3d(tmp_path / "scale.c3d")
    at = file.read_bytes().index(b"\x05\x01SCALE") + 11
    assert struct.unpack_from("<f", file.read_bytes(), at) == (pytest.approx(SCALE),)
    patched(file, at, struct.pack("<f", 0.0))
    with raises_refusal(RecordingCode.FOREIGN_DAMAGED, " 0 "):
        read_c3d_markers(file)


@pytest.mark.parametrize(("unit", "factor"), [("m", 1000), ("mete", 1000), ("METERS", 1000), ("cent", 10), ("mill", 1)])
def test_a_unit_that_is_cut_to_the_width_of_its_parameter_is_understood(
    tmp_path: Path, unit: str, factor: float
) -> None:
    read = read_c3d_markers(write_raw_c3d(tmp_path / "unit.c3d", unit=unit))
    assert read.positions == pytest.approx(factor * SCALE * POSITIONS, rel=1e-6)


@pytest.mark.parametrize("size", [513, 515, 516, 600, 1023, 1535])
def test_a_file_that_ends_within_its_parameters_is_refused(tmp_path: Path, size: int) -> None:
    file = write_raw_c3d(tmp_path / "cut.c3d")
    file.write_bytes(file.read_bytes()[:size])
    with pytest.raises(ForeignFile):
        read_c3d_markers(file)


@pytest.mark.parametrize("text", [b"POINT", b"ANALOG", b"LABELS", b"SCALE", b"OFFSET", b"USED", b"RATE"])
def test_a_damaged_parameter_ends_in_a_sentence_or_in_what_the_file_holds(tmp_path: Path, text: bytes) -> None:
    file = write_raw_c3d(tmp_path / "damaged.c3d")
    whole = file.read_bytes()
    for at in (found.end() for found in re.finditer(text, whole)):
        for replaced in (b"\xff\xff", b"\0\0", b"\1\0", b"\xff\x7f\xff\xff\xff\xff", b"\x7f" * 8):
            file.write_bytes(whole[:at] + replaced + whole[at + len(replaced) :])
            with suppress(ForeignFile):
                assert len(read_c3d_markers(file).time_s) <= RAW_FRAMES
            with suppress(ForeignFile):
                assert len(read_c3d_signals(file, ["f1"]).time_s) <= RAW_FRAMES * 255


@pytest.mark.parametrize("frames", [FRAMES, pytest.param(70_000, marks=pytest.mark.slow)])
def test_a_second_reader_finds_markers_and_a_single_channel(tmp_path: Path, frames: int) -> None:
    turns = -(-frames // FRAMES)
    whole = walk()
    positions, residuals = (np.concatenate([part] * turns)[:frames] for part in (whole.positions, whole.residuals))
    table = MarkerTable(whole.labels, whole.rate_hz, np.arange(frames) / 100, positions, residuals)
    force = np.resize(FORCE, 10 * frames)
    write_c3d(tmp_path / "one.c3d", table, {"force_n": force}, {"force_n": "N"})
    points, channels = [], []
    with (tmp_path / "one.c3d").open("rb") as file:
        reader = c3d.Reader(file)
        for _, seen, analog in reader.read_frames(copy=True):
            points.append(seen)
            channels.append(analog[0])
    found = np.array(points)
    missing = found[..., 3] < 0
    assert (missing == table.missing).all()
    np.testing.assert_allclose(found[~missing][:, :3], positions[~missing], rtol=0, atol=1e-3)
    half_a_unit = 0.5 * abs(float(reader.point_scale))
    np.testing.assert_allclose(found[~missing][:, 3], residuals[~missing], rtol=0, atol=half_a_unit)
    np.testing.assert_allclose(np.concatenate(channels), force, rtol=0, atol=1e-6)
    assert [label.strip() for label in reader.point_labels] == list(table.labels)


def test_a_signalling_nan_is_a_missing_position(tmp_path: Path) -> None:
    path = write_raw_c3d(tmp_path / "damaged.c3d", is_real=True)
    patched(path, 3 * 512, (0x7FA00000).to_bytes(4, "little"))  # the first number of the data, in block 4
    assert read_c3d_markers(path).missing[0].tolist() == [True, False, False]
