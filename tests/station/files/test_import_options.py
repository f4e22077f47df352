"""Options of `station import` that cannot be, or that are missing, are wrong usage: nothing is written."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from recordings.contents import contents_of
from recordings.reader import read_manifest
from station.messages.codes import InputCode
from station.messages.file_codes import ImportCode
from station.messages.setup_codes import ConfigCode
from tests.station.command import assert_refused
from tests.station.foreign import import_by_verb, static_and_dynamic


@pytest.fixture
def static(tmp_path: Path) -> tuple[Path, Path]:
    """Files of a static test with a sync line."""
    truth, _ = static_and_dynamic()
    return truth.write_csv(tmp_path / "daq.csv"), truth.write_markers(tmp_path / "trial.tsv")


def test_wrong_usage_is_code_2(station, static: tuple[Path, Path], tmp_path: Path) -> None:
    other = static[1].rename(static[1].with_suffix(".xlsx"))
    session = tmp_path / "s"
    assert_refused(import_by_verb(station, (static[0], other), session), 2, ImportCode.MARKER_FORMAT)
    files = static[0].with_suffix(".tdms"), other.rename(static[1])
    assert_refused(import_by_verb(station, files, session), 2, ImportCode.FORCE_FORMAT)
    assert_refused(import_by_verb(station, static, session, "--test", "bounce"), 2, ImportCode.UNUSED_OPTION)
    assert_refused(import_by_verb(station, static, session, "--cuff", "knee"), 2, ConfigCode.UNKNOWN_CUFF)
    for wrong in (("--lag-sd-s", "-1"), ("--lag-s", "nan"), ("--lag-s", "inf"), ("--lag-sd-s", "inf")):
        assert import_by_verb(station, static, session, *wrong).code == 2
    assert not session.exists()


@pytest.mark.parametrize("start", ["9999-12-31T23:59:59", "2262-01-01", "1969-12-31", "0001-01-01"])
def test_a_start_that_a_recording_cannot_hold_is_wrong_usage(
    station, static: tuple[Path, Path], tmp_path: Path, start: str
) -> None:
    ran = import_by_verb(station, static, tmp_path / "s", "--start", start)
    assert_refused(ran, 2, ImportCode.START_OUT_OF_RANGE)
    assert not list(tmp_path.glob("s/*"))


@pytest.mark.parametrize("start", ["2261-12-31T23:59:59", "1970-01-01"])
def test_the_first_and_the_last_start_are_recorded(
    station, static: tuple[Path, Path], tmp_path: Path, start: str
) -> None:
    ran = import_by_verb(station, static, tmp_path / "s", "--start", start)
    assert ran.code == 0, ran.err
    recorded_ns = read_manifest(Path(ran.out.strip())).start_utc_ns
    expected = np.datetime64(start, "ns").astype(np.int64)
    assert recorded_ns == expected
    assert not contents_of(Path(ran.out.strip())).shortfalls


@pytest.mark.parametrize("option", ["--session", "--cuff", "--test", "--force"])
def test_the_option_that_an_import_lacks_is_named(station, static: tuple[Path, Path], option: str) -> None:
    given = {"--session": "s", "--cuff": "hand", "--test": "static", "--force": static[0]}
    words = [word for name, value in given.items() if name != option for word in (name, value)]
    ran = station("import", "--mocap", static[1], *words)
    assert_refused(ran, 2, ImportCode.INCOMPLETE_COMMAND)
    assert f"lacks {option};" in ran.err


@pytest.mark.parametrize("place", ["file", "file/below"])
def test_a_session_that_is_a_file_is_wrong_usage(
    station, static: tuple[Path, Path], tmp_path: Path, place: str
) -> None:
    (tmp_path / "file").write_text("kept")
    assert_refused(import_by_verb(station, static, tmp_path / place), 2, InputCode.OUTPUT_IS_FILE)
    assert (tmp_path / "file").read_text() == "kept"
