from __future__ import annotations

import pytest

from station.console.running_view import state_of


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
