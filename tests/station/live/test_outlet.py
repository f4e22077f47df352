"""The live outlet: confined to an interface, readable by LSL's own inlet, off by default."""

from __future__ import annotations

from pathlib import Path

import pytest

from station.config import LiveSection
from station.live import outlet as outlet_module
from station.live.engine import LiveEngine
from station.live.outlet import LslOutlet, OutletRefused
from station.messages.live_codes import LiveCode
from tests.drivers.pytest_on_loopback import passed_on_loopback
from tests.station.live.test_server import SETUP
from tests.station.live.trials import Collected, generic_plan, part_of, solve
from tests.station.wearer import WearerSession


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
