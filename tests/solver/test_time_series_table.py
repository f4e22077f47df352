"""Tables over time: the header's number of rows beside the file's, and numbers with a decimal comma."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from solver.errors import SolverCode
from solver.suit.suit import read_suit
from solver.time_series_table import TableHeader, read_table
from tests.refusals import raises_refusal

ROWS = "time\ta\n0\t1\n0.01\t2\n0.02\t3\n"


@pytest.mark.parametrize(
    ("line", "stated"),
    [
        ("nRows=3", 3),
        ("nRows=5", 5),
        ("nRows = 2\t\t", 2),
        ("datarows 5", 5),
        ("nRows=", None),
        ("nRows=-1", None),
        (f"nRows={'9' * 5000}", None),
    ],
)
def test_all_rows_are_read_whatever_the_header_states(tmp_path: Path, line: str, stated: int | None) -> None:
    path = tmp_path / "m.sto"
    path.write_text(f"m\nversion=1\n{line}\nnColumns=2\nendheader\n{ROWS}")
    names, table, header = read_table(path)
    assert names == ["time", "a"]
    np.testing.assert_array_equal(table[:, 1], [1, 2, 3])
    assert header == TableHeader(rows=stated)


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be", "utf-32"])
@pytest.mark.parametrize("name", ["m.sto", "m.csv"])
def test_a_table_in_utf16_is_refused_with_its_encoding(tmp_path: Path, name: str, encoding: str) -> None:
    path = tmp_path / name
    path.write_text(f"m\nendheader\n{ROWS}", encoding=encoding)
    with raises_refusal(SolverCode.MALFORMED_TABLE, naming="UTF-16"):
        read_table(path)


@pytest.mark.parametrize(("stated", "of_storage"), [(3, 3), (5, 3), (2, 2)])
def test_opensim_takes_a_cut_file_and_its_storage_no_more_rows_than_stated(
    tmp_path: Path, stated: int, of_storage: int
) -> None:
    opensim = pytest.importorskip("opensim")
    path = tmp_path / "m.sto"
    path.write_text(f"m\nversion=1\nnRows={stated}\nnColumns=2\ninDegrees=no\nendheader\n{ROWS}")
    assert opensim.Storage(str(path)).getSize() == of_storage
    assert opensim.TimeSeriesTable(str(path)).getNumRows() == len(read_table(path)[1]) == 3


@pytest.mark.parametrize(
    ("name", "names", "rows", "shown"),
    [
        ("m.csv", "time,a", ["0,00,1,5", "0,01,1,6"], "0,00"),
        ("m.csv", "time,a", ["0,1,5", "0,01,1,6"], "0,1"),
        ("m.csv", "time;a", ["0,00;1,5", "0,01;1,6"], "0,00"),
        ("m.csv", "time;a", ["0;1,5e-3", "1;1,6"], "1,5e-3"),
        ("m.sto", "time\ta", ["0,00\t-1,5", "0,01\t1,6"], "0,00"),
        ("m.mot", "time a", ["0 1,5", "1 1,6"], "1,5"),
        ("m.sto", "time\thip flexion", ["0,00\t1,5", "0,01\t1,6"], "0,00"),
        ("m.sto", "time\ta", ["0\t1", "0,01\t1,6"], "0,01"),
    ],
)
def test_a_decimal_comma_is_named(tmp_path: Path, name: str, names: str, rows: list[str], shown: str) -> None:
    head = "" if name.endswith(".csv") else "m\nendheader\n"
    (tmp_path / name).write_text("\n".join([head + names, *rows]) + "\n")
    with raises_refusal(SolverCode.MALFORMED_TABLE, naming=f"decimal comma, as in {shown};"):
        read_table(tmp_path / name)


@pytest.mark.parametrize("rows", [["0,1", "0.01,2,3"], ["0.5,1,2", "1.5,2,3"], ["0,one", "1,two"]])
def test_another_fault_is_not_called_a_decimal_comma(tmp_path: Path, rows: list[str]) -> None:
    path = tmp_path / "m.csv"
    path.write_text("\n".join(["time,a", *rows]) + "\n")
    with raises_refusal(SolverCode.MALFORMED_TABLE) as refused:
        read_table(path)
    assert "decimal comma" not in str(refused.value)


@pytest.mark.parametrize(
    ("read", "code"), [(read_table, SolverCode.UNREADABLE_TABLE), (read_suit, SolverCode.SUIT_FILE)]
)
def test_a_file_that_cannot_be_read_is_named_once(
    tmp_path: Path, read: Callable[[Path], object], code: SolverCode
) -> None:
    path = tmp_path / "missing.file"
    with raises_refusal(code) as caught:
        read(path)
    assert str(caught.value).count(str(path)) == 1
