"""Tables of samples, signals in CSV, delimited EMG and .exp files: written, read back, and refused by line."""

import gzip
from pathlib import Path

import numpy as np
import pytest

from recordings.errors import RecordingCode
from recordings.exchange.delimited_emg import read_delimited_emg, read_exp
from recordings.exchange.sample_tables import (
    MarkerTable,
    SignalTable,
    count_samples,
    note_on_far,
    require_rising,
    settle_times,
    without_origin,
)
from recordings.exchange.signal_csv import read_signals, write_columns
from tests.conftest import SHARED
from tests.refusals import raises_refusal

DELSYS = (
    "Label: EMG1 Sampling frequency: 1000 Unit: mV Domain: Time\n\n"
    'X[s],"EMG1",X[s],"EMG 2, left [V]",X[s],"ACC 1"\n'
    "0.000,0.1,0.000,0.2,0.000,1\n0.001,0.3,0.001,0.4,0.007,1\n0.002,0.5,0.002,0.6,,\n"
)
QTM = (
    "FILE_VERSION\t2.0.0\nTOT_NO_OF_CHAN\t2\nTIME_STAMP\t2025-01-01, 10:00:00\t12.5\nDATA_INCLUDED\tANALOG\n"
    "CHANNEL_NAMES\tAD\tMD\nCHANNEL_GAIN\t1\t1\nCHANNEL_FREQUENCIES\t{rates}\n{titles}"
)
TEXT = """  \t// User name
29-11-2018\t// Evaluation date
AFLX01\t13-1-2010\t18:34:34:250\t// Source file name and timestamp
1000.000\t// Measurement rate
0.003\t// Data capture period
BUTTERWORTH FILTER\t// Smoothing function
SET BAD DATA TO ZERO\t// Data repair function

Frame #\tAD\tMD\t
0\t-0.787048\t-0.261841\t
1\t-0.797424\t-0.261536\t
2\t0.5\t0.25\t
"""


@pytest.mark.parametrize(
    ("times", "code", "naming"),
    [
        ([0.0], RecordingCode.FOREIGN_TOO_SHORT, ""),
        ([0.0, float("nan"), 0.2], RecordingCode.FOREIGN_NOT_A_NUMBER, "line 8"),
        ([0.0, 0.1, 0.1], RecordingCode.FOREIGN_TIME_NOT_RISING, "line 9"),
        ([0.0, 0.2, 0.1], RecordingCode.FOREIGN_TIME_NOT_RISING, "line 9"),
    ],
)
def test_times_that_do_not_rise_are_refused_with_their_line(
    times: list[float], code: RecordingCode, naming: str
) -> None:
    with raises_refusal(code, naming):
        require_rising(np.array(times), "daq.csv, time_s,", 7)


def test_samples_are_counted_from_their_times_and_a_gap_is_a_jump() -> None:
    times = np.delete(np.arange(1000) / 400, slice(300, 317))
    numbers, rate = count_samples(times)
    assert rate == pytest.approx(400)
    assert list(np.flatnonzero(np.diff(numbers) != 1)) == [299]
    assert numbers[300] == 317


@pytest.mark.parametrize(
    ("times", "nominal"),
    [
        (np.round(np.arange(4000) / 400, 3), 400),
        (np.arange(600) / 20 + 0.01 * np.random.default_rng(1).uniform(-1, 1, 600), 20),
    ],
    ids=["rounded to milliseconds", "a jittering clock"],
)
def test_inexact_times_are_still_counted_one_by_one(times: np.ndarray, nominal: float) -> None:
    numbers, rate = count_samples(times)
    assert np.all(np.diff(numbers) == 1)
    assert rate == pytest.approx(nominal, rel=1e-3 if nominal == 400 else 1e-2)


def test_exact_zeros_half_a_position_and_one_in_space_are_missing_markers() -> None:
    positions = np.array([[[0.0, 0.0, 0.0], [0.0, 1.0, 2.0], [np.nan, 1.0, 2.0], [1.0, -1e300, 2.0]]])
    assert np.isnan(without_origin(positions)).all(axis=2).tolist() == [[True, False, True, True]]


def test_positions_beyond_a_thousand_kilometres_are_counted_in_a_note() -> None:
    positions = np.array([[[1.0, 2.0, 3.0], [1.0, -1e30, 2.0]], [[np.nan, 0.0, 0.0], [1e12, np.inf, 1.0]]])
    (note,) = note_on_far(positions, "f")
    assert "2 positions" in note
    assert not note_on_far(positions[:, :1], "f")


