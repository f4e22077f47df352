import json
import os
import subprocess
import sys
from enum import StrEnum
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import Mock

import pytest
from mcap.writer import Writer

from fitting.results.codes import FitErrorCode
from recordings.errors import RecordingCode
from station import __main__
from station.cli import VERBS
from station.exit_code import ENDED_BY_CTRL_C
from station.journal import read_journal
from station.messages.file_messages import ExportCode
from station.messages.setup_messages import ConfigCode, FolderCode
from station.messages.study_messages import PlanCode, StudyCode, SweepCode
from tests.station.bench.test_trial_recorder import SPEC, Rig
from tests.station.command import assert_one_sentence, assert_refused

EXAMPLE = Path(__file__).parents[2] / "station.toml"
CONFIG = str(EXAMPLE)
RECORD = ("record", "--session", "s", "--cuff", "hand", "--test", "static", "--repeat", "1")


@cache
def trial_files() -> dict[str, bytes]:
    """The recording of a trial and its checksum, by name."""
    with TemporaryDirectory() as folder:
        assert Rig().recorder().record(Path(folder), SPEC).accepted
        return {path.name: path.read_bytes() for path in Path(folder).iterdir() if not path.name.startswith(".")}


def trial_file(folder: Path) -> Path:
    for name, content in trial_files().items():
        (folder / name).write_bytes(content)
    return folder / SPEC.file_name(1)


def test_help_lists_the_verbs_in_the_order_of_their_use(station) -> None:
    ran = station("--help")
    places = [
        ran.out.index(f"\u2502 {verb} ") for verb in ("simulate", "check", "record", "info", "fit", "assess", "report")
    ]
    assert ran.code == 0
    assert places == sorted(places)


@pytest.mark.parametrize("words", [["recrod"], ["record"], [*RECORD, "--config", CONFIG, "--test", "slow"], ["info"]])
def test_wrong_usage_is_code_2(station, words: list[str]) -> None:
    assert station(*words).code == 2


def test_a_configuration_that_cannot_be_used_is_code_2(station, tmp_path: Path) -> None:
    bad = tmp_path / "bad.toml"
    bad.write_text("[daq]\nsample_rate_hz = 6000\n")
    knee = (*RECORD[:3], "--cuff", "knee", *RECORD[5:])
    assert_refused(station(*RECORD, "--config", bad), 2, ConfigCode.WRONG_VALUE)
    assert_refused(station(*RECORD, "--config", tmp_path / "none.toml"), 2, ConfigCode.MISSING)
    assert_refused(station(*knee, "--config", CONFIG), 2, ConfigCode.UNKNOWN_CUFF)


@pytest.fixture
def unreachable(tmp_path: Path) -> Path:
    """A configuration at whose ports nothing listens."""
    config = tmp_path / "station.toml"
    text = EXAMPLE.read_text(encoding="utf-8")
    config.write_text(text.replace("31763", "9").replace("22223", "9"), encoding="utf-8")
    return config


def test_missing_devices_are_refused_without_a_recording(station, unreachable: Path, tmp_path: Path) -> None:
    ran = station("record", "--session", tmp_path / "s", *RECORD[3:], "--config", unreachable)
    assert ran.code == 1
    assert ran.err.strip().splitlines()[-1].startswith("station: ")
    assert not list((tmp_path / "s").glob("*.mcap"))


@pytest.mark.parametrize("is_json", [False, True])
def test_check_names_every_device_that_does_not_answer(station, unreachable: Path, is_json: bool) -> None:
    ran = station("check", "--config", unreachable, *(["--format", "json"] if is_json else []))
    assert ran.code == 1
    if is_json:
        is_good = {line["subject"]: line["is_good"] for line in json.loads(ran.out)}
        assert is_good["disk"] and not is_good["NI Dev1"] and not all(is_good.values())
    else:
        assert "NI Dev1" in ran.out and "QTM" in ran.out and "disk" in ran.out


@pytest.mark.parametrize(
    "words", [["--test", "static"], ["--test", "bounce", "--cuff", "hand"]], ids=["no cuff", "a cuff too many"]
)
def test_a_static_test_needs_a_cuff_and_a_bounce_has_none(station, tmp_path: Path, words: list[str]) -> None:
    ran = station("record", "--config", CONFIG, "--session", tmp_path, *words)
    assert ran.code == 2 and "--cuff" in ran.err


def test_a_known_mass_is_not_negative_and_needs_a_load_cell_that_answers(
    station, unreachable: Path, tmp_path: Path
) -> None:
    assert station("check", "--config", CONFIG, "--known-mass", -2).code == 2
    ran = station("check", "--config", unreachable, "--session", tmp_path, "--known-mass", 2)
    assert_refused(ran, 1, FitErrorCode.CHECK_SHORT)


