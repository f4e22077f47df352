"""Trials with a load cell on a serial line, and trials of the wearer."""

import io
import socket
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from drivers.errors import DeviceCode, DeviceUnavailable
from drivers.serial_load_cell import SerialLoadCell
from drivers.simulators.simulated_bench import Bench
from fitting.errors import UnusableTrial
from fitting.results.trial_codes import RejectionCode
from fitting.trial.mass_checks import read_checks
from fitting.trial.trial import read_trial
from recordings.reader import open_recording
from recordings.samples import Item
from station.bench.bench_clock import BenchClock
from station.bench.check import (
    DeviceSurvey,
    check_device,
    check_known_mass,
    inspect_bench,
    show_results,
    survey_devices,
)
from station.bench.feed import DeviceFailed
from station.bench.trial_recorder import TrialRecorder
from station.clock import RealClock
from station.config import StationConfig
from station.files.timed_replay import replay
from station.fit import SessionError, fit_session_folder
from station.messages.bench_messages import CheckCode
from station.messages.setup_messages import FolderCode
from station.protocol import TrialSpec
from station.recordings_of_session import pulls_in
from tests.refusals import raises_refusal
from tests.station.command import Ran
from tests.station.session.benched import config_at
from tests.station.wearer import BODY, SPECS, WearerSession

Station = Callable[..., Ran]
MakeBench = Callable[..., Bench]
SPEED = 5.0
HELD = 9.80665 * 3.0 + 2.0  # N, the weight and the hook
POSE, FREE, TIGHT = SPECS


@pytest.fixture
def bench(simulated_bench: MakeBench) -> Bench:
    static = {"lead_in_s": 2.0, "hold_s": 4.0, "step_masses_kg": [3.0]}
    return simulated_bench(SPEED, protocol={"static": static}, mocap={"occlusions_per_minute": 0})


@pytest.fixture
def config(bench: Bench) -> StationConfig:
    serial = {"source": "serial", "port": f"socket://127.0.0.1:{bench.ports['serial']}", "capacity_kg": 25}
    certificate = {"serial_number": "S9", "calibrated_on": "2026-03-01", "gain_relative_sd": 0.001}
    return config_at(bench.ports, load_cell=serial | certificate)


class Reporting(SerialLoadCell):
    """Its report of a line has reached the check when it is read again."""

    has_reported = is_delivered = False

    def read(self, timeout_s: float) -> Sequence[Item]:
        self.is_delivered = self.has_reported
        items = super().read(timeout_s)
        self.has_reported |= bool(items)
        return items


class ClockAfterReport(RealClock):
    """Its wall time passes with every look, once the report is delivered: a busy machine may send no line for long."""

    def __init__(self, device: Reporting) -> None:
        super().__init__()
        self._device, self._looks = device, 0

    def wall_s(self) -> float:
        self._looks += self._device.is_delivered
        return 0.01 * self._looks


