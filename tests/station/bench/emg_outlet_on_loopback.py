"""A motion with EMG from another process, from the recording to the fit (test_emg_outlet.py runs this file)."""

import json
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest

from drivers import lsl
from drivers.device import Device
from drivers.simulators.settings import settings_from_dict
from drivers.simulators.simulated_bench import Bench
from drivers.simulators.world import World
from fitting.results.trial_codes import TrialNoteCode
from fitting.wearer.wearer_trial import read_wearer_trial
from recordings.contents import read_contents
from recordings.samples import Item
from station.bench.bench_clock import BenchClock
from station.bench.devices import devices_for
from station.bench.simulation import simulator_settings
from station.bench.trial_recorder import TrialRecorder
from station.clock import Clock
from station.config import parse_config
from station.protocol import TrialSpec
from tests.drivers.contract import blocks
from tests.drivers.lsl_sender import RATE_HZ, LslSender
from tests.station.wearer import wearer_config

NAME, SPEC = "amplifier", TrialSpec(None, "motion", 1, condition="unsuited")
DRIFT = 2e-4
"""Relative error of the amplifier's clock: 2 ms in a trial of ten seconds."""
LOST = range(5000, 5300)
"""Samples that the amplifier does not send, within the capture."""


class Amplifier(Device):
    """The driver, with a sender that has sent the samples of the world up to the station's time before it is read."""

    def __init__(self, device: Device, world: World, clock: Clock, sender: LslSender) -> None:
        self._device, self._world, self._clock, self._sender = device, world, clock, sender
        self._start_s, self._next = clock.station_s(), 0

    name = property(lambda self: self._device.name)
    streams = property(lambda self: self._device.streams)
    identity = property(lambda self: self._device.identity)

    def open(self) -> None:
        self._device.open()
        assert self._sender.ask(consumer=20.0)["consumer"] is True

    def close(self) -> None:
        self._device.close()

    def read(self, timeout_s: float) -> Sequence[Item]:
        items, expected = list(self._device.read(timeout_s)), self._send()
        while sum(len(block.sample_numbers) for block in blocks(items, "/emg")) < expected:
            items += self._device.read(0.05)
        return items

    def _send(self) -> int:
        """Send the samples from the last one to the present; returns their number."""
        end = int((self._clock.station_s() - self._start_s) * RATE_HZ / (1 + DRIFT))
        numbers = np.array([n for n in range(self._next, end) if n not in LOST])
        self._next = max(self._next, end)
        if not len(numbers):
            return 0
        person, time = self._world.person, self._start_s + numbers / RATE_HZ * (1 + DRIFT)
        assert person is not None
        columns = [1e6 * person.emg(name, time) for name in ("deltoid", "trapezius")]
        rows = np.column_stack([*columns, self._world.sync_voltage(time) > 2.5])
        self._sender.ask(rows=rows.tolist(), stamps_s=(numbers / RATE_HZ).tolist())
        return len(numbers)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, World]]:
    """Recording of a motion, and the world that it was recorded in."""
    folder = tmp_path_factory.mktemp("outlet") / "simulated" / "session"
    plain = wearer_config().model_dump(mode="json")
    plain["body"]["cycles"] = 2
    settings = settings_from_dict(simulator_settings(parse_config(plain, "the bench")))
    with Bench(settings, speed=None, seed=5) as bench, LslSender(NAME) as sender, pytest.MonkeyPatch.context() as patch:
        patch.setattr(lsl, "TWIN_TIMEOUT_S", 0.1)
        plain["emg"] = {"source": "lsl", "stream": NAME, "sync_channel": "trigger"}
        plain["daq"]["grpc_target"] = f"127.0.0.1:{bench.ports['ni']}"
        plain["mocap"] |= {"host": "127.0.0.1", "port": bench.ports["qtm"]}
        bench.world.select_trial(None, SPEC.test, SPEC.condition)
        with BenchClock(bench.ports["clock"]) as clock:

            def make_devices(*arguments: object) -> list[Device]:
                devices = devices_for(*arguments)  # type: ignore[arg-type]
                assert devices[-1].name == f"LSL {NAME}"
                return [*devices[:-1], Amplifier(devices[-1], bench.world, clock, sender)]

            recorder = TrialRecorder(parse_config(plain, "the station"), clock, make_devices=make_devices)
            result = recorder.record(folder, SPEC)
        assert result.path is not None and result.accepted, result.sentence
        yield result.path, bench.world


def test_the_losses_of_the_outlet_are_counted_in_the_recording(recorded: tuple[Path, World], station) -> None:
    contents = read_contents(recorded[0])
    gaps = {gap.stream: (gap.first_missing, gap.count) for gap in contents.gaps}
    assert gaps == {stream: (LOST.start, len(LOST)) for stream in ("/emg", "/emg_sync")}
    assert contents.complete
    ran = station("info", recorded[0])
    assert ran.code == 3
    assert "EMG: lsl" in ran.out and "gap in /emg: 300 samples" in ran.out


def test_the_sync_pulse_puts_the_emg_on_the_clock_of_the_markers(recorded: tuple[Path, World]) -> None:
    trial, (_, world) = read_wearer_trial(recorded[0]), recorded
    assert trial.emg is not None and world.capture is not None and world.person is not None
    assert (trial.emg.labels, trial.emg.unit) == (("deltoid", "trapezius"), "V")
    assert TrialNoteCode.EMG_HOST_CLOCK not in {note.code for note in trial.notes}
    assert not trial.emg.time_sd > 1e-3
    drawn = world.person.emg("deltoid", world.capture.start + trial.emg.time)
    assert np.corrcoef(drawn, trial.emg.values[:, 0])[0, 1] > 0.9, "noise of up to 450 Hz: within half a millisecond"
    ((start, end),) = trial.emg.gaps()
    assert end - start == pytest.approx(0.301 * (1 + DRIFT), abs=2e-5)


def test_the_recording_is_replayed_exported_and_compared(recorded: tuple[Path, World], station, tmp_path: Path) -> None:
    path, _ = recorded
    again = tmp_path / "simulated" / "again"
    assert station("replay", path, "--session", again, "--speed", 500).code == 3, (
        "the losses are those of the recording"
    )
    before, after = read_wearer_trial(path), read_wearer_trial(again / path.name)
    assert before.emg is not None and after.emg is not None
    np.testing.assert_array_equal(after.emg.values, before.emg.values)
    np.testing.assert_array_equal(after.emg.time, before.emg.time)
    assert station("export", path, "--to", "csv", "--output", tmp_path).code == 3, "0.3 s of EMG are lost"
    table = np.loadtxt(tmp_path / f"{path.stem}_emg.csv", delimiter=",", skiprows=1)
    np.testing.assert_array_equal(table[:, 1:], before.emg.values)
    assert json.loads((tmp_path / f"{path.stem}.csv.json").read_text())["emg"]["lost_s"]
    ran = station("emg", path, "--output", tmp_path)
    assert ran.code == 1, "a gap of 0.3 s leaves no usable channel"
    assert "(deltoid gap, trapezius gap)" in ran.err
