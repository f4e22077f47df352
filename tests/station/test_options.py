"""Options and exit codes that are the same in every verb."""

from __future__ import annotations

import json
from importlib.metadata import version
from pathlib import Path
from typing import get_type_hints

import pytest
import typer

from station.cli import app
from tests.station.command import assert_one_sentence
from tests.station.test_cli import CONFIG, trial_file


def test_the_version_is_shown(station) -> None:
    ran = station("--version")
    assert (ran.code, ran.out.split()) == (0, ["cuffstation", version("cuffstation")])


def test_a_recording_is_not_rejected_without_a_reason(station, tmp_path: Path) -> None:
    path = trial_file(tmp_path)
    for reason in ("", "  "):
        ran = station("judge", path, "--redo", reason)
        assert ran.code == 2 and "--redo" in ran.err
    assert not (tmp_path / "session.jsonl").exists()
    assert station("judge", path).code == 0


def test_a_complete_file_is_its_own_recovery(station, tmp_path: Path) -> None:
    path = trial_file(tmp_path)
    ran = station("recover", path)
    assert ran.code == 0 and ran.out.strip() == str(path)
    report = json.loads(station("recover", path, "--format", "json").out)
    assert (report["output"], report["lossless"], report["missing"]) == (str(path), True, [])
    assert [file.name for file in tmp_path.glob("*.mcap")] == [path.name]


FLOATS = [
    (verb, option.opts[0])
    for verb, command in typer.main.get_command(app).commands.items()
    for option in command.params
    if "float" in str(get_type_hints(command.callback)[option.name])
]
OTHER_FORMS = [("scale", "--body-mass", "nan"), ("ik", "--from", "-inf"), ("id", "--cutoff-hz", "1e999")]


@pytest.mark.parametrize(("verb", "option", "value"), [(*option, "inf") for option in FLOATS] + OTHER_FORMS)
def test_a_number_that_is_not_finite_is_wrong_usage_in_every_verb(station, verb: str, option: str, value: str) -> None:
    ran = station(verb, option, value)
    assert ran.code == 2
    assert f"{option}'" in ran.err and f"finite number, found {value}" in " ".join(ran.err.split())


@pytest.mark.parametrize(
    "words",
    [
        ["simulate", "--config", CONFIG],
        ["record", "--config", CONFIG, "--session", "here", "--test", "static"],
        ["import", "--config", CONFIG, "--session", "here", "--test", "static", "--force", "a.csv", "--mocap", "a.tsv"],
        ["assess", "--cuffs", "cuffs.json", "--output", "here"],
        ["optimise", "--cuffs", "cuffs.json", "--output", "here"],
        ["export", "--osim", "--output", "suited.osim"],
        ["export", "--osim", "--output", "suited.osim", "--cuffs", "cuffs.json"],
        ["sweep", "plan.toml", "--output", "here"],
    ],
    ids=lambda words: words[0],
)
def test_an_unknown_cuff_is_wrong_usage_in_every_verb(
    station, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: list[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cuffs.json").write_text('{"cuffs": {}}')
    (tmp_path / "plan.toml").write_text('every = 100\n[vary]\ncuffs = "cuffs.json"\ncuff = "knee"\n')
    ports = '[daq]\ngrpc_target = "127.0.0.1:0"\n[mocap]\nport = 0\n'
    (tmp_path / "none.toml").write_text(
        ports + '[cuffs.hand]\nanchor_markers = ["a", "b", "c"]\ncuff_markers = ["d"]\n'
    )
    words = ["none.toml" if word == CONFIG else word for word in words]
    ran = station(*words, *(() if words[0] == "sweep" else ("--cuff", "knee")))
    assert_one_sentence(ran, 2, "knee")


@pytest.mark.parametrize("words", [("rmr",), ("id", "--motion", "lift.csv"), ("ik", "--model", "bundled")])
@pytest.mark.parametrize("output", ["folder.csv", "file/out.csv"])
def test_an_output_that_cannot_be_a_file_is_wrong_usage_before_anything_is_computed(
    station, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...], output: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder.csv").mkdir()
    (tmp_path / "file").write_text("")
    ran = station(*words, "--output", output)
    assert ran.code == 2
    assert Path(output).parts[0] in ran.err


@pytest.mark.parametrize(("given", "has_glenoid"), [((), True), (("--glenoid",), True), (("--no-glenoid",), False)])
def test_the_glenoid_has_an_option_for_both_values(
    station, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, given: tuple[str, ...], has_glenoid: bool
) -> None:
    requested = []

    def solve(_inputs: object, _cut: object, options: object, *_others: object) -> None:
        requested.append(options)
        raise OSError(0, "enough")

    monkeypatch.setattr("station.assessment.rmr.solve_muscles", solve)
    station("rmr", "--output", tmp_path / "out.csv", *given)
    assert requested.pop().has_glenoid_cone == has_glenoid
