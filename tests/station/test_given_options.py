"""Options of `station rmr` that have no effect are wrong usage; lists of names may have spaces and repetitions."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.station.command import Ran

Station = Callable[..., Ran]


@pytest.fixture
def requested(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """The options of every call of the solver, which then fails."""
    options = []

    def solve(_inputs: object, _cut: object, given: object, _progress: object) -> None:
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
