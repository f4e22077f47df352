"""Measured and simulated data in separate folders, by the identities of the devices and by the manifests."""

import json
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import pytest

from recordings.manifest import DataOrigin
from recordings.reader import open_recording, read_manifest
from recordings.samples import DeviceIdentity, Stream
from station.bench.session_folder import (
    RESERVE_BYTES,
    USUAL_TRIAL_S,
    DiskMonitor,
    bytes_free,
    bytes_needed,
    check_folder,
)
from station.bench.simulation import SimulatedBench
from station.bench.trial_recorder import TrialRecorder, TrialRefused
from station.clock import ManualClock
from station.config import StationConfig, parse_config
from station.files.timed_replay import replay
from station.journal import read_journal
from station.messages.bench_messages import RefusalCode, TrialCode
from station.protocol import TrialSpec
from tests.refusals import raises_refusal
from tests.station.bench.test_trial_recorder import CONFIG
from tests.station.command import Ran, assert_refused
from tests.station.fake_devices import FakeCapture, FakeDaq, FakeMocap
from tests.station.session.benched import Recorder, simulated_bench

Station = Callable[..., Ran]
Running = tuple[SimulatedBench, StationConfig]
GOLDEN = Path(__file__).parents[2] / "recordings" / "golden" / "format_1.mcap"
FORCE = Stream("/force", "V", ("force",), 1000.0, "NI Dev1")
MARKERS = Stream("/markers", "mm", tuple("abcde"), 100.0, "QTM")
CUFF = {"anchor_markers": ["a", "b", "c"], "cuff_markers": ["d"], "site": "arm"}
TWO_CUFFS = parse_config({"cuffs": {"one": CUFF, "two": CUFF}, "protocol": {"repeats": 3}}, "test")


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    with simulated_bench(tmp_path_factory.mktemp("bench"), swing_s=2.0) as both:
        yield both


@pytest.fixture(scope="module")
def simulated(running: Running, tmp_path_factory: pytest.TempPathFactory) -> Path:
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


def test_the_identities_of_the_devices_are_in_the_manifest_and_the_origin_in_the_journal_and_in_info(
    simulated: Path, station: Station
) -> None:
    manifest = read_manifest(simulated)
    assert manifest.origin is DataOrigin.SIMULATED
    assert [device.is_simulated for device in manifest.devices] == [True, True]
    assert manifest.devices[0].text == "USB-6008 serial number 01C0FFEE"
    assert manifest.devices[1].text == "QTM Version is 2024.3 (build 17700), simulated"
    assert [recorded.origin for recorded in read_journal(simulated.parent).recorded] == ["simulated"]
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


def test_simulated_devices_are_not_recorded_among_measured_sessions(running: Running, tmp_path: Path) -> None:
    with Recorder(running[1], tmp_path / "monday", running[0].clock_port) as recorder:
        refusal = recorder.end()
    assert refusal["code"] == RefusalCode.SIMULATED_DEVICES
    assert str(tmp_path / "simulated" / "monday") in refusal["refused"]
    assert not list(tmp_path.rglob("*.mcap"))


@pytest.mark.parametrize(("is_simulated", "origin"), [(True, "simulated"), (False, "measured"), (None, "unknown")])
def test_the_origin_of_a_trial_is_that_of_its_devices_and_of_all_trials_of_its_session(
    tmp_path: Path, is_simulated: bool | None, origin: str
) -> None:
    folder = tmp_path / "simulated"
    assert open_recording(record(folder, is_simulated)).manifest.origin == origin
    if is_simulated is not None:
        with raises_refusal(RefusalCode.MIXED_ORIGIN, kind=TrialRefused):
            record(folder, not is_simulated)
        record(folder, is_simulated, "dynamic")
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


def test_the_monitor_polls_once_a_second_and_warns_below_the_reserve_and_of_a_recording_that_was_moved(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, clock = tmp_path / "a.mcap", ManualClock()
    path.touch()
    usage = Mock(return_value=SimpleNamespace(free=RESERVE_BYTES))
    monkeypatch.setattr(shutil, "disk_usage", usage)
    monitor = DiskMonitor(path, clock)
    for _ in range(30):
        assert monitor.poll() is None
        clock.advance(0.1)
    assert usage.call_count == 3
    usage.return_value.free = RESERVE_BYTES - 1e6
    clock.advance(1.0)
    warning = monitor.poll()
    assert warning is not None and warning.figures["free_mb"] == 49.0
    usage.side_effect = OSError(5, "Input/output error")
    assert DiskMonitor(path, ManualClock()).poll() is None, "a disk without an answer has no warning"
    monitor = DiskMonitor(path, ManualClock())
    path.unlink()
    moved = monitor.poll()
    assert moved is not None and moved.code is TrialCode.RECORDING_MOVED


def test_the_plan_needs_all_of_its_trials_and_the_reserve(tmp_path: Path) -> None:
    a_second = 1000 * 8 + 100 * 5 * 16
    expected = RESERVE_BYTES + 1.1 * 12 * USUAL_TRIAL_S * a_second
    assert bytes_needed([FORCE, MARKERS], TWO_CUFFS, tmp_path, None) == pytest.approx(expected)


def test_recorded_trials_need_no_space_and_one_trial_always_does(tmp_path: Path) -> None:
    one = 1.1 * 10.0 * 1000 * 8
    for done in range(14):
        needed = bytes_needed([FORCE], TWO_CUFFS, tmp_path, 10.0) - RESERVE_BYTES
        assert needed == pytest.approx(one * max(1, 12 - done))
        (tmp_path / f"{done}.mcap").touch()


def test_the_free_space_of_a_missing_folder_is_that_of_its_parent(tmp_path: Path) -> None:
    assert bytes_free(tmp_path / "not" / "yet") == pytest.approx(shutil.disk_usage(tmp_path).free, rel=0.1)