def test_a_recording_is_shown_as_a_table_and_as_json(station, tmp_path: Path) -> None:
    path = trial_file(tmp_path)
    table, plain = station("info", path), station("info", path, "--format", "json")
    assert (table.code, plain.code) == (0, 0)
    assert "/markers" in table.out
    content = json.loads(plain.out)
    assert content["complete"] is True and content["gaps"] == []
    assert set(content["topics"]["/force"]) == {"messages", "first_ns", "last_ns"}
    assert content["sync_sentence"] in table.out
    assert "load cell: no serial number, 50 kg, no calibration date" in table.out
    topics = table.out.partition("┃ stream")[0]
    rows = [line.split("│")[1:4] for line in topics.splitlines() if "│ /" in line]
    timed = {topic.strip(): seconds.strip() != "" for topic, _, seconds in rows}
    assert timed["/force"] and timed["/markers"] and not timed["/manifest"] and not timed["/streams"]


def test_a_cut_recording_is_code_3_in_info_and_recover_and_the_original_stays(station, tmp_path: Path) -> None:
    path = trial_file(tmp_path)
    content = path.read_bytes()[: path.stat().st_size * 2 // 3]
    path.write_bytes(content)
    info, recovered = station("info", path, "--format", "json"), station("recover", path, "--format", "json")
    assert (info.code, recovered.code) == (3, 3)
    assert json.loads(info.out)["complete"] is False
    assert path.read_bytes() == content
    report = json.loads(recovered.out)
    assert report["source"] == str(path) and Path(report["output"]).is_file()
    assert report["lossless"] is False and report["missing"]
    again = station("recover", path, "--output", tmp_path / "again.mcap")
    assert again.code == 3 and Path(again.out.strip()).is_file()


def test_an_export_and_a_replay_are_reported_as_json(station, tmp_path: Path) -> None:
    path, broken = trial_file(tmp_path), tmp_path / "cuff-hand_test-static_run-2.mcap"
    broken.write_text("no recording\n")
    ran = station("export", "--session", tmp_path, "--to", "csv", "--output", tmp_path / "out", "--format", "json")
    result = json.loads(ran.out)
    assert ran.code == 3
    assert len(result["written"]) == 3 and all(Path(name).stem.startswith(path.stem) for name in result["written"])
    assert [refused["code"] for refused in result["refused_codes"]] == [ExportCode.NOT_EXPORTED]
    assert broken.name in result["refused"][0]
    ran = station("replay", path, "--session", tmp_path / "again", "--speed", "20", "--format", "json")
    result = json.loads(ran.out)
    assert set(result) == {"path", "accepted", "lost_samples", "sentence", "codes", "origin"}
    assert Path(result["path"]).is_file() and result["sentence"] in ran.err
    assert json.loads(station("replay", path, "--speed", "20", "--format", "json").out)["path"] is None


@pytest.mark.parametrize(("typed", "words"), [("station ", set(VERBS)), ("station rec", {"record", "recover"})])
def test_the_shell_completes_verbs(station, monkeypatch: pytest.MonkeyPatch, typed: str, words: set[str]) -> None:
    """The request of the script that `station --install-completion` installs."""
    for name, value in {"_STATION_COMPLETE": "complete_bash", "COMP_WORDS": typed, "COMP_CWORD": "1"}.items():
        monkeypatch.setenv(name, value)
    assert set(station().out.split()) == words


def test_a_file_that_is_not_a_recording_is_refused_with_its_name(station, tmp_path: Path) -> None:
    text, foreign, empty = (tmp_path / name for name in ("text.mcap", "foreign.mcap", "empty.mcap"))
    text.write_text("not a recording\n")
    empty.touch()
    writer = Writer(str(foreign))
    writer.start()
    writer.finish()
    for path in (text, foreign, empty, tmp_path / "missing.mcap"):
        assert_one_sentence(station("info", path), 1, path.name)


def test_a_folder_that_is_empty_or_does_not_exist_is_neither_fitted_nor_reported_nor_created(
    station, tmp_path: Path
) -> None:
    missing = tmp_path / "missing.mcap"
    assert_refused(station("fit", missing), 1, FolderCode.NOT_A_FOLDER)
    assert_refused(station("fit", tmp_path), 1, FolderCode.NO_RECORDING)
    assert_refused(station("report", tmp_path), 1, FolderCode.NOTHING_TO_REPORT)
    for more in ((), ("--normative", tmp_path / "normative.json")):
        assert_refused(station("report", missing, *more), 1, FolderCode.NOT_A_FOLDER)
    assert not missing.exists()


def test_a_motion_without_a_coordinate_is_refused(station, tmp_path: Path) -> None:
    motion = tmp_path / "short.mot"
    motion.write_text("m\nnRows=2\nnColumns=2\ninDegrees=yes\nendheader\ntime\tclav_prot\n0\t1\n0.01\t1\n")
    ran = station("rmr", "--motion", motion, "--output", tmp_path / "a.csv")
    assert ran.code == 1 and ran.err.strip().splitlines()[-1].startswith("station: ")
    assert not (tmp_path / "a.csv").exists()


@pytest.mark.parametrize(
    ("words", "option", "code"),
    [
        (["report", "."], "--normative", StudyCode.WRONG_NORMATIVE),
        (["plan", "--output", "planned"], "", PlanCode.UNREADABLE),
        (["sweep", "--output", "sweep"], "", SweepCode.UNREADABLE),
    ],
)
def test_a_file_that_does_not_exist_is_named_once(
    station, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: list[str], option: str, code: StrEnum
) -> None:
    monkeypatch.chdir(tmp_path)
    ran = station(*words, *filter(None, [option]), "absent.file")
    assert_refused(ran, 1, code)
    assert ran.err.count("absent.file") == 1


def test_the_fit_lists_a_rejected_recording_with_the_reason_and_needs_another_one(station, tmp_path: Path) -> None:
    path = trial_file(tmp_path)
    assert station("judge", path, "--redo", "the wearer coughed").code == 0
    ran = station("fit", tmp_path)
    assert (ran.code, ran.error) == (1, FolderCode.NOT_USABLE) and "the wearer coughed" in ran.err
    assert station("judge", path).code == 0
    assert "the wearer coughed" not in station("fit", tmp_path).err


def test_only_an_existing_recording_is_judged_and_a_file_that_is_none_rejected_alone(station, tmp_path: Path) -> None:
    """Rejecting it is the decision that a session waits for, which has found the file in its folder."""
    (tmp_path / "report.html").touch()
    for name in ("none.mcap", "report.html"):
        assert station("judge", tmp_path / name).code == 2
    empty = tmp_path / "empty.mcap"
    empty.touch()
    assert_one_sentence(station("judge", empty), 1, RecordingCode.EMPTY)
    assert not (tmp_path / "session.jsonl").exists()
    assert station("judge", empty, "--redo", "the disk was full").code == 0


@pytest.mark.parametrize("is_cut", [True, False], ids=["cut", "damaged"])
def test_a_recording_that_is_cut_or_damaged_is_accepted(station, tmp_path: Path, is_cut: bool) -> None:
    path = trial_file(tmp_path)
    content = path.read_bytes()
    middle = len(content) * 2 // 3
    path.write_bytes(content[:middle] if is_cut else content[:middle] + b"damage" + content[middle + 6 :])
    assert station("judge", path).code == 0
    assert read_journal(tmp_path).verdicts[path.name].choice == "accept"


def test_the_error_of_a_file_that_cannot_be_written_names_it_and_not_its_draft(station, tmp_path: Path) -> None:
    path = trial_file(tmp_path)
    obstacle = tmp_path / f"{path.stem}_force.csv"
    obstacle.mkdir()
    ran = station("export", path, "--to", "csv", "--output", tmp_path)
    assert_one_sentence(ran, 1, str(obstacle), "Is a directory")
    assert "Errno" not in ran.err
    assert ".draft" not in ran.err
    assert not list(tmp_path.glob(".draft*"))


def test_ctrl_c_while_the_verbs_are_imported_is_code_130_and_one_sentence(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delitem(sys.modules, "station.cli")

    def press_ctrl_c(name: str, *_: object) -> None:
        if name == "station.cli":
            raise KeyboardInterrupt

    monkeypatch.setattr(sys, "meta_path", [Mock(spec=["find_spec"], find_spec=press_ctrl_c), *sys.meta_path])
    with pytest.raises(SystemExit) as ended:
        __main__.main()
    assert ended.value.code == 130
    assert capsys.readouterr() == ("", f"{ENDED_BY_CTRL_C}\n")


def test_the_module_that_handles_ctrl_c_imports_no_verb_itself() -> None:
    imported = "import sys, station.__main__; sys.exit('typer' in sys.modules or 'station.cli' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", imported], check=False).returncode == 0  # noqa: S603


