from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from recordings.errors import RecordingCode
from recordings.exchange.signal_csv import read_signals, write_columns
from tests.refusals import raises_refusal


def table(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "daq.csv"
    path.write_bytes(text.encode())
    return path


@pytest.mark.parametrize(
    "text",
    [
        "time_s,force_v\n0.0,1.5\n0.1,1.25\n",
        "\ufefftime_s,force_v\r\n0.0,1.5\r\n0.1,1.25\r\n\r\n",
        "# made by hand\n\ntime_s;note;force_v\n0,0;a;1,5\n0,1;b;1,25\n",
        '"time_s"\t"force_v"\n0\t1.5\n1e-1\t1.25\n',
        'time_s,"a, ""b"", c",force_v\n0.0,"1,5",1.5\n0.1,"x, y",1.25\n',
        '"time_s","force_v"\n"0.0","1.5"\n"0.1","1.25"\n',
        "time_s,force_v,\n0.0,1.5,\n0.1,1.25,\n,,\n,,\n",
        'sep=;\ntime_s; "a; b"; force_v\n0,0; 1; 1,5\n0,1; "2; 3"; 1,25\n',
        'time_s,"a\nb",force_v\n0.0,1,1.5\n0.1,1,1.25\n',
        '"SEP=;"\r\ntime_s;force_v\r\n0;1.5\r\n0.1;1.25\r\n',
    ],
    ids=[
        "plain",
        "with a byte order mark and CR",
        "of a country with decimal commas",
        "quoted, with tabs",
        "a title and fields that hold commas",
        "quoted numbers",
        "an empty column and rows",
        "for a spreadsheet",
        "a title of two lines",
        "with a quoted separator",
    ],
)
def test_a_table_is_read_whatever_program_wrote_it(tmp_path: Path, text: str) -> None:
    read = read_signals(table(tmp_path, text), "time_s", ["force_v", "sync_v"])
    assert read.time_s.tolist() == [0.0, 0.1]
    assert {name: values.tolist() for name, values in read.signals.items()} == {"force_v": [1.5, 1.25]}


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


def test_a_repeated_column_that_is_not_read_is_no_fault(tmp_path: Path) -> None:
    read = read_signals(table(tmp_path, "time_s,note,force_v,note\n0,a,1,b\n0.1,a,2,b\n"), "time_s", ["force_v"])
    assert read.signals["force_v"].tolist() == [1.0, 2.0]


def test_a_file_that_is_not_there_is_a_sentence(tmp_path: Path) -> None:
    with raises_refusal(RecordingCode.FOREIGN_UNREADABLE, "none.csv"):
        read_signals(tmp_path / "none.csv", "time_s", ["force_v"])


def test_an_empty_field_is_no_number_and_zero_is_one(tmp_path: Path) -> None:
    read = read_signals(table(tmp_path, "time_s,force_v\n0,\n1,0\n2,n/a\n"), "time_s", ["force_v"])
    assert np.isnan(read.signals["force_v"]).tolist() == [True, False, True]


def test_numbers_come_back_to_the_last_bit(tmp_path: Path) -> None:
    values = np.random.default_rng(1).normal(size=200) * 10.0 ** np.arange(-100, 100)
    values[7] = np.nan
    read = read_signals(
        table(tmp_path, write_columns({"time_s": np.arange(200) / 3, "x": values}, ";")), "time_s", ["x"]
    )
    assert np.array_equal(read.signals["x"], values, equal_nan=True)
    assert np.array_equal(read.time_s, np.arange(200) / 3)
