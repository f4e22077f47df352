"""Measured and simulated data in separate folders, by the identities of the devices and by the manifests."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from recordings.manifest import DataOrigin
from recordings.reader import open_recording, read_manifest
from recordings.samples import DeviceIdentity
from station.bench.session_folder import check_folder
from station.bench.simulation import SimulatedBench
from station.bench.trial_recorder import TrialRecorder, TrialRefused
from station.clock import ManualClock
from station.config import StationConfig
from station.files.timed_replay import replay
from station.journal import read_journal
from station.messages.codes import RefusalCode
from station.protocol import TrialSpec
from tests.station.bench.test_trial_recorder import CONFIG
from tests.station.command import Ran, assert_refused
from tests.station.fake_devices import FakeCapture, FakeDaq, FakeMocap
from tests.station.refusals import raises_refusal
from tests.station.session.benched import Recorder, simulated_bench

Station = Callable[..., Ran]
GOLDEN = Path(__file__).parents[2] / "recordings" / "golden" / "format_1.mcap"


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[SimulatedBench, StationConfig]]:
    with simulated_bench(tmp_path_factory.mktemp("bench"), swing_s=2.0) as both:
        yield both


@pytest.fixture(scope="module")
def simulated(running: tuple[SimulatedBench, StationConfig], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A trial that the console's recorder took from the simulated devices, over their wires."""
    folder = tmp_path_factory.mktemp("sessions") / "simulated" / "monday"
    with Recorder(running[1], folder, running[0].clock_port) as recorder:
        result: dict[str, Any] = recorder.end()["result"]
    assert result["origin"] == "simulated"
    return folder / result["file"]


def record(folder: Path, is_simulated: bool | None, test: str = "static") -> Path:
    """A trial of fake devices with this identity."""
    clock = ManualClock()
    capture = FakeCapture(clock, 5.0, 2.0)
    devices = [FakeDaq(clock, capture), FakeMocap(clock, capture)]
    for device in devices:
        device.identity = DeviceIdentity(device.name, "version 1", is_simulated)
    daemon = TrialRecorder(CONFIG, clock, make_devices=lambda *_: devices, check_folder=check_folder)  # type: ignore[arg-type,return-value]
    result = daemon.record(folder, TrialSpec("hand", test, 1))  # type: ignore[arg-type]
    assert result.path is not None, result.sentence
    return result.path


def test_the_identities_of_the_devices_are_in_the_manifest_and_the_origin_in_the_journal(simulated: Path) -> None:
    manifest = read_manifest(simulated)
    assert manifest.origin is DataOrigin.SIMULATED
    assert [device.is_simulated for device in manifest.devices] == [True, True]
    assert manifest.devices[0].text == "USB-6008 serial number 01C0FFEE"
    assert manifest.devices[1].text == "QTM Version is 2024.3 (build 17700), simulated"
    assert [recorded.origin for recorded in read_journal(simulated.parent).recorded] == ["simulated"]


def test_info_shows_the_origin(simulated: Path, station: Station) -> None:
    assert "SIMULATED data (NI Dev1: USB-6008" in station("info", simulated).out
    plain = json.loads(station("info", simulated, "--format", "json").out)
    assert plain["origin"] == "simulated"
    assert [device["is_simulated"] for device in plain["manifest"]["devices"]] == [True, True]


def test_an_export_has_the_origin_in_its_sidecar(simulated: Path, tmp_path: Path, station: Station) -> None:
    assert station("export", simulated, "--to", "csv", "--output", tmp_path).code == 0
    (sidecar,) = tmp_path.glob("*.json")
    plain = json.loads(sidecar.read_text(encoding="utf-8"))
    assert plain["origin"] == "simulated" and len(plain["devices"]) == 2
    assert station("export", simulated, "--to", "mot", "--output", tmp_path).code == 0
    assert "\ndata=simulated\n" in next(tmp_path.glob("*.mot")).read_text(encoding="utf-8")


def test_a_replay_has_the_origin_of_its_recording(simulated: Path, tmp_path: Path, station: Station) -> None:
    again = replay(simulated, tmp_path, 1000.0).path
    assert again is not None and read_manifest(again).origin is DataOrigin.SIMULATED
    ran = station("replay", simulated, "--session", tmp_path / "monday", "--speed", "100")
    assert_refused(ran, 1, RefusalCode.SIMULATED_DEVICES)
    assert str(tmp_path / "simulated" / "monday") in ran.err


def test_simulated_devices_are_not_recorded_among_measured_sessions(
    running: tuple[SimulatedBench, StationConfig], tmp_path: Path
) -> None:
    with Recorder(running[1], tmp_path / "monday", running[0].clock_port) as recorder:
        refusal = recorder.end()
    assert refusal["code"] == RefusalCode.SIMULATED_DEVICES
    assert str(tmp_path / "simulated" / "monday") in refusal["refused"]
    assert not list(tmp_path.rglob("*.mcap"))


@pytest.mark.parametrize(("is_simulated", "origin"), [(True, "simulated"), (False, "measured"), (None, "unknown")])
def test_the_origin_of_a_trial_is_that_of_its_devices(tmp_path: Path, is_simulated: bool | None, origin: str) -> None:
    assert open_recording(record(tmp_path / "simulated", is_simulated)).manifest.origin == origin


@pytest.mark.parametrize("first", [True, False])
def test_measured_and_simulated_trials_do_not_share_a_session(tmp_path: Path, first: bool) -> None:
    folder = tmp_path / "simulated"
    record(folder, first)
    with raises_refusal(TrialRefused, RefusalCode.MIXED_ORIGIN):
        record(folder, not first)
    record(folder, first, "dynamic")
    assert len(list(folder.glob("*.mcap"))) == 2


def test_one_simulated_device_makes_a_simulated_trial() -> None:
    identities = [DeviceIdentity("a", "", False), DeviceIdentity("b", "", None), DeviceIdentity("c", "", True)]
    assert DataOrigin.of_devices(identities) is DataOrigin.SIMULATED
    assert DataOrigin.of_devices(identities[:2]) is DataOrigin.UNKNOWN
    assert DataOrigin.of_devices(identities[:1]) is DataOrigin.MEASURED
    assert DataOrigin.of_devices([]) is DataOrigin.UNKNOWN


def test_a_recording_of_an_older_station_opens_with_an_unknown_origin(station: Station) -> None:
    assert read_manifest(GOLDEN).origin is DataOrigin.UNKNOWN
    assert "measured or simulated: not recorded" in station("info", GOLDEN).out
