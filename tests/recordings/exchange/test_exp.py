"""The .exp files of Seth et al. (2019): read as they are, refused where rate, channels or frames are missing."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest

from recordings.errors import RecordingCode
from recordings.exchange.exp import read_exp
from tests.conftest import SHARED
from tests.refusals import raises_refusal

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


def written(folder: Path, text: str) -> Path:
    path = folder / "trial.exp"
    path.write_text(text, encoding="utf-8")
    return path


def test_header_and_rows_are_read(tmp_path: Path) -> None:
    read = read_exp(written(tmp_path, TEXT))
    assert read.names == ("AD", "MD")
    assert read.time_s.tolist() == [0.0, 0.001, 0.002]
    assert read.signals["MD"].tolist() == [-0.261841, -0.261536, 0.25]
    assert read.units == {"AD": "", "MD": ""}


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


def test_bare_numbers_need_a_rate_and_labels(tmp_path: Path) -> None:
    path = written(tmp_path, "0.5\t1.5\n-0.5\t2.5\n")
    with raises_refusal(RecordingCode.FOREIGN_NO_HEADER):
        read_exp(path)
    read = read_exp(path, 1000.0, ["AD", "MD"])
    assert (read.time_s.tolist(), read.signals["MD"].tolist()) == ([0.0, 0.001], [1.5, 2.5])


@pytest.mark.shared
@pytest.mark.parametrize(("trial", "rows"), [("FLX01", 7940), ("ABD02", 8460), ("SHRUG01", 4620)])
def test_the_public_trials_are_read_as_numpy_reads_them(tmp_path: Path, trial: str, rows: int) -> None:
    raw = gzip.decompress((SHARED / "markers" / f"{trial}_emg.exp.gz").read_bytes())
    path = tmp_path / f"{trial}.exp"
    path.write_bytes(raw)
    labels = [
        "AD",
        "MD",
        "PD",
        "TS",
        "TM",
        "TI",
        "Infra",
        "SA",
        "LatD",
        "PM_Sternal",
        "PM_Clav",
        "TMajor",
        "Bic",
        "Tric",
    ]
    read = read_exp(path, 1000.0, labels)
    assert (list(read.names), len(read.time_s), read.time_s[-1]) == (labels, rows, (rows - 1) / 1000)
    whole = np.genfromtxt(path, skip_header=0 if trial == "SHRUG01" else 9)
    np.testing.assert_array_equal(np.column_stack(list(read.signals.values())), whole[:, -14:])
