"""Muscles whose tendon is longer than their path throughout a motion are named, in the results and as a finding."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import cuffstation as cs
from solver.bundled import bundled_model
from solver.model import Model
from solver.motion import decimate, differentiate
from solver.multibody.postures import postures
from solver.paths import evaluate_paths
from solver.raise_arm import simulate_arm_raise
from station.assessment.rmr import slack_muscles
from station.messages.codes import AssessmentCode
from tests.solver.legs import Step, step_in
from tests.station.command import Ran

MODEL = bundled_model()
RAISE = decimate(differentiate(simulate_arm_raise(MODEL)), 60)


@pytest.fixture
def step(tmp_path: Path) -> Step:
    """Its first muscle has a tendon of 5 m."""
    step = step_in(tmp_path)
    text = step.model.read_text(encoding="utf-8")
    step.model.write_text(re.sub("<tendon_slack_length>[^<]*", "<tendon_slack_length>5", text, count=1), "utf-8")
    return step


def with_tendon(muscle: int, length: float) -> Model:
    changed = replace(MODEL.muscles[muscle], tendon_slack_length=length)
    return replace(MODEL, muscles=(*MODEL.muscles[:muscle], changed, *MODEL.muscles[muscle + 1 :]))


def test_a_muscle_is_slack_if_its_tendon_is_longer_than_its_path_in_every_frame() -> None:
    assert slack_muscles(MODEL, RAISE, "opensim") == ()
    assert slack_muscles(with_tendon(3, 5.0), RAISE, "opensim") == (MODEL.muscle_names[3],)
    assert slack_muscles(replace(MODEL, muscles=()), RAISE, "opensim") == ()


def test_a_muscle_that_is_slack_in_the_first_frame_alone_is_not_named() -> None:
    lengths = evaluate_paths(MODEL, postures(MODEL, RAISE.positions, RAISE.speeds, RAISE.time)).lengths
    muscle = int(np.argmax(lengths.max(axis=0) - lengths[0]))
    model = with_tendon(muscle, 0.5 * (lengths[0, muscle] + lengths[:, muscle].max()))
    assert slack_muscles(model, RAISE.cut(slice(1)), "opensim") == (MODEL.muscle_names[muscle],)
    assert slack_muscles(model, RAISE, "opensim") == ()


def test_the_verb_and_the_library_name_a_muscle_that_cannot_pull(
    station: Callable[..., Ran], step: Step, tmp_path: Path
) -> None:
    model = cs.load_model(step.model, actuators=[step.actuators])
    name, *_ = model.muscle_names
    files = ("--model", step.model, "--motion", step.motion, "--external-loads", step.loads)
    cut = ("--actuators", step.actuators, "--static-optimisation", "--from", 0.2, "--to", 0.22)
    ran = station("rmr", *files, *cut, "--output", tmp_path / "a.sto")
    assert f": {name}. " in ran.err and AssessmentCode.MUSCLES_SLACK in ran.err
    assert f"slack_muscles={name}\n" in (tmp_path / "a.sto").read_text(encoding="utf-8")
    motion = cs.load_motion(model, step.motion, cutoff_hz=6.0).cut(slice(20, 22))
    solution = cs.solve_motion(model, motion)
    assert {AssessmentCode.MUSCLES_SLACK} <= {finding.code for finding in solution.findings}
