"""A trial with an EMG amplifier that has a clock of its own beside DAQ and mocap system."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from drivers.errors import DeviceLost
from drivers.lsl import LslEmg
from drivers.nidaq import NiDaq
from fitting.wearer.wearer_trial import read_wearer_trial
from recordings.manifest import BodyMarkers, CuffSite
from recordings.samples import Item, Loss, Samples, Stream
from station.bench.devices import devices_for
from station.bench.simulation import simulator_settings
from station.bench.trial_recorder import TrialRecorder
from station.bench.view import TrialState
from station.clock import ManualClock
from station.config import parse_config
from station.messages.bench_messages import TrialCode
from station.protocol import TrialSpec
from tests.drivers.pytest_on_loopback import passed_on_loopback
from tests.drivers.test_lsl import fake_outlet, offer
from tests.station.bench_by_hand import STREAMS, Bench
from tests.station.fake_devices import FakeCapture, FakeDaq, FakeMocap

EMG = Stream("/emg", "uV", ("a", "b"), 100.0, "LSL outlet amp at pc")
LSL_CONFIG = {"emg": {"source": "lsl", "stream": "amp", "sync_channel": "t"}, "body": {"markers": ["a", "b", "c"]}}


class BenchWithAmplifier(Bench):
    """The amplifier's clock reads ahead_s when the bench's reads 0; more of its streams are without a sample."""

    def __init__(self, ahead_s: float, *more: Stream) -> None:
        super().__init__()
        self.more = more
        self.ahead_s, self.emg_sends, self._sent = ahead_s, True, 0

    def arm(self, armed_s: float = 0.0) -> Bench:
        owners = {"/force": "NI Dev1", "/sync": "NI Dev1", "/markers": "QTM", "/emg": "LSL amp"}
        self.trial.arm([*STREAMS, EMG, *self.more], owners | {stream.name: "LSL amp" for stream in self.more})
        self.run(armed_s)
        return self

    def send_daq(self, volts: np.ndarray) -> None:
        super().send_daq(volts)
        if self.emg_sends:
            numbers = np.arange(self._sent, self._sent + 10, dtype=np.uint64)
            self._sent += 10
            times = numbers.astype(np.int64) * 10_000_000 + int(self.ahead_s * 1e9)
            self.trial.handle(Samples("/emg", numbers, times, self.clock.utc_ns(), np.zeros((10, 2))))


@pytest.mark.parametrize("ahead_s", [-500.0, 0.0, 1e6])
def test_emg_before_the_edge_is_kept_with_any_clock_of_the_amplifier(ahead_s: float) -> None:
    bench = BenchWithAmplifier(ahead_s)
    bench.record(2.0, armed_s=6.0)
    numbers = np.concatenate([block.sample_numbers for block in bench.writer.samples("/emg")])
    assert (np.diff(numbers) == 1).all()
    assert 400 <= 600 - int(numbers[0]) + 200 <= 520, (
        "two seconds of pre-roll, at most one more, and two since the edge"
    )


def test_the_end_of_an_earlier_capture_keeps_the_emg() -> None:
    bench = BenchWithAmplifier(-500.0)
    bench.level = 5.0
    bench.arm()
    bench.run(1.0)
    bench.level = 0.0
    bench.run(1.0)
    bench.start_capture()
    bench.run(1.0)
    assert int(bench.writer.samples("/emg")[0].sample_numbers[0]) == 0


def lose(bench: BenchWithAmplifier) -> None:
    bench.emg_sends = False
    bench.trial.fail(DeviceLost("LSL amp is gone"), "LSL amp")


@pytest.mark.parametrize("code", [TrialCode.DEVICE_SILENT, TrialCode.DEVICE_LOST])
def test_an_amplifier_that_falls_silent_or_is_lost_is_noted_and_counted_and_the_trial_goes_on(code: TrialCode) -> None:
    bench = BenchWithAmplifier(10.0)
    bench.record(2.0, armed_s=3.0)
    if code is TrialCode.DEVICE_LOST:
        lose(bench)
    bench.emg_sends = False
    bench.run(4.0)
    assert bench.codes == [TrialCode.RECORDING, code]
    bench.stop_capture(2.0)
    assert (bench.trial.state, bench.codes) == (TrialState.CLOSED, [TrialCode.CAPTURE_ENDED, code])
    (loss,) = (item for item in bench.writer.items if isinstance(item, Loss))
    assert (loss.stream, loss.first_missing) == ("/emg", 500) and loss.count == pytest.approx(400, abs=20)


def test_an_amplifier_that_is_lost_before_the_capture_does_not_disarm_the_trial() -> None:
    bench = BenchWithAmplifier(10.0)
    bench.arm()
    lose(bench)
    bench.run(3.0)
    bench.start_capture()
    bench.run(1.0)
    assert bench.codes[0] is TrialCode.RECORDING


def test_a_clock_of_the_amplifier_that_is_measured_seldom_is_no_silent_amplifier() -> None:
    bench = BenchWithAmplifier(10.0, Stream("/emg_clock", "s", ("offset",), 0.2, EMG.source))
    bench.record(10.0)
    assert bench.codes == [TrialCode.RECORDING]
    bench.stop_capture(2.0)
    assert (bench.trial.state, bench.codes) == (TrialState.CLOSED, [TrialCode.CAPTURE_ENDED])
    assert not [item for item in bench.writer.items if isinstance(item, Loss)]


class PlayedOutlet(LslEmg):
    """The driver on an outlet that sends 1 kHz of station time with these stamps: (n,) s → (n,) s."""

    def __init__(self, clock: ManualClock, stamped: Callable[[np.ndarray], np.ndarray]) -> None:
        super().__init__(stream="amp", host_clock=clock.utc_ns)
        self._clock, self._stamped, self._sent, self.outlet = clock, stamped, 0, fake_outlet()

    def read(self, timeout_s: float) -> Sequence[Item]:
        due = round(self._clock.station_s() * 1000)
        if due > self._sent:
            stamps = self._stamped(np.arange(self._sent, due) / 1000)
            self._sent = due
            return self._items(np.ones((len(stamps), 2)), stamps)
        return []


def one_wrong(stamp: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda time_s: np.where(np.round(time_s, 3) == 5.0, stamp, time_s)


def jump(seconds: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda time_s: np.where(time_s >= 5.0, time_s + seconds, time_s)


STAMPS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    **{f"one of {stamp:g}": one_wrong(stamp) for stamp in (np.nan, np.inf, -np.inf, 1e300, -1e300, 1e9)},
    **{f"jump of {seconds:g} s": jump(seconds) for seconds in (1e9, 2e5, -2e5, 1e300, np.inf, np.nan)},
    "all of 0": lambda time_s: np.zeros(len(time_s)),
    "there and back": lambda time_s: time_s + 2e5 * (np.round(time_s) % 2),
}


@pytest.mark.parametrize("name", STAMPS)
def test_stamps_that_are_wrong_end_no_trial_and_lose_no_frame(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """From the driver through recorder and file to the fit."""
    clock = ManualClock()
    capture = FakeCapture(clock, 3.0, 4.0)
    emg = PlayedOutlet(clock, STAMPS[name])
    offer(monkeypatch, emg.outlet)
    devices = [FakeDaq(clock, capture), FakeMocap(clock, capture, ("a", "b", "c")), emg]
    config = parse_config({**LSL_CONFIG, "emg": {"source": "lsl", "stream": "amp"}}, "test")
    recorder = TrialRecorder(config, clock, make_devices=lambda *_: devices)  # type: ignore[arg-type,return-value]
    result = recorder.record(tmp_path, TrialSpec(None, "motion", 1, condition="unsuited"))
    assert result.accepted and result.path is not None
    assert result.lost_samples <= 8000, "the rate allows no more in 8 s"
    trial = read_wearer_trial(result.path)
    assert len(trial.time) == 400 and np.isfinite(trial.markers).all()


def test_an_outlet_is_a_device_of_the_wearer_s_trials_only(tmp_path: Path) -> None:
    config, clock = parse_config(LSL_CONFIG, "test"), ManualClock()
    cuff = CuffSite("hand", "arm", ("a", "b", "c"), ("d",))
    of_wearer, of_cuff, of_check = (
        [type(device.device) for device in devices_for(config, subject, clock, tmp_path)]
        for subject in (BodyMarkers(("a", "b", "c")), cuff, None)
    )
    assert of_wearer == of_check
    assert of_wearer[0] is NiDaq and of_wearer[-1] is LslEmg
    assert LslEmg not in of_cuff
    assert simulator_settings(config)["wiring"]["emg"] == {}, "the simulated bench has no outlet"


@pytest.mark.slow
def test_emg_of_another_process_is_recorded_with_a_motion_and_reaches_its_fit(tmp_path: Path) -> None:
    assert passed_on_loopback("tests/station/bench/emg_outlet_on_loopback.py", "test_", tmp_path) == 3