@pytest.mark.parametrize("line", [b"+12.345 kg", b"  12.3 lb", b"+3.2", b""])
def test_the_line_of_an_indicator_with_another_unit_is_shown(line: bytes, tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def send() -> None:
            with suppress(OSError), listener.accept()[0] as connection:  # until the check closes the port
                while True:
                    connection.sendall(line + b"\r\n")
                    time.sleep(0.02)

        threading.Thread(target=send, daemon=True).start()
        port = f"socket://127.0.0.1:{listener.getsockname()[1]}"
        device = Reporting(port=port, baud_rate=9600, line_format="usb220", host_clock=time.time_ns)
        survey, (name,) = survey_devices(StationConfig(), tmp_path, ClockAfterReport(device), lambda *_: [device], 0.3)
    assert len(survey.force()) == 0
    result = check_device(survey, name)
    assert not result.is_good and result.message.code is CheckCode.UNREADABLE
    assert f'the line "{line.decode()}"' in result.found


def test_the_code_of_a_device_error_is_that_of_the_check() -> None:
    survey = DeviceSurvey()
    survey.handle(DeviceFailed("NI Dev1", DeviceUnavailable("no server", DeviceCode.NO_SERVER)))
    result = check_device(survey, "NI Dev1")
    assert result.to_json()["code"] == DeviceCode.NO_SERVER
    out = io.StringIO()
    assert show_results([result], Console(file=out, width=200)) == 1
    assert f"[{DeviceCode.NO_SERVER.value}]" in out.getvalue()


def test_zero_and_certificate_are_checked(config: StationConfig, tmp_path: Path) -> None:
    out = Console(file=io.StringIO(), width=200)
    assert check_known_mass(config, tmp_path, 0.0, out, listen_s=0.5) == 0
    (zero,) = read_checks(tmp_path)
    assert zero.found == pytest.approx(2.0, abs=0.1), "the hook alone, in newtons though the line tells pounds"
    results = {result.subject: result for result in inspect_bench(config, tmp_path)}
    figures = results["calibration of the load cell"].message.figures
    assert (figures["serial_number"], figures["calibrated_on"]) == ("of S9 ", "2026-03-01")
    assert results["force at rest"].is_good


def test_a_trial_of_it_is_in_newtons_and_its_clocks_are_certified(
    bench: Bench, config: StationConfig, tmp_path: Path
) -> None:
    with BenchClock(bench.ports["clock"], speed=1000.0) as clock:
        result = TrialRecorder(config, clock).record(tmp_path, TrialSpec("waist", "static", 1))
    assert result.accepted and result.path is not None, result.sentence
    trial = read_trial(result.path)
    assert trial.force.max() == pytest.approx(HELD, rel=0.05)
    assert trial.sync is not None and trial.sync.has_both_edges
    assert trial.sync.errors.time == pytest.approx(0.05, rel=0.01), "lines are stamped when they arrive"
    assert trial.sync.errors.force == pytest.approx(0.05 * trial.sync.force_rate, rel=0.01)
    assert trial.sync.force_rate > 20.0


def test_every_trial_is_complete_accepted_and_named_after_its_condition_and_a_pose_ends_by_itself(
    wearer: WearerSession,
) -> None:
    motions = [f"condition-{condition}_test-motion_run-1.mcap" for condition in ("unsuited", "tight")]
    assert list(wearer.results) == ["test-pose_run-1.mcap", *motions]
    for result in wearer.results.values():
        assert result.accepted and not result.lost_samples, result.sentence
        assert result.path is not None and open_recording(result.path).complete
    ends = [[message.code for message in wearer.results[spec.file_name(1)].messages] for spec in SPECS]
    assert ends == [["duration_reached"], ["capture_ended"], ["capture_ended"]]


def test_the_manifest_has_markers_condition_and_emg_gains(wearer: WearerSession) -> None:
    manifests = {spec: open_recording(wearer.path(spec)).manifest for spec in SPECS}
    assert [manifest.condition for manifest in manifests.values()] == [None, "unsuited", "tight"]
    for spec, manifest in manifests.items():
        assert manifest.cuff is manifest.bounce is None
        assert manifest.body is not None and manifest.body.body == tuple(BODY["markers"])
        assert (manifest.body.is_cord_measured, bool(manifest.body.suit)) == (spec is TIGHT, spec is TIGHT)
        assert manifest.emg is not None and manifest.emg.gains == {"deltoid": 500.0, "trapezius": 500.0}
        assert manifest.protocol.cycles == 3


def test_emg_force_and_markers_are_in_the_file(wearer: WearerSession) -> None:
    recording = open_recording(wearer.path(TIGHT))
    force, sync, emg, markers = (recording.load(name) for name in ("/force", "/sync", "/emg", "/markers"))
    assert emg.stream.labels == ("deltoid", "trapezius")
    np.testing.assert_array_equal(emg.sample_numbers, sync.sample_numbers)
    seconds = len(emg.values) // 1000
    rms = np.sqrt(np.mean(emg.values[: seconds * 1000].reshape(seconds, 1000, 2) ** 2, axis=1))
    assert np.all(rms.max(axis=0) > 5 * rms.min(axis=0)), "active in the raises, silent between them"
    newtons = (force.values * recording.manifest.load_cell.newtons_per_unit).ravel()
    assert 20 < newtons.max() < 80, "the cord"
    cord = [markers.stream.labels.index(label) for label in BODY["suit_markers"]]
    assert np.isfinite(markers.values[:, cord]).mean() > 0.95


def test_a_replay_holds_the_same_samples_under_the_same_name(wearer: WearerSession, tmp_path: Path) -> None:
    for spec in (POSE, TIGHT):
        result = replay(wearer.path(spec), tmp_path, 500.0)
        assert result.accepted and result.path == tmp_path / spec.file_name(1), result.sentence
        before, after = open_recording(wearer.path(spec)), open_recording(result.path)
        assert (after.manifest.body, after.manifest.emg) == (before.manifest.body, before.manifest.emg)
        for stream in before.streams:
            once, again = before.load(stream.name), after.load(stream.name)
            np.testing.assert_array_equal(once.sample_numbers, again.sample_numbers)
            np.testing.assert_array_equal(once.values, again.values)


def test_no_fit_uses_a_pose_or_motion(wearer: WearerSession) -> None:
    assert pulls_in(wearer.folder) == []
    with raises_refusal(FolderCode.NO_RECORDING, kind=SessionError):
        fit_session_folder(wearer.folder, None)
    for spec in (POSE, TIGHT):
        with pytest.raises(UnusableTrial) as caught:
            read_trial(wearer.path(spec))
        assert caught.value.reason.code is RejectionCode.IS_WEARER_TRIAL


@pytest.mark.parametrize(
    "words",
    [
        ("--test", "motion"),
        ("--test", "motion", "--condition", "loose"),
        ("--test", "motion", "--condition", "tight", "--cuff", "hand"),
        ("--test", "static", "--cuff", "hand", "--condition", "tight"),
        ("--condition", "tight"),
    ],
)
def test_a_condition_needs_a_motion_and_a_cuff_needs_a_pull(station: Station, words: tuple[str, ...]) -> None:
    ran = station("record", "--config", "station.toml", "--session", "none", *words)
    assert (ran.code, ran.out) == (2, "")
