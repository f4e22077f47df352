"""Instructions in a pose or a motion of the wearer, by an elevation that is given here."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest

from station.body_config import BodySection
from station.messages.codes import CueCode
from station.session.guide import Cue, Guide, RestState
from station.session.wearer_guide import wearer_guide

BODY = BodySection(markers=("a", "b", "c", "d"), arm=("a", "b"), trunk=("c", "d"), pose_s=5.0, cycles=3)
WITHOUT_ARM = BodySection(markers=("a", "b", "c"), cycles=4)
PERIOD_S, HIGHEST_DEG = 4.0, 110.0


def raising(time: float) -> float:
    """Elevation [deg] of an arm that is raised and lowered three times, every PERIOD_S."""
    return float(10.0 + (HIGHEST_DEG - 10.0) * np.sin(np.pi * min(time, 3 * PERIOD_S) / PERIOD_S) ** 2)


def cues_of(
    guide: Guide, elevation: Callable[[float], float], until_s: float, *, is_recorded: bool = True
) -> list[Cue]:
    """The cue after every 0.1 s of 40 points a second."""
    cues = []
    for block in np.arange(0.0, until_s, 0.1):
        guide.update([(float(t), elevation(float(t))) for t in block + np.arange(4) / 40], is_recorded=is_recorded)
        cues.append(guide.cue())
    return cues


def test_a_pose_is_held_for_its_duration_of_recording() -> None:
    guide = wearer_guide(None, BODY, is_pose=True)
    armed = cues_of(guide, lambda _: 12.0, 2.0, is_recorded=False)
    assert {cue.left_s for cue in armed} == {None}
    cues = cues_of(guide, lambda _: 12.0, 6.0)
    assert [cue.message.code for cue in (cues[10], cues[-1])] == [CueCode.HOLD_POSE, CueCode.POSE_DONE]
    assert cues[10].left_s == pytest.approx(5.0 - 1.075)
    assert cues[10].rest is RestState.STEADY and cues[-1].is_done


def test_an_arm_that_moves_in_a_pose_is_shown_as_moving() -> None:
    cues = cues_of(wearer_guide(None, BODY, is_pose=True), lambda t: 12.0 + 5.0 * np.sin(6.0 * t), 3.0)
    assert cues[-1].rest is RestState.MOVING


def test_every_cycle_of_the_arm_is_a_step_of_a_motion() -> None:
    cues = cues_of(wearer_guide("tight", BODY, is_pose=False), raising, 3 * PERIOD_S + 1.0)
    steps = [cue.step for cue in cues]
    assert steps == sorted(steps) and set(steps) == {0, 1, 2, 3}
    codes = [cue.message.code for cue in cues]
    changes = [code for code, before in zip(codes, [None, *codes], strict=False) if code != before]
    assert changes == [*[CueCode.RAISE_ARM, CueCode.LOWER_ARM] * 3, CueCode.MOTION_DONE]
    assert cues[-1].is_done and "cycle 1 of 3" in cues[0].sentence


@pytest.mark.parametrize("period_s", [3.0, 12.0])
def test_an_instruction_lasts_until_the_arm_has_followed_it(period_s: float) -> None:
    """Whoever turns back at "lower the arm" must have raised it fully."""
    cues = cues_of(wearer_guide("tight", BODY, is_pose=False), lambda t: raising(t * PERIOD_S / period_s), 3 * period_s)
    codes = [cue.message.code for cue in cues]
    for number, (before, code) in enumerate(pairwise(codes), start=1):
        elevation = raising((0.1 * number + 0.075) * PERIOD_S / period_s)
        if (before, code) == (CueCode.RAISE_ARM, CueCode.LOWER_ARM):
            assert elevation > 0.9 * HIGHEST_DEG
        if (before, code) == (CueCode.LOWER_ARM, CueCode.RAISE_ARM):
            assert elevation < 0.25 * HIGHEST_DEG
    assert codes.count(CueCode.LOWER_ARM) == pytest.approx(codes.count(CueCode.RAISE_ARM), rel=0.2)


def test_cycles_before_the_recording_do_not_count() -> None:
    guide = wearer_guide("unsuited", BODY, is_pose=False)
    assert cues_of(guide, raising, 2 * PERIOD_S, is_recorded=False)[-1].step == 0


@pytest.mark.parametrize(
    ("guide", "code"),
    [
        (wearer_guide("mvc", BODY, is_pose=False), CueCode.CONTRACT),
        (wearer_guide("slack", WITHOUT_ARM, is_pose=False), CueCode.MOVE_UNCOUNTED),
    ],
)
def test_a_motion_without_counted_cycles_has_one_instruction(guide: Guide, code: CueCode) -> None:
    cue = guide.cue()
    assert (cue.message.code, cue.rest, cue.step, cue.is_done) == (code, RestState.NO_ELEVATION, 0, False)
    assert cues_of(guide, raising, 1.0)[-1].message.code is code