@pytest.mark.parametrize(
    ("nominal", "decimals"), [(29.97, 5), (29.97, 3), (23.976, 6), (59.94, 4), (120.12, 9), (50.0, 2), (200.0, 3)]
)
def test_the_times_decide_where_the_stated_rate_is_not_theirs(nominal: float, decimals: int) -> None:
    times = np.round(np.arange(600) / nominal, decimals)
    rate, time, notes = settle_times(np.arange(1.0, 601.0), times, np.rint(2 * nominal) / 2 + 0.5, "f", 1)
    table = MarkerTable(("a",), rate, time, np.ones((600, 1, 3)), np.zeros((600, 1)))
    assert rate == pytest.approx(nominal, abs=nominal * 2 * 10.0**-decimals / times[-1])
    assert len(notes) == 1
    assert np.array_equal(table.frame_numbers, np.arange(1, 601))


@pytest.mark.parametrize(("rate", "decimals"), [(100.0, 3), (30.0, 2), (29.97, 3), (120.0, 5), (1 / 3, 1)])
def test_the_stated_rate_is_kept_where_the_times_are_rounded_to_their_last_digit(rate: float, decimals: int) -> None:
    times = np.round(7.3 + np.arange(700) / rate, decimals)
    assert settle_times(np.arange(700.0), times, rate, "f", 1)[::2] == (rate, ())


def test_frames_that_are_not_in_the_file_leave_a_gap_in_the_numbers() -> None:
    kept = np.delete(np.arange(600), slice(200, 217))
    rate, time, _ = settle_times(kept + 1.0, kept / 29.97, 30.0, "f", 1)
    table = MarkerTable(("a",), rate, time, np.ones((583, 1, 3)), np.zeros((583, 1)))
    assert np.array_equal(table.frame_numbers, kept + 1)
    assert settle_times(np.array([101.0, 102.0, 104.0]), None, 100.0, "f", 1)[1] == pytest.approx([1.0, 1.01, 1.03])


def test_times_in_milliseconds_are_refused() -> None:
    with raises_refusal(RecordingCode.FOREIGN_CONTRADICTORY, "in ms"):
        settle_times(np.arange(1.0, 9.0), 10.0 * np.arange(8), 100.0, "f", 1)
    with raises_refusal(RecordingCode.FOREIGN_NO_RATE):
        settle_times(np.arange(1.0, 9.0), None, 0.0, "f", 1)


def values_of(table: SignalTable) -> dict[str, list[float]]:
    return {name: values.tolist() for name, values in table.signals.items()}


