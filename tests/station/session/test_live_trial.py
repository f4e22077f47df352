"""What a running trial shows: marks, tares and alarms."""

from __future__ import annotations

import pytest

from station.protocol import TrialSpec
from station.session.force_limits import ForceLimits
from station.session.guide import FreeStaticGuide
from station.session.live_trial import LiveTrial


def test_a_mark_has_its_time_and_a_note_and_a_tare_its_force() -> None:
    live = LiveTrial(TrialSpec("hand", "static", 1), FreeStaticGuide(7.0))
    points = [(0.1 * i, 10.0 + 5.0 * (i > 15)) for i in range(30)]
    live.update(
        {"state": "recording", "recorded_s": 2.9, "force": points, "displacement": [], "elevation": [], "events": []},
        ForceLimits(150.0, 5e3),
    )
    assert (live.add_mark(), live.add_mark("STOP")) == (1, 2)
    assert live.marks == {1: 2.9, 2: 2.9} and live.mark_names == {2: "STOP"}
    live.tare()
    assert live.tare_n == pytest.approx(15.0)


def test_an_alarm_lasts_until_it_is_acknowledged_and_its_cause_is_gone() -> None:
    live = LiveTrial(TrialSpec("hand", "static", 1), FreeStaticGuide(7.0))

    def raised_by(start_s: float, newtons: float) -> bool:
        points = [(start_s + 0.1 * i, newtons) for i in range(12)]
        return live.update(
            {"state": "armed", "force": points, "displacement": [], "elevation": [], "events": []},
            ForceLimits(150.0, 5e3),
        )

    assert not raised_by(0.0, 20.0) and live.alarm is None
    assert raised_by(2.0, 160.0) and live.unseen_alarm is not None
    assert not raised_by(4.0, 20.0) and live.unseen_alarm is not None, "the operator has not seen it"
    assert not raised_by(6.0, 160.0)
    live.is_alarm_seen = True
    assert not raised_by(8.0, 160.0) and live.unseen_alarm is None and live.alarm is not None, (
        "the force is still above the limit"
    )
    assert not raised_by(10.0, 20.0) and not raised_by(11.5, 20.0) and live.alarm is None
    assert raised_by(13.0, 160.0) and live.unseen_alarm is not None, "another one"
