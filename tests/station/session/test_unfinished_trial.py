"""A trial that ended early is described by the step that was reached, which is the cause of every later reason."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
from scipy.constants import g

from recordings.manifest import MeasurementProtocol, TestKind
from station.messages.codes import ReasonCode
from station.messages.message import Message
from station.session.unfinished_trial import unfinished_step

PLANNED = MeasurementProtocol((1.5, 1.0), hold_s=4.0, swing_s=10.0)
LEVEL_S = 8.0
LEVELS = [0.0, 1.5, 2.5, 1.5, 0.0]
"""Kilograms above the empty hook."""


def weights(t: float) -> float:
    return 4.0 + g * LEVELS[min(int(t / LEVEL_S), 4)]


def swing(t: float) -> float:
    return 25.0 + (10.0 * math.sin(2 * math.pi * t) if 4.0 < t < 16.0 else 0.0)


@pytest.mark.parametrize(
    ("test", "force", "until_s", "expected"),
    [
        ("static", weights, 0.5 * LEVEL_S, (ReasonCode.WEIGHTS_MISSING, {"found": 0, "planned": 2})),
        ("static", weights, 2.2 * LEVEL_S, (ReasonCode.WEIGHTS_MISSING, {"found": 1, "planned": 2})),
        ("static", weights, 3.2 * LEVEL_S, (ReasonCode.UNLOADING_MISSING, {"found": 0, "planned": 2})),
        ("static", weights, 4.2 * LEVEL_S, (ReasonCode.UNLOADING_MISSING, {"found": 1, "planned": 2})),
        ("static", weights, 5.0 * LEVEL_S, None),
        ("dynamic", swing, 3.0, (ReasonCode.SWING_SHORT, {"found_s": 0.0, "planned_s": 10.0})),
        ("bounce", swing, 9.0, (ReasonCode.SWING_SHORT, {"found_s": pytest.approx(4.0, abs=1.5), "planned_s": 10.0})),
        ("dynamic", swing, 20.0, None),
    ],
)
def test_the_step_at_which_a_trial_ended_is_its_cause(
    test: TestKind,
    force: Callable[[float], float],
    until_s: float,
    expected: tuple[ReasonCode, dict[str, float]] | None,
) -> None:
    points = ((t / 20, force(t / 20)) for t in range(int(20 * until_s)))
    found = unfinished_step(test, PLANNED, points)
    assert found == (Message(*expected) if expected else None)


def test_without_planned_weights_no_step_is_missing() -> None:
    assert unfinished_step("static", MeasurementProtocol(), [(0.0, 1.0)]) is None
