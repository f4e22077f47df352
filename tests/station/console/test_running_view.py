from __future__ import annotations

import pytest

from station.config import ProtocolSection
from station.console.running_view import curves_over_time, state_of, status_of
from station.protocol import TrialSpec
from station.session.guide import guide_for
from station.session.live import Live


@pytest.mark.parametrize(
    ("said", "shown"),
    [
        ({"state": "armed", "waited_s": 4.2, "left_s": 55.8}, "armed for 4 s, 56 s left"),
        ({"state": "recording", "recorded_s": 3.21, "sentence": "recording"}, "recording 3.2 s"),
        (
            {"state": "recording", "recorded_s": 3.21, "sentence": "recording; the sync line rose a second time"},
            "recording 3.2 s; the sync line rose a second time",
        ),
        ({"state": "closing", "sentence": "the mocap capture ended"}, "the mocap capture ended"),
    ],
)
def test_the_state_is_shown_with_its_time_and_what_speaks_against_the_trial(
    said: dict[str, object], shown: str
) -> None:
    assert state_of(said) == shown


def test_the_curves_count_from_the_sync_edge() -> None:
    live = Live(TrialSpec("hand", "static", 1), guide_for("static", ProtocolSection()))
    live.force.extend((t / 10, 0.0) for t in range(401))
    live.displacement.extend([(3.0, 0.0), (39.0, 1.0)])
    live.latest = {"state": "recording", "edge_s": 2.5}
    force, displacement = curves_over_time(live)
    assert force[0] == (17.5, 0.0) and force[-1] == (37.5, 0.0), "the last 20 s, the newest 37.5 s after the edge"
    assert displacement == [(36.5, 1.0)]


def test_a_line_at_zero_has_no_sign() -> None:
    live = Live(TrialSpec("hand", "static", 1), guide_for("static", ProtocolSection()))
    live.latest = {**live.latest, "sync_v": -0.001}
    assert "sync line 0.00 V" in status_of(live)
