"""Muscles that cannot pull in a motion, because their tendon is longer than their path in every frame."""

from __future__ import annotations

from collections.abc import Sequence

from solver.model import Model
from solver.motion import Kinematics
from solver.multibody.postures import postures
from solver.paths import PathMode, evaluate_paths
from station.messages.codes import AssessmentCode
from station.messages.message import Message


def slack_muscles(model: Model, kinematics: Kinematics, path_mode: PathMode) -> tuple[str, ...]:
    """Their names. Frames after the first are evaluated only for muscles that are slack in the first."""
    slack = model.muscles
    for frames in (slice(1), slice(None)):
        if not slack:
            break
        part = kinematics.cut(frames)
        state = postures(model, part.positions, part.speeds, part.time)
        longest = evaluate_paths(model, state, [muscle.path for muscle in slack], path_mode).lengths.max(axis=0)
        is_slack = longest < [muscle.tendon_slack_length for muscle in slack]
        slack = tuple(muscle for muscle, is_kept in zip(slack, is_slack, strict=True) if is_kept)
    return tuple(muscle.name for muscle in slack)


def slack_findings(names: Sequence[str]) -> list[Message[AssessmentCode]]:
    """One that names the muscles; none without one."""
    return [Message(AssessmentCode.MUSCLES_SLACK, {"muscles": ", ".join(names)})] if names else []
