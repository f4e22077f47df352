"""station emg writes beside its inputs, and over none of them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from station.exit_code import DONE, WRONG_USAGE
from station.messages.codes import InputCode
from tests.station.command import Ran, assert_refused
from tests.station.emg.measured import levels, write_activations, write_emg, write_mvc, write_setup

Station = Callable[..., Ran]


@pytest.fixture
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A trial, and files with the names of its results, in the working directory."""
    monkeypatch.chdir(tmp_path)
    write_emg(tmp_path / "lift.csv", levels(), seed=1)
    write_setup(tmp_path / "emg.toml")
    return tmp_path


def write_louder(path: Path) -> None:
    write_emg(path, levels(1.5), seed=2)


def files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


@pytest.mark.parametrize("option", ["", "--reference", "--mvc", "--activations", "--setup"])
def test_an_envelope_does_not_replace_a_file_that_is_read(station: Station, lab: Path, option: str) -> None:
    read = lab / "lift_emg.csv"
    {"--activations": write_activations, "--setup": write_setup, "--mvc": write_mvc}.get(option, write_louder)(read)
    before = files(lab)
    words = ["lift.csv", *filter(None, [option]), read, *(["--setup", "emg.toml"] if option != "--setup" else [])]
    ran = station("emg", *words, "--to", "csv", "--output", ".")
    assert ran.code == WRONG_USAGE and read.name in " ".join(ran.err.split())
    assert files(lab) == before


def test_the_change_does_not_replace_activations_of_its_name(station: Station, lab: Path) -> None:
    write_activations(lab / "emg_change.csv")
    before = files(lab)
    words = ("--activations", "emg_change.csv", "--setup", "emg.toml", "--output", lab)
    assert station("emg", "lift.csv", *words).code == WRONG_USAGE
    assert files(lab) == before


def test_results_of_an_earlier_run_are_replaced(station: Station, lab: Path) -> None:
    for _ in range(2):
        assert station("emg", "lift.csv", "--output", ".").code == DONE


@pytest.mark.parametrize("output", ["emg.toml", "emg.toml/results"])
def test_an_output_that_is_a_file_or_within_one_is_wrong_usage(station: Station, lab: Path, output: str) -> None:
    before = files(lab)
    assert_refused(station("emg", "lift.csv", "--output", output), WRONG_USAGE, InputCode.OUTPUT_IS_FILE)
    assert files(lab) == before
