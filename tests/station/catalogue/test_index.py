"""The catalogue of a folder of sessions: its rows, its participants, and queries."""

import json
import os
import shutil
import sys
from collections.abc import Callable
from datetime import datetime
from pathlib import Path

import duckdb
import pytest

from station.catalogue.index import (
    CATALOGUE_FILE,
    CatalogueError,
    read_participants,
    update_catalogue,
    write_participants,
)
from station.catalogue.query import SessionFilter, known_participants, list_cuffs, run_sql
from station.checksums import JOURNAL_FILE
from station.journal import Recorded, Setup, write_recorded, write_setup
from station.messages.setup_messages import FolderCode
from station.messages.study_messages import CatalogueCode
from station.session.open_session import list_sessions
from tests.refusals import raises_refusal
from tests.station.command import Station, assert_refused
from tests.station.study.synthetic_sessions import write_sessions


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four volunteers, one operator, two cuffs, two donnings, and the catalogue."""
    folder = tmp_path_factory.mktemp("catalogue")
    write_sessions(folder, 4, operators=1)
    update_catalogue(folder, folder / CATALOGUE_FILE)
    return folder


@pytest.fixture
def folder(original: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(original, tmp_path / "sessions"))


def test_the_values_are_those_of_the_files_and_filters_combine(original: Path) -> None:
    rows = list_cuffs(original / CATALOGUE_FILE, SessionFilter(subject="P02", cuff="hand"))
    document = json.loads((original / "sub-P02_ses-1" / "cuffs.json").read_text(encoding="utf-8"))
    donnings = document["cuffs"]["hand"]["donnings"]
    assert rows["stiffness_n_per_m"].tolist() == [one["stiffness_n_per_m"]["value"] for one in donnings.values()]
    trials = run_sql(original / CATALOGUE_FILE, "SELECT count(*) AS n FROM trials WHERE test = 'static'")
    assert trials["n"].tolist() == [4 * 2 * 2 * 2]  # sessions, cuffs, donnings, repeats
    then = datetime.fromisoformat("2000-01-01")
    for found, count in (
        (SessionFilter(operator="A0", cuff="tube", origin="measured"), 8),
        (SessionFilter(before=then), 0),
        (SessionFilter(since=then), 16),
    ):
        assert len(list_cuffs(original / CATALOGUE_FILE, found)) == count


def test_only_what_changed_is_read_again_and_damage_is_listed(folder: Path) -> None:
    path, cuffs = folder / CATALOGUE_FILE, folder / "sub-P03_ses-1" / "cuffs.json"
    sound = cuffs.read_bytes()
    cuffs.write_text("{", encoding="utf-8")
    assert list(update_catalogue(folder, path).unreadable) == ["sub-P03_ses-1"]
    cuffs.write_bytes(sound)
    assert update_catalogue(folder, path).unreadable == {}
    path = folder / CATALOGUE_FILE
    assert update_catalogue(folder, path).read == 0
    shutil.rmtree(folder / "sub-P01_ses-1")
    changed = folder / "sub-P02_ses-1" / "cuffs.json"
    changed.write_text(changed.read_text(encoding="utf-8").replace('"hand"', '"glove"'), encoding="utf-8")
    indexed = update_catalogue(folder, path)
    assert (indexed.sessions, indexed.read, indexed.removed) == (3, 1, 1)
    assert set(list_cuffs(path, SessionFilter(subject="P02"))["cuff"]) == {"glove", "tube"}
    assert set(list_cuffs(path, SessionFilter())["subject"]) == {"P02", "P03", "P04"}


def test_participants_go_in_and_out(folder: Path, tmp_path: Path) -> None:
    (folder / "participants.tsv").write_text("participant_id\tage\tsex\nsub-P01\t31\tn/a\nsub-P09\t44\tf\n")
    path = folder / CATALOGUE_FILE
    update_catalogue(folder, path)
    joined = run_sql(
        path, "SELECT subject, age, sex FROM sessions JOIN participants ON participant_id = 'sub-' || subject"
    )
    assert joined.values.tolist() == [["P01", "31", None]]
    write_participants(tmp_path / "out.tsv", *known_participants(path))
    written = read_participants(tmp_path / "out.tsv")
    assert list(written) == ["sub-P01", "sub-P02", "sub-P03", "sub-P04", "sub-P09"]
    assert written["sub-P09"] == {"participant_id": "sub-P09", "age": "44", "sex": "f"}
    assert written["sub-P02"]["age"] is None


@pytest.mark.parametrize(
    "content", ["notes of mine\n", "participant_id\tage\nsub-P01\t30\n", "participant_id\nsub-P02\n"]
)
def test_a_file_whose_values_would_be_lost_is_not_replaced_by_the_participants(tmp_path: Path, content: str) -> None:
    path = tmp_path / "out.tsv"
    path.write_text(content, encoding="utf-8")
    with raises_refusal(CatalogueCode.WRONG_PARTICIPANTS, "out.tsv", kind=CatalogueError):
        write_participants(path, ["P01"], {})
    assert path.read_text(encoding="utf-8") == content
    path.write_text("participant_id\nsub-P01\n", encoding="utf-8")
    write_participants(path, ["P01", "P02"], {"sub-P01": {"participant_id": "sub-P01", "age": "30"}})
    assert "sub-P02" in path.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    "text",
    [
        *("", "subject\tage\n", "participant_id\tage\tage\n", "participant_id\tage\nsub-1\n"),
        *(f"participant_id\tage\nsub-P01\t{age}\n" for age in ("3\r0", "\0", "9" * 200_000)),
    ],
    ids=["empty", "no participants", "a title twice", "a row too short", "a row of two", "a null", "too long"],
)
def test_another_table_is_no_participants_tsv(text: str, tmp_path: Path) -> None:
    (tmp_path / "participants.tsv").write_text(text, encoding="utf-8", newline="")
    with raises_refusal(CatalogueCode.WRONG_PARTICIPANTS, kind=CatalogueError):
        update_catalogue(tmp_path, tmp_path / "out" / CATALOGUE_FILE)
    assert not (tmp_path / "out").exists()


NO_QUERY = (
    *("", ";", "-- nothing", "DELETE FROM sessions", "SELECT 1; DELETE FROM sessions", "SET threads = 1"),
    *("CALL enable_logging(storage='file')", "SELECT * FROM enable_logging()", "COPY sessions TO 'sessions.csv'"),
    *("ATTACH 'other.duckdb'", "INSTALL json", "LOAD json", "PRAGMA version", "CHECKPOINT"),
    *("EXPORT DATABASE 'exported'", "CREATE TEMP TABLE t AS SELECT 1", "SELECT * FROM read_csv('/etc/hosts')"),
)
WRONG_SQL = (
    *("SELEC", "\udcff", "SELECT nothing FROM sessions", "SELECT * FROM '/etc/hosts'", "SELECT * FROM original"),
    *("SELECT DATE 'infinity'", "WITH gone AS (DELETE FROM sessions RETURNING *) SELECT * FROM gone"),
)


@pytest.mark.parametrize(
    ("sql", "code"),
    [(sql, CatalogueCode.NO_QUERY) for sql in NO_QUERY] + [(sql, CatalogueCode.WRONG_SQL) for sql in WRONG_SQL],
)
def test_sql_that_is_not_one_query_or_fails_is_refused(sql: str, code: CatalogueCode, original: Path) -> None:
    with raises_refusal(code, kind=CatalogueError):
        run_sql(original / CATALOGUE_FILE, sql)


def test_values_that_json_does_not_have_are_printed_as_text(folder: Path, station: Station) -> None:
    identity = "12345678-1234-1234-1234-123456789012"
    ran = station(
        "catalogue", folder, "--sql", f"SELECT UUID '{identity}' AS id, '\\xFF'::BLOB AS b", "--format", "json"
    )
    assert json.loads(ran.out)[0]["id"] == identity


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("repeat", 2**62),
        ("lost_samples", 2**63),
        ("at", "0001-01-01T00:00:00+00:00"),
        ("at", "2026-02-30T10:00:00+00:00"),
        ("at", "9999-12-31T23:59:59-12:00"),
    ],
)
def test_a_session_with_an_absurd_value_is_listed_and_hides_no_other(folder: Path, key: str, value: object) -> None:
    strange = folder / "strange"
    write_setup(strange, Setup("P09", "ab", ("hand",), 1))
    write_recorded(strange, Recorded("a.mcap", "hand", "static", 1, "1", True, 0, ""))
    lines = [json.loads(line) | {key: value} for line in (strange / JOURNAL_FILE).read_text().splitlines()]
    (strange / JOURNAL_FILE).write_text("".join(json.dumps(line) + "\n" for line in lines))
    indexed = update_catalogue(folder, folder / CATALOGUE_FILE)
    assert list(indexed.unreadable) == ["strange"] and str(value) in indexed.unreadable["strange"]
    assert len(run_sql(folder / CATALOGUE_FILE, "SELECT session FROM sessions")) == 5
    list_sessions(folder)


@pytest.mark.parametrize("end", ["\r", "\r\n"])
def test_participants_have_any_line_ends(tmp_path: Path, end: str) -> None:
    path = tmp_path / "participants.tsv"
    path.write_bytes(f"participant_id\tage{end}sub-P01\t30{end}".encode())
    assert read_participants(path) == {"sub-P01": {"participant_id": "sub-P01", "age": "30"}}


def test_an_interrupted_first_build_leaves_nothing(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = folder / CATALOGUE_FILE
    before = list_cuffs(path, SessionFilter())
    path.unlink()

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched, pytest.raises(KeyboardInterrupt):
        patched.setattr("station.catalogue.index.read_rows", interrupt)
        update_catalogue(folder, path)
    assert not path.exists()
    assert update_catalogue(folder, path).read == 4
    assert list_cuffs(path, SessionFilter()).equals(before)


def created(path: Path) -> None:
    duckdb.connect(str(path)).close()


def cut(path: Path) -> None:
    created(path)
    path.write_bytes(path.read_bytes()[:5000])


def damaged(path: Path) -> None:
    created(path)
    path.write_bytes(path.read_bytes()[:64] + bytes(20_000))


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no limit of the size of a file")
@pytest.mark.parametrize("bytes_free", [100_000, 300_000, 600_000])
def test_a_disk_that_fills_during_the_first_build_leaves_nothing(folder: Path, bytes_free: int) -> None:
    import resource

    path = folder / CATALOGUE_FILE
    path.unlink()
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (bytes_free, before[1]))
    try:
        with raises_refusal(CatalogueCode.NOT_CREATED, kind=CatalogueError):
            update_catalogue(folder, path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert not list(folder.glob("*duckdb*"))
    assert update_catalogue(folder, path).read == 4


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere, a folder has no such name")
def test_a_session_whose_name_is_not_utf_8_hides_no_other(folder: Path) -> None:
    name = os.fsdecode(b"caf\xe9")
    (folder / "sub-P01_ses-1").rename(folder / name)
    (folder / name / JOURNAL_FILE).write_text("{")
    indexed = update_catalogue(folder, folder / CATALOGUE_FILE)
    assert (indexed.sessions, indexed.read) == (4, 1)
    (folder / name / JOURNAL_FILE).write_text("{}\n")
    assert list(update_catalogue(folder, folder / CATALOGUE_FILE).unreadable) == [r"caf\udce9"]
    assert update_catalogue(folder, folder / CATALOGUE_FILE).read == 0


@pytest.mark.parametrize("leave", [Path.touch, created, cut, damaged, lambda path: path.write_bytes(bytes(4096))])
def test_what_is_left_of_an_interrupted_build_is_built_anew(folder: Path, leave: Callable[[Path], object]) -> None:
    path = folder / "new.duckdb"
    leave(path)
    assert update_catalogue(folder, path, is_rebuilt=leave is damaged).read == 4


def test_another_database_is_not_overwritten(folder: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.duckdb"
    with duckdb.connect(str(other)) as connection:
        connection.execute("CREATE TABLE own (x INTEGER)")
    with raises_refusal(CatalogueCode.OTHER_DATABASE, kind=CatalogueError):
        update_catalogue(folder, other)
    text = tmp_path / "notes.txt"
    text.write_text("mine", encoding="utf-8")
    with raises_refusal(CatalogueCode.OTHER_DATABASE, kind=CatalogueError):
        update_catalogue(folder, text, is_rebuilt=True)
    assert text.read_text(encoding="utf-8") == "mine"


def test_ctrl_c_in_a_statement_is_no_error_of_the_catalogue(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(*_: object) -> None:
        raise RuntimeError("Query interrupted")  # by DuckDB

    path = folder / CATALOGUE_FILE
    update_catalogue(folder, path)
    before = path.read_bytes()
    monkeypatch.setattr("station.catalogue.index._replace_participants", interrupt)
    with pytest.raises(KeyboardInterrupt):
        update_catalogue(folder, path, is_rebuilt=True)
    assert path.read_bytes() == before
    monkeypatch.setattr("station.catalogue.query._ensure_query", interrupt)
    with pytest.raises(KeyboardInterrupt):
        run_sql(path, "SELECT 1")


def test_the_verb_prints_rows_for_people_and_programs(folder: Path, station: Station) -> None:
    ran = station("catalogue", folder, "--cuff", "hand", "--subject", "P01", "--format", "json")
    assert ran.code == 0, ran.err
    assert [row["donning"] for row in json.loads(ran.out)] == ["1", "2"]
    listed = station("catalogue", folder, "--sql", "SELECT count(*) AS sessions FROM sessions")
    assert listed.out.split() == ["sessions", "4"]
    assert_refused(station("catalogue", folder / "missing"), 1, FolderCode.NOT_A_FOLDER)
    days = ("--since", "2027-01-01", "--output", folder / "none.duckdb", "--before")
    assert [station("catalogue", folder, *days, before).code for before in ("2020-01-01", "2027-01-01")] == [2, 2]
    assert not (folder / "none.duckdb").exists()
    unknown = "SELECT NULL AS subject, CAST(NULL AS DOUBLE) AS stiffness, CAST(NULL AS TIMESTAMP) AS begun"
    assert station("catalogue", folder, "--sql", unknown).out.split()[3:] == ["-", "-", "-"]
    empty = station("catalogue", folder, "--cuff", "none")
    assert (empty.code, empty.out) == (0, "")


def test_a_catalogue_that_cannot_be_created_is_refused_as_such(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def connect(path: str) -> None:
        raise duckdb.IOException(f'IO Error: Cannot open file "{path}": Permission denied')

    monkeypatch.setattr(duckdb, "connect", connect)
    with raises_refusal(CatalogueCode.NOT_CREATED, kind=CatalogueError):
        update_catalogue(folder, folder / "new.duckdb")


def test_the_session_of_the_folder_itself_and_a_renamed_one_are_found(folder: Path) -> None:
    (folder / "sub-P04_ses-1").rename(folder / "renamed")
    path = folder / CATALOGUE_FILE
    indexed = update_catalogue(folder, path)
    assert (indexed.read, indexed.removed) == (1, 1)
    assert update_catalogue(folder / "renamed", folder / "own.duckdb").sessions == 1
    assert set(run_sql(folder / "own.duckdb", "SELECT session FROM sessions")["session"]) == {"."}
