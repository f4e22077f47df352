"""Options of `station rmr` that have no effect are wrong usage; lists of names may have spaces and repetitions."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from station.messages.codes import InputCode
from tests.station.command import Ran, assert_one_sentence

Station = Callable[..., Ran]
LEG = Path(__file__).parents[2] / "examples" / "leg"


@pytest.fixture
def requested(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """The options of every call of the solver, which then fails."""
    options = []

    def solve(_inputs: object, _cut: object, given: object, *_others: object) -> None:
        options.append(given)
        raise OSError(0, "enough")

    monkeypatch.setattr("station.assessment.rmr.solve_muscles", solve)
    return options


@pytest.mark.parametrize(
    "given",
    [
        ("--joint", ""),
        ("--joint", " , "),
        ("--reaction-on", "parent"),
        ("--reaction-in", "child"),
        ("--static-optimisation", "--glenoid"),
        ("--static-optimisation", "--glenoid-aspect", "0.7"),
        ("--no-glenoid", "--glenoid-aspect", "0.7"),
    ],
    ids=" ".join,
)
def test_an_option_without_effect_is_wrong_usage(
    station: Station, tmp_path: Path, requested: list[Any], given: tuple[str, ...]
) -> None:
    ran = station("rmr", "--output", tmp_path / "a.csv", *given)
    assert ran.code == 2
    assert given[0] in ran.err or given[1] in ran.err
    assert not requested


@pytest.mark.parametrize(
    "given",
    [
        ("--joint", "elbow", "--reaction-on", "parent", "--reaction-in", "child"),
        ("--static-optimisation",),
        ("--static-optimisation", "--no-glenoid"),
        ("--glenoid", "--glenoid-aspect", "0.7"),
    ],
    ids=" ".join,
)
def test_options_with_an_effect_are_solved(
    station: Station, tmp_path: Path, requested: list[Any], given: tuple[str, ...]
) -> None:
    assert station("rmr", "--output", tmp_path / "a.csv", *given).code == 1
    assert len(requested) == 1


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
    assert ran.code == 2
    assert given[0] in ran.err


def test_a_subject_has_an_arm_and_a_filter_of_its_own(station: Station, tmp_path: Path) -> None:
    files = ("--suit", LEG / "shank_suit.toml", "--cuffs", LEG / "shank.json", "--output", tmp_path / "out")
    subject = ("assess", "--subject", tmp_path, "--model", LEG / "leg.osim", *files)
    ran = station(*subject)
    assert_one_sentence(ran, 2, "--subject")
    assert InputCode.NO_ARM_OF_SUBJECT in ran.err
    ran = station(*subject, "--cutoff-hz", 3)
    assert ran.code == 2
    assert "--cutoff-hz" in ran.err