COMMAND = [sys.executable, "-c", "from station.cli import main; main()"]


def test_a_reader_that_closes_early_changes_no_exit_code_and_is_not_reported(tmp_path: Path) -> None:
    cut = trial_file(tmp_path)
    cut.write_bytes(cut.read_bytes()[:-2000])
    reader, writer = os.pipe()
    os.close(reader)
    ran = subprocess.run([*COMMAND, "info", str(cut)], stdout=writer, stderr=subprocess.PIPE, check=False)  # noqa: S603
    os.close(writer)
    assert (ran.returncode, ran.stderr) == (3, b"")


def test_output_is_utf_8_on_a_terminal_of_another_encoding_and_a_file_name_that_is_not_has_its_bytes(
    tmp_path: Path,
) -> None:
    folder = tmp_path / os.fsdecode("ẋ mäßig".encode() + b"\xff" * (sys.platform == "linux"))
    folder.mkdir()
    path = trial_file(folder)
    command, environment = [*COMMAND, "export", str(path), "--to", "trc"], {**os.environ, "PYTHONIOENCODING": "cp1252"}
    ran = subprocess.run(command, env=environment, capture_output=True, check=False)  # noqa: S603
    assert ran.returncode == 0, ran.stderr
    assert os.fsencode(path.with_suffix(".trc")) in ran.stdout