def table(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "daq.csv"
    path.write_bytes(text.encode())
    return path


TABLES = {
    "plain": "time_s,force_v\n0.0,1.5\n0.1,1.25\n",
    "with a byte order mark and CR": "\ufefftime_s,force_v\r\n0.0,1.5\r\n0.1,1.25\r\n\r\n",
    "of a country with decimal commas": "# made by hand\n\ntime_s;note;force_v\n0,0;a;1,5\n0,1;b;1,25\n",
    "quoted, with tabs": '"time_s"\t"force_v"\n0\t1.5\n1e-1\t1.25\n',
    "a title and fields that hold commas": 'time_s,"a, ""b"", c",force_v\n0.0,"1,5",1.5\n0.1,"x, y",1.25\n',
    "quoted numbers": '"time_s","force_v"\n"0.0","1.5"\n"0.1","1.25"\n',
    "an empty column and rows": "time_s,force_v,\n0.0,1.5,\n0.1,1.25,\n,,\n,,\n",
    "for a spreadsheet": 'sep=;\ntime_s; "a; b"; force_v\n0,0; 1; 1,5\n0,1; "2; 3"; 1,25\n',
    "a title of two lines": 'time_s,"a\nb",force_v\n0.0,1,1.5\n0.1,1,1.25\n',
    "with a quoted separator": '"SEP=;"\r\ntime_s;force_v\r\n0;1.5\r\n0.1;1.25\r\n',
}


@pytest.mark.parametrize("text", TABLES.values(), ids=TABLES)
def test_a_table_is_read_whatever_program_wrote_it(tmp_path: Path, text: str) -> None:
    read = read_signals(table(tmp_path, text), "time_s", ["force_v", "sync_v"])
    assert read.time_s.tolist() == [0.0, 0.1]
    assert values_of(read) == {"force_v": [1.5, 1.25]}


@pytest.mark.parametrize(
    ("text", "code", "naming"),
    [
        ("", RecordingCode.FOREIGN_EMPTY, ""),
        ("\n \n", RecordingCode.FOREIGN_EMPTY, ""),
        ("time,force\n0,1\n", RecordingCode.FOREIGN_MISSING_COLUMN, "time_s"),
        ("0.0,1.5\n0.1,1.5\n", RecordingCode.FOREIGN_MISSING_COLUMN, "time_s"),
        ('t,"Torque, request"\n0,1\n', RecordingCode.FOREIGN_MISSING_COLUMN, 'only t, "Torque, request"; '),
        ("time_s,force_v\n", RecordingCode.FOREIGN_TOO_SHORT, ""),
        ("time_s,force_v\n0,1\n0.1,high\n", RecordingCode.FOREIGN_NOT_A_NUMBER, "line 3, has 'high' in column 2"),
        ("time_s,force_v\n0,1\n,1\n", RecordingCode.FOREIGN_NOT_A_NUMBER, "line 3"),
        ("time_s,force_v\n0,1\n0,1\n", RecordingCode.FOREIGN_TIME_NOT_RISING, "line 3"),
        ("time_s,force_v\n1,1\n0,1\n", RecordingCode.FOREIGN_TIME_NOT_RISING, "line 3"),
        ("time_s,force_v,force_v\n0,1,2\n0.1,1,2\n", RecordingCode.FOREIGN_REPEATED_NAME, "'force_v' twice"),
        ("time_s,force_v,time_s\n0,1,0\n0.1,1,2\n", RecordingCode.FOREIGN_REPEATED_NAME, "'time_s' twice"),
        ("PK\0\0", RecordingCode.FOREIGN_WRONG_TYPE, ""),
        ("time_s,a,force_v\n0,1,2\n0.1,2\n", RecordingCode.FOREIGN_TITLES, "line 3, has 2 fields, expected 3"),
        ("time_s,force_v\n0,1\n0.1,2,3\n", RecordingCode.FOREIGN_TITLES, "line 3, has 3 fields"),
        ("time_s,force_v\n0,000,1,5\n0,100,1,25\n", RecordingCode.FOREIGN_TITLES, "decimals written with commas"),
        ('time_s,"force_v\n0,1\n0.1,2\n', RecordingCode.FOREIGN_TITLES, "line 1, has a quote that does not end"),
        ('time_s,force_v\n"0,000","1,5"\n', RecordingCode.FOREIGN_NOT_A_NUMBER, "'0,000' in column 1"),
        ("time_s\tforce_v\n0.0\t1,250\n0.1\t1,251\n", RecordingCode.FOREIGN_NOT_A_NUMBER, "'1,250' in column 2"),
        ("time_s,force_v\n0,1_000\n0.1,2\n", RecordingCode.FOREIGN_NOT_A_NUMBER, "'1_000' in column 2"),
        ("time_s,force_v\n" + 1000 * "0.1,2\n" + "\0\0\0", RecordingCode.FOREIGN_DAMAGED, "line 1002"),
        ("time_s;force_v\n0,0;1.250,5\n0,1;1.251,5\n", RecordingCode.FOREIGN_NOT_A_NUMBER, "mark of thousands"),
    ],
)
def test_a_table_that_is_none_is_refused_in_a_sentence(
    tmp_path: Path, text: str, code: RecordingCode, naming: str
) -> None:
    with raises_refusal(code, naming):
        read_signals(table(tmp_path, text), "time_s", ["force_v"])


def test_a_file_that_is_not_there_is_a_sentence(tmp_path: Path) -> None:
    with raises_refusal(RecordingCode.FOREIGN_UNREADABLE, "none.csv"):
        read_signals(tmp_path / "none.csv", "time_s", ["force_v"])


def test_an_empty_field_is_no_number_zero_is_one_and_only_a_repeated_column_that_is_read_is_a_fault(
    tmp_path: Path,
) -> None:
    text = "time_s,note,force_v,note\n0,a,,b\n1,a,0,b\n2,a,n/a,b\n3,a,2,b\n"
    read = read_signals(table(tmp_path, text), "time_s", ["force_v"])
    np.testing.assert_array_equal(read.signals["force_v"], [np.nan, 0.0, np.nan, 2.0])


def test_numbers_come_back_to_the_last_bit(tmp_path: Path) -> None:
    values = np.random.default_rng(1).normal(size=200) * 10.0 ** np.arange(-100, 100)
    values[7] = np.nan
    read = read_signals(
        table(tmp_path, write_columns({"time_s": np.arange(200) / 3, "x": values}, ";")), "time_s", ["x"]
    )
    assert np.array_equal(read.signals["x"], values, equal_nan=True)
    assert np.array_equal(read.time_s, np.arange(200) / 3)


def read(folder: Path, text: str, rate: float | None = None, labels: tuple[str, ...] = ()) -> SignalTable:
    path = folder / "emg.csv"
    path.write_text(text, encoding="utf-8")
    return read_delimited_emg(path, rate, labels)


@pytest.mark.parametrize(
    ("text", "signals", "units"),
    [
        ("time,AD,MD\n0,1,2\n0.001,3,4\n", {"AD": [1, 3], "MD": [2, 4]}, ["", ""]),
        ("# a script's\nTime [ms];AD (mV);ACC [g]\n0,0;1,5;9\n1,0;2;9\n", {"AD": [1.5, 2]}, ["mV"]),
        ("time_s,AD_uv,MD [µV]\n0,1,2\n0.001,3,4\n", {"AD": [1, 3], "MD": [2, 4]}, ["uV", "uV"]),
        ('"Time,s"\t"LT DELT,uV"\n0\t1\n0.001\t3\n', {"LT DELT": [1, 3]}, ["uV"]),
        ("sample\tt (s)\tTS\tT_V\t\n1\t0\t1\t2\t\n2\t0.001\t3\t4\t\n", {"TS": [1, 3], "T": [2, 4]}, ["", "V"]),
    ],
    ids=["plain", "semicolons, ms, decimal commas", "units behind names", "quoted", "counter, tabs at ends"],
)
def test_titles_give_time_channels_and_units(
    tmp_path: Path, text: str, signals: dict[str, list[float]], units: list[str]
) -> None:
    found = read(tmp_path, text)
    assert found.time_s.tolist() == [0.0, 0.001]
    assert values_of(found) == signals
    assert list(found.units.values()) == units


def test_delsys_sensors_on_another_clock_are_left_out_and_named(tmp_path: Path) -> None:
    found = read(tmp_path, DELSYS)
    assert values_of(found) == {"EMG1": [0.1, 0.3, 0.5], "EMG 2, left": [0.2, 0.4, 0.6]}
    assert found.units == {"EMG1": "mV", "EMG 2, left": "V"}
    assert "ACC 1" in found.names


@pytest.mark.parametrize(
    "titles", ["0.1\t0.2\n0.3\t0.4\n", "SAMPLE\tTIME\tAD\tMD\n1\t0\t0.1\t0.2\n2\t0.0005\t0.3\t0.4\n"]
)
def test_qtm_s_analog_export_has_its_rate_and_names_in_the_header(tmp_path: Path, titles: str) -> None:
    found = read(tmp_path, QTM.format(rates="2000\t2000", titles=titles))
    assert found.time_s.tolist() == [0.0, 0.0005]
    assert values_of(found) == {"AD": [0.1, 0.3], "MD": [0.2, 0.4]}


def test_a_given_rate_and_labels_replace_those_that_the_file_lacks(tmp_path: Path) -> None:
    found = read(tmp_path, "1;2\n3;4\n", 2000.0, ("AD", "MD"))
    assert (found.time_s.tolist(), found.signals["AD"].tolist()) == ([0.0, 0.0005], [1.0, 3.0])


@pytest.mark.parametrize(
    ("text", "code", "naming"),
    [
        ("", RecordingCode.FOREIGN_EMPTY, ""),
        ("AD MD\n0 1\n", RecordingCode.FOREIGN_NO_ROWS, ""),
        ("1,2\n3,4\n", RecordingCode.FOREIGN_TITLES, "2 columns"),
        ("time,AD,MD\n0,1\n", RecordingCode.FOREIGN_TITLES, "2 columns"),
        ("AD,MD\n1,2\n3,4\n", RecordingCode.FOREIGN_NO_RATE, ""),
        ("time,ACC [g]\n0,1\n0.001,2\n", RecordingCode.FOREIGN_NO_CHANNEL, ""),
        ("time,AD,AD\n0,1,2\n0.001,3,4\n", RecordingCode.FOREIGN_REPEATED_NAME, "'AD'"),
        ("time,AD\n0,1\n0,2\n", RecordingCode.FOREIGN_TIME_NOT_RISING, "line 3"),
        ("time,AD\n0,1\n0.001,high\n", RecordingCode.FOREIGN_NOT_A_NUMBER, "line 3, has 'high' in column 2"),
        (QTM.format(rates="2000\t1000", titles="1\t2\n"), RecordingCode.FOREIGN_CONTRADICTORY, "1000 and 2000 Hz"),
    ],
)
def test_what_cannot_be_read_is_refused_in_a_sentence(
    tmp_path: Path, text: str, code: RecordingCode, naming: str
) -> None:
    with raises_refusal(code, naming):
        read(tmp_path, text)


def written(folder: Path, text: str) -> Path:
    path = folder / "trial.exp"
    path.write_text(text, encoding="utf-8")
    return path


def test_header_and_rows_are_read_and_bare_numbers_need_a_rate_and_labels(tmp_path: Path) -> None:
    read = read_exp(written(tmp_path, TEXT))
    assert read.names == ("AD", "MD")
    assert read.time_s.tolist() == [0.0, 0.001, 0.002]
    assert read.signals["MD"].tolist() == [-0.261841, -0.261536, 0.25]
    assert read.units == {"AD": "", "MD": ""}
    path = written(tmp_path, "0.5\t1.5\n-0.5\t2.5\n")
    with raises_refusal(RecordingCode.FOREIGN_NO_HEADER):
        read_exp(path)
    read = read_exp(path, 1000.0, ["AD", "MD"])
    assert (read.time_s.tolist(), read.signals["MD"].tolist()) == ([0.0, 0.001], [1.5, 2.5])


@pytest.mark.parametrize(
    ("before", "after", "code", "naming"),
    [
        ("1000.000\t// Measurement rate\n", "", RecordingCode.FOREIGN_NO_RATE, "Measurement rate"),
        ("1000.000", "fast", RecordingCode.FOREIGN_NO_RATE, "fast"),
        ("0.003", "0.300", RecordingCode.FOREIGN_CUT, "300"),
        ("1\t-0.797424", "7\t-0.797424", RecordingCode.FOREIGN_MISSING_FRAME, "line 11"),
        ("AD\tMD", "AD\tAD", RecordingCode.FOREIGN_REPEATED_NAME, "AD, AD"),
        ("0.25", "high", RecordingCode.FOREIGN_NOT_A_NUMBER, "line 12, has 'high' in column 3"),
        ("Frame #\tAD\tMD\t\n", "", RecordingCode.FOREIGN_NO_HEADER, ""),
    ],
)
def test_a_file_that_is_none_is_refused_in_a_sentence(
    tmp_path: Path, before: str, after: str, code: RecordingCode, naming: str
) -> None:
    with raises_refusal(code, naming):
        read_exp(written(tmp_path, TEXT.replace(before, after)))


@pytest.mark.shared
@pytest.mark.parametrize(("trial", "rows"), [("FLX01", 7940), ("ABD02", 8460), ("SHRUG01", 4620)])
def test_the_public_trials_are_read_as_numpy_reads_them(tmp_path: Path, trial: str, rows: int) -> None:
    raw = gzip.decompress((SHARED / "markers" / f"{trial}_emg.exp.gz").read_bytes())
    path = tmp_path / f"{trial}.exp"
    path.write_bytes(raw)
    heads = ["AD", "MD", "PD", "TS", "TM", "TI", "Infra", "SA", "LatD"]
    labels = [*heads, "PM_Sternal", "PM_Clav", "TMajor", "Bic", "Tric"]
    read = read_exp(path, 1000.0, labels)
    assert (list(read.names), len(read.time_s), read.time_s[-1]) == (labels, rows, (rows - 1) / 1000)
    whole = np.genfromtxt(path, skip_header=0 if trial == "SHRUG01" else 9)
    np.testing.assert_array_equal(np.column_stack(list(read.signals.values())), whole[:, -14:])
