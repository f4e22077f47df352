from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from recordings.manifest import TestKind, TrialCondition
from station.protocol import TrialSpec, published_plan


def test_the_published_plan_has_24_trials_for_four_cuffs() -> None:
    plan = list(published_plan(["waist", "hand", "tube", "elbow"], repeats=3))
    assert len(plan) == 24
    assert [(t.test, t.repeat) for t in plan[:4]] == [("static", 1), ("dynamic", 1), ("static", 2), ("dynamic", 2)]


def test_a_session_may_begin_with_one_bounce_of_no_cuff(tmp_path: Path) -> None:
    first, second, *_ = published_plan(["waist", "hand"], repeats=1, has_bounce=True)
    assert (first.cuff, first.test) == (None, "bounce")
    assert (second.cuff, second.test) == ("waist", "static")
    assert first.file_name(2) == "test-bounce_run-2.mcap"
    (tmp_path / first.file_name(1)).touch()
    assert first.next_free_run(tmp_path) == 2


def test_a_rerecording_gets_the_next_number(tmp_path: Path) -> None:
    spec = TrialSpec("hand", "static", 1)
    assert spec.next_free_run(tmp_path) == 1
    (tmp_path / spec.file_name(1)).touch()
    (tmp_path / spec.file_name(2)).touch()
    assert spec.next_free_run(tmp_path) == 3
    assert spec.file_name(3) == "cuff-hand_test-static_run-3.mcap"


def test_run_1_does_not_count_as_run_10(tmp_path: Path) -> None:
    spec = TrialSpec("hand", "static", 1)
    (tmp_path / spec.file_name(10)).touch()
    assert spec.next_free_run(tmp_path) == 1


def test_the_wearer_s_trials_are_around_the_cuffs_those_without_the_suit_first() -> None:
    plan = list(published_plan(["hand"], 1, has_bounce=True, conditions=("unsuited", "slack", "tight", "mvc")))
    assert [(trial.test, trial.condition) for trial in plan] == [
        ("bounce", None),
        ("pose", None),
        ("motion", "unsuited"),
        ("motion", "mvc"),
        ("static", None),
        ("dynamic", None),
        ("motion", "slack"),
        ("motion", "tight"),
    ]


@pytest.mark.parametrize(
    ("test", "condition", "name", "file"),
    [
        ("pose", None, None, "test-pose_run-1.mcap"),
        ("motion", "tight", None, "condition-tight_test-motion_run-1.mcap"),
        ("motion", "slack", "sub-P1_task-{test}_acq-{cuff}_run-{run}", "sub-P1_task-motion_acq-slack_run-1.mcap"),
        ("pose", None, "sub-P1_task-{test}_acq-{cuff}_run-{run}", "sub-P1_task-pose_run-1.mcap"),
        ("pose", None, "{cuff}-{test}-{run}", "pose-pose-1.mcap"),
    ],
)
def test_the_condition_of_a_motion_is_in_its_file_name(
    test: TestKind, condition: TrialCondition | None, name: str | None, file: str
) -> None:
    spec = TrialSpec(None, test, 1, condition=condition)
    assert (replace(spec, name=name) if name else spec).file_name(1) == file
