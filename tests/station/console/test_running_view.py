import asyncio
from collections import deque
from dataclasses import replace
from typing import Any

import pytest

from station.bench.view import TrialTelemetry
from station.config import ProtocolSection
from station.console.running_view import (
    UNDRAWN_UPDATES,
    UpdateSender,
    curves_over_time,
    emg_over_time,
    has_force,
    marker_roles,
    markers_text,
    motion_text,
    state_text,
    status_text,
)
from station.protocol import TrialSpec
from station.session.guide import MotionGuide, guide_for
from station.session.trial_runner import LiveTrial, force_limits
from tests.station.wearer import wearer_config

pytestmark = pytest.mark.anyio
BOUNCE = TrialSpec(None, "bounce", 1)


@pytest.mark.parametrize(
    ("telemetry", "shown"),
    [
        ({"state": "armed", "waited_s": 4.2, "left_s": 55.8}, "armed for 4 s, 56 s left"),
        ({"state": "recording", "recorded_s": 3.21, "problems": ""}, "recording 3.2 s"),
        ({"state": "recording", "recorded_s": 3.21, "problems": "a second edge"}, "recording 3.2 s; a second edge"),
        ({"state": "closing", "sentence": "the mocap capture ended"}, "the mocap capture ended"),
    ],
)
def test_the_state_is_shown_with_its_time_and_the_problems_of_the_trial(telemetry: dict[str, Any], shown: str) -> None:
    assert state_text(TrialTelemetry(**telemetry)) == shown


def test_the_curves_count_from_the_sync_edge() -> None:
    live = LiveTrial(TrialSpec("hand", "static", 1), guide_for("static", ProtocolSection()))
    live.force.extend((t / 10, 0.0) for t in range(401))
    live.displacement.extend([(3.0, 0.0), (39.0, 1.0)])
    live.latest = TrialTelemetry(state="recording", edge_s=2.5)
    force, displacement = curves_over_time(live)
    assert force[0] == (17.5, 0.0) and force[-1] == (37.5, 0.0), "the last 20 s, the newest 37.5 s after the edge"
    assert displacement == [(36.5, 1.0)]


def test_a_line_at_zero_has_no_sign() -> None:
    live = LiveTrial(TrialSpec("hand", "static", 1), guide_for("static", ProtocolSection()))
    live.latest = TrialTelemetry(sync_v=-0.001)
    assert "sync line 0.00 V" in status_text(live)


def test_of_a_wearer_elevation_body_markers_and_emg_are_shown() -> None:
    spec = TrialSpec(None, "motion", 1, condition="tight")
    live = LiveTrial(spec, MotionGuide(3))
    assert motion_text(live) == "\u2013 deg"
    live.elevation.append((1.0, 87.6))
    live.displacement.append((1.0, 3.0))
    emg_uv = {"deltoid": 120.4, "biceps": 4.0}
    live.latest = TrialTelemetry(state="recording", edge_s=0.5, recorded_s=1.0, emg_uv=emg_uv)
    assert motion_text(live) == "88 deg" and curves_over_time(live)[1] == [(0.5, 87.6)]
    live.update(live.latest.model_copy(update={"force": [(1.5, 2.0)]}), force_limits(wearer_config()))
    assert emg_over_time(live) == {"deltoid": [(1.0, 120.4)], "biceps": [(1.0, 4.0)]}
    assert "EMG RMS [\u00b5V] deltoid 120, biceps 4" in status_text(live)
    live.mvc_uv = {"deltoid": 240.8, "biceps": 80.0}
    assert emg_over_time(live) == {"deltoid": [(1.0, 50.0)], "biceps": [(1.0, 5.0)]}
    assert "EMG RMS [% of the MVC] deltoid 50, biceps 5" in status_text(live)
    live.mvc_uv = {"deltoid": 120.4}
    assert emg_over_time(live).keys() == {"deltoid"}
    roles = marker_roles(wearer_config(), spec)
    without = marker_roles(wearer_config(), TrialSpec(None, "motion", 1, condition="unsuited"))
    seen = {"ac": True, "cord_arm": False, "cuff_1": False}
    forces = [has_force(wearer_config(), one) for one in (spec, replace(spec, condition="unsuited"), BOUNCE)]
    assert forces == [True, False, True], "no chart of an idle load cell"
    assert (markers_text(seen, roles), markers_text(seen, without)) == ("hidden: cord_arm", "marker ac seen")
    assert (roles["ac"], roles["ij"], roles["cord_arm"]) == ("arm", "body", "suit") and "cuff_1" not in roles


# Flow control towards a browser: a fake one draws when the test says so.


class FakeBrowser:
    def __init__(self) -> None:
        self.sent = 0
        self._undrawn: deque[asyncio.Future[None]] = deque()

    async def draw(self) -> None:
        self.sent += 1
        self._undrawn.append(asyncio.get_running_loop().create_future())
        await self._undrawn[-1]

    async def has_drawn(self) -> None:
        self._undrawn.popleft().set_result(None)
        await turn()

    async def times_out(self) -> None:
        self._undrawn.popleft().set_exception(TimeoutError())
        await turn()


async def turn() -> None:
    """Every task of the event loop that can run has run."""
    for _ in range(5):
        await asyncio.sleep(0)


@pytest.fixture
async def drawing(monkeypatch: pytest.MonkeyPatch, anyio_backend: str) -> FakeBrowser:
    monkeypatch.setattr("nicegui.core.loop", asyncio.get_running_loop())
    return FakeBrowser()


async def test_every_tick_with_new_data_sends_one_update_to_a_browser_that_draws(drawing: FakeBrowser) -> None:
    sender = UpdateSender(drawing.draw)
    for tick in range(1, 101):
        sender.tick(0.08 * tick)
        await turn()
        assert drawing.sent == tick
        await drawing.has_drawn()


async def test_a_browser_that_does_not_draw_receives_no_updates_until_it_does_or_has_timed_out(
    drawing: FakeBrowser,
) -> None:
    sender = UpdateSender(drawing.draw)
    for sent, answers in ((0, drawing.has_drawn), (1, drawing.times_out)):
        for tick in range(50):
            sender.tick(50.0 * sent + tick)  # without a turn: the count must not wait for the tasks
        await turn()
        assert drawing.sent == UNDRAWN_UPDATES + sent
        await answers()
    sender.tick(100.0)
    await turn()
    assert drawing.sent == UNDRAWN_UPDATES + 2


async def test_data_are_sent_once_and_no_data_not_at_all(drawing: FakeBrowser) -> None:
    sender = UpdateSender(drawing.draw)
    for at in (None, 1.0, 1.0, 1.0):
        sender.tick(at)
        await turn()
    assert drawing.sent == 1
