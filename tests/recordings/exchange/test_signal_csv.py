from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from recordings.errors import ForeignFile
from recordings.exchange.signal_csv import read_signals, write_columns


def table(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "daq.csv"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    "text",
    [
        "time_s,force_v\n0.0,1.5\n0.1,1.25\n",
        "\ufefftime_s,force_v\r\n0.0,1.5\r\n0.1,1.25\r\n\r\n",
        "# made by hand\n\ntime_s;note;force_v\n0,0;a;1,5\n0,1;b;1,25\n",
        '"time_s"\t"force_v"\n0\t1.5\n1e-1\t1.25\n',
    ],
    ids=["plain", "with a byte order mark and CR", "of a country with decimal commas", "quoted, with tabs"],
)
def test_a_table_is_read_whatever_program_wrote_it(tmp_path: Path, text: str) -> None:
    read = read_signals(table(tmp_path, text), "time_s", ["force_v", "sync_v"])
    assert read.time_s.tolist() == [0.0, 0.1]
    assert {name: values.tolist() for name, values in read.signals.items()} == {"force_v": [1.5, 1.25]}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is empty"),
        ("\n \n", "is empty"),
        ("time,force\n0,1\n", "has no column time_s, only time, force"),
        ("0.0,1.5\n0.1,1.5\n", "has no column time_s, only 0.0, 1.5"),
        ("time_s,force_v\n", "holds 0 samples"),
        ("time_s,force_v\n0,1\n0.1,high\n", "line 3, has 'high' in column 2, expected a number"),
        ("time_s,force_v\n0,1\n,1\n", "no number in line 3"),
        ("time_s,force_v\n0,1\n0,1\n", "has 0 s again in line 3"),
        ("time_s,force_v\n1,1\n0,1\n", "has 0 s after 1 s in line 3"),
        ("PK\0\0", "is no text file"),
    ],
)
def test_a_table_that_is_none_is_refused_in_a_sentence(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(ForeignFile, match=words):
        read_signals(table(tmp_path, text), "time_s", ["force_v"])


def test_a_file_that_is_not_there_is_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(ForeignFile, match=r"none\.csv cannot be read: No such file"):
        read_signals(tmp_path / "none.csv", "time_s", ["force_v"])


def test_an_empty_field_is_no_number_and_zero_is_one(tmp_path: Path) -> None:
    read = read_signals(table(tmp_path, "time_s,force_v\n0,\n1,0\n2\n"), "time_s", ["force_v"])
    assert np.isnan(read.signals["force_v"]).tolist() == [True, False, True]


def test_numbers_come_back_to_the_last_bit(tmp_path: Path) -> None:
    values = np.random.default_rng(1).normal(size=200) * 10.0 ** np.arange(-100, 100)
    values[7] = np.nan
    read = read_signals(
        table(tmp_path, write_columns({"time_s": np.arange(200) / 3, "x": values}, ";")), "time_s", ["x"]
    )
    assert np.array_equal(read.signals["x"], values, equal_nan=True)
    assert np.array_equal(read.time_s, np.arange(200) / 3)
