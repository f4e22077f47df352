"""Options, help and exit codes that are the same in every verb; options without effect are wrong usage."""

import inspect
import json
import subprocess
import sys
from collections.abc import Callable
from importlib.metadata import version
from itertools import pairwise
from pathlib import Path
from typing import Any, get_type_hints

import pytest
import typer
from rich.console import detect_legacy_windows
from typer.models import ParameterInfo

from station.cli import VERBS, app
from station.messages.assessment_messages import InputCode
from tests.station.command import Ran, assert_one_sentence, help_of
from tests.station.test_cli import CONFIG, trial_file

FLOATS = [
    (verb, option.opts[0])
    for verb, command in typer.main.get_command(app).commands.items()
    for option in command.params
    if "float" in str(get_type_hints(command.callback)[option.name])
]
OTHER_FORMS = [("scale", "--body-mass", "nan"), ("ik", "--from", "-inf"), ("id", "--cutoff-hz", "1e999")]
Station = Callable[..., Ran]
LEG = Path(__file__).parents[2] / "examples" / "leg"


@pytest.mark.parametrize("module", ["station", "station.cli"])
def test_the_command_shows_its_version_under_both_names_of_its_module(module: str) -> None:
    command = [sys.executable, "-m", module, "--version"]
    shown = subprocess.run(command, capture_output=True, text=True, check=True).stdout  # noqa: S603  (our own)
    assert shown.split() == ["cuffstation", version("cuffstation")]


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


@pytest.fixture
def requested(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """The options of every call of the solver, which then fails."""
    options = []

    def solve(_inputs: object, _cut: object, given: object, *_others: object) -> None:
        options.append(given)
        raise OSError(0, "enough")

    monkeypatch.setattr("station.assessment.rmr.solve_muscles", solve)
    return options


@pytest.mark.parametrize(("given", "has_glenoid"), [((), True), (("--glenoid",), True), (("--no-glenoid",), False)])
def test_the_glenoid_has_an_option_for_both_values(
    station, tmp_path: Path, requested: list[Any], given: tuple[str, ...], has_glenoid: bool
) -> None:
    station("rmr", "--output", tmp_path / "out.csv", *given)
    assert requested.pop().has_glenoid_cone == has_glenoid


@pytest.mark.parametrize("verb", VERBS)
def test_a_help_text_is_shown_as_it_is_written_and_breaks_only_where_the_line_is_full(verb: str) -> None:
    shown = _compact(help_of(verb, 400))
    assert verb != "id" or "Start time [s]." in _help_texts(verb), "there are units in square brackets"
    for text in _help_texts(verb):
        assert _compact(text) in shown
    width = 100 - detect_legacy_windows()  # rich leaves a column
    text = help_of(verb, 100).partition("╭")[0].partition("Usage:")[2].partition("\n")[2]
    for line, following in pairwise(line.strip() for line in text.splitlines()):
        if line and following:
            assert len(f" {line} {following.split()[0]} ") > width, line


def _help_texts(verb: str) -> list[str]:
    """Docstring and visible options of the function, which the rendered help does not go through."""
    written = [inspect.getdoc(VERBS[verb]) or ""]
    for hint in get_type_hints(VERBS[verb], include_extras=True).values():
        for described in getattr(hint, "__metadata__", ()):
            if isinstance(described, ParameterInfo) and described.help and not described.hidden:
                written.append(described.help)
    return written


def _compact(text: str) -> str:
    """Without white space and the frame of a table, so that lines may break anywhere."""
    return "".join(text.replace("│", " ").split())


@pytest.mark.parametrize(
    ("given", "has_effect"),
    [
        (("--joint", ""), False),
        (("--joint", " , "), False),
        (("--reaction-on", "parent"), False),
        (("--reaction-in", "child"), False),
        (("--static-optimisation", "--glenoid"), False),
        (("--static-optimisation", "--glenoid-aspect", "0.7"), False),
        (("--no-glenoid", "--glenoid-aspect", "0.7"), False),
        (("--joint", "elbow", "--reaction-on", "parent", "--reaction-in", "child"), True),
        (("--static-optimisation",), True),
        (("--static-optimisation", "--no-glenoid"), True),
        (("--glenoid", "--glenoid-aspect", "0.7"), True),
    ],
)
def test_an_option_without_effect_is_wrong_usage(
    station: Station, tmp_path: Path, requested: list[Any], given: tuple[str, ...], has_effect: bool
) -> None:
    ran = station("rmr", "--output", tmp_path / "a.csv", *given)
    assert ran.code == (1 if has_effect else 2)
    assert has_effect or given[0] in ran.err or given[1] in ran.err
    assert len(requested) == has_effect


def test_names_are_taken_without_spaces_and_once(station: Station, tmp_path: Path, requested: list[Any]) -> None:
    lists = ("--joint", "knee_r, hip_r,knee_r", "--free-coordinates", " pelvis_tx , pelvis_ty,")
    station("rmr", "--output", tmp_path / "a.csv", *lists)
    assert requested[0].reactions.joints == ("knee_r", "hip_r")
    assert requested[0].free_coordinates == ("pelvis_tx", "pelvis_ty")


@pytest.mark.parametrize("given", [("--glenoid",), ("--glenoid-aspect", "0.7")], ids=" ".join)
def test_the_glenoid_of_a_model_without_a_shoulder_is_wrong_usage(
    station: Station, tmp_path: Path, given: tuple[str, ...]
) -> None:
    files = ("--model", LEG / "leg.osim", "--motion", LEG / "stride.mot", "--every", 20)
    ran = station("rmr", *files, *given, "--output", tmp_path / "a.csv")
    assert_one_sentence(ran, 2, given[0])
    assert "leg" in ran.err and InputCode.NO_GLENOID_TO_KEEP in ran.err


@pytest.mark.parametrize("given", [("--write-setup", "a.xml"), ("--keep-joined-points",)], ids=" ".join)
def test_options_of_a_set_up_need_one(station: Station, tmp_path: Path, given: tuple[str, ...]) -> None:
    ran = station("scale", "--model", "bundled", "--markers", "a.trc", "--body-mass", 70, *given, "--output", "a.osim")
    assert ran.code == 2 and given[0] in ran.err


def test_a_subject_has_an_arm_and_a_filter_of_its_own(station: Station, tmp_path: Path) -> None:
    (tmp_path / "subject.toml").write_text("mass_kg = 70.0\n")
    files = ("--suit", LEG / "shank_suit.toml", "--cuffs", LEG / "shank.json", "--output", tmp_path / "out")
    subject = ("assess", "--subject", tmp_path, "--model", LEG / "leg.osim", *files)
    ran = station(*subject)
    assert_one_sentence(ran, 2, "--subject")
    assert InputCode.NO_ARM_OF_SUBJECT in ran.err
    ran = station(*subject, "--cutoff-hz", 3)
    assert ran.code == 2
    assert "--cutoff-hz" in ran.err
