"""EMG in columns of text: the headers of the common programs, and what is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from recordings.errors import RecordingCode
from recordings.exchange.delimited_emg import read_delimited_emg
from recordings.exchange.sample_tables import SignalTable
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
    ids=[
        "plain",
        "semicolons, ms, decimal commas",
        "units behind names",
        "quoted with commas",
        "counter, tabs at ends",
    ],
)
def test_titles_give_time_channels_and_units(
    tmp_path: Path, text: str, signals: dict[str, list[float]], units: list[str]
) -> None:
    found = read(tmp_path, text)
    assert found.time_s.tolist() == [0.0, 0.001]
    assert {name: values.tolist() for name, values in found.signals.items()} == signals
    assert list(found.units.values()) == units


def test_delsys_sensors_on_another_clock_are_left_out_and_named(tmp_path: Path) -> None:
    found = read(tmp_path, DELSYS)
    assert {name: values.tolist() for name, values in found.signals.items()} == {
        "EMG1": [0.1, 0.3, 0.5],
        "EMG 2, left": [0.2, 0.4, 0.6],
    }
    assert found.units == {"EMG1": "mV", "EMG 2, left": "V"}
    assert "ACC 1" in found.names


@pytest.mark.parametrize(
    "titles", ["0.1\t0.2\n0.3\t0.4\n", "SAMPLE\tTIME\tAD\tMD\n1\t0\t0.1\t0.2\n2\t0.0005\t0.3\t0.4\n"]
)
def test_qtm_s_analog_export_has_its_rate_and_names_in_the_header(tmp_path: Path, titles: str) -> None:
    found = read(tmp_path, QTM.format(rates="2000\t2000", titles=titles))
    assert found.time_s.tolist() == [0.0, 0.0005]
    assert {name: values.tolist() for name, values in found.signals.items()} == {"AD": [0.1, 0.3], "MD": [0.2, 0.4]}


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
