"""The live outlet: confined to an interface, readable by LSL's own inlet, off by default."""

from __future__ import annotations

import hashlib
import json
import shutil
from pathlib import Path
from threading import Event

import pandas as pd
import pytest

from recordings.samples import Samples
from recordings.topics import MARKERS
from station.bench.view import Snapshot, TrialState
from station.config import LiveSection, parse_config
from station.live import outlet as outlet_module
from station.live.engine import LiveEngine
from station.live.outlet import LslOutlet, OutletRefused, live_path
from station.live.subscription import LiveSubscription, find_address
from station.live.tap import LiveRequest, LiveTap
from station.messages.live_messages import LiveCode
from tests.drivers.pytest_on_loopback import passed_on_loopback
from tests.station.live.test_server import SETUP
from tests.station.live.trials import TIGHT, Collected, generic_plan, part_of, solve
from tests.station.wearer import WearerSession
from tests.timeout import scaled_timeout


def test_the_outlet_is_off_by_default() -> None:
    assert LiveSection().outlet == "" and not LiveSection().enabled


def test_an_outlet_that_cannot_be_confined_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(outlet_module.sys, "platform", "win32")
    with pytest.raises(OutletRefused) as refused:
        LslOutlet("live", "loopback").begin(SETUP)
    assert refused.value.code == LiveCode.OUTLET_NOT_CONFINED


def test_a_refused_outlet_is_a_finding_and_values_continue(wearer: WearerSession, tmp_path: Path) -> None:
    prepared, kept = generic_plan(wearer.config, tmp_path), Collected()
    engine = LiveEngine(
        prepared, on_setup=lambda _: kept.updates.append, sinks=[LslOutlet("x", "nowhere")], now_s=lambda: 0.0
    )
    part = part_of(wearer, 25)
    for stream in part.streams:
        engine.describe(stream)
    for block in part.blocks():
        engine.take(block, 0.0)
    engine.finish()
    assert LiveCode.NO_OUTLET in kept.codes
    assert engine.solved == 25 == len(solve(prepared, part)[1].values)


@pytest.mark.slow
def test_an_inlet_reads_the_values(tmp_path: Path) -> None:
    assert passed_on_loopback("tests/station/live/outlet_on_loopback.py", "test_", tmp_path) == 2


# The live process itself: started by the tap, watched by a view, closed with the hash of the recording.


FRAMES = 150


@pytest.mark.slow
def test_a_trial_from_the_tap_to_view_and_file(wearer: WearerSession, tmp_path: Path) -> None:
    """Frames come faster than they are solved, so that some are left out: all of them are accounted for."""
    recording = Path(shutil.copy(wearer.path(TIGHT), tmp_path))
    data = wearer.config.model_dump(mode="json") | {"live": {"enabled": True}}
    request = LiveRequest(parse_config(data, "test").model_dump(mode="json"), str(tmp_path), TIGHT, 0)
    part = part_of(wearer, FRAMES)
    pause = Event()
    with LiveTap(request) as tap:
        tap.show(Snapshot(TrialState.ARMED, streams=part.streams))
        for _ in range(round(scaled_timeout(120) / 0.05)):
            if (address := find_address(tmp_path)) is not None:
                break
            pause.wait(0.05)
        assert address is not None
        view = LiveSubscription(address)
        tap.show(Snapshot(TrialState.RECORDING, streams=part.streams, recording=recording))
        fed = [block for block in part.blocks() if block.stream == MARKERS]
        for item in part.items():
            if isinstance(item, Samples):
                tap.offer(item)
    assert tap.dropped == 0
    assert view.wait_until_over(scaled_timeout(60))
    updates = view.take()
    view.close()
    assert tap.wait(scaled_timeout(30)) and tap.exit_code == 0
    plain = json.loads(live_path(recording).with_suffix(".json").read_text(encoding="utf-8"))
    assert plain["recording_sha256"] == hashlib.sha256(recording.read_bytes()).hexdigest()
    assert plain["frames"] + plain["dropped_frames"] == len(fed) == FRAMES
    rows = pd.read_csv(live_path(recording))
    assert plain["frames"] == len(rows) > 0
    shown = [update.values.frame for update in updates if update.values is not None]
    assert shown and set(shown) <= set(rows["frame"])
    assert find_address(tmp_path) is None
