from __future__ import annotations

import numpy as np
import pytest

from recordings.samples import Event, Item, Loss, Samples, Stream
from station.clock import ManualClock
from station.session import State, TrialRules, TrialSession

STREAMS = [Stream(n, "V", (n[1:],), 1000.0, "NI Dev1") for n in ("/force", "/sync")] + [
    Stream("/markers", "mm", ("anchor_1",), 100.0, "QTM 127.0.0.1:22223")
]
BLOCK_S = 0.1


class Recorder:
    def __init__(self) -> None:
        self.items: list[Item] = []

    def write(self, item: Item) -> None:
        self.items.append(item)

    def flush_if_due(self) -> None:
        pass

    def samples(self, stream: str) -> list[Samples]:
        return [i for i in self.items if isinstance(i, Samples) and i.stream == stream]

    def events(self) -> list[str]:
        return [i.kind for i in self.items if isinstance(i, Event)]


class Bench:
    """Devices by hand: a DAQ that sends a block every 0.1 station seconds and a mocap that sends while capturing."""

    def __init__(
        self,
        start: str = "sync_edge",
        timeout_s: float = 10.0,
        duration_s: float | None = None,
        speed: float = 1.0,
    ) -> None:
        self.clock, self.recorder = ManualClock(speed), Recorder()
        rules = TrialRules(start, 2.5, timeout_s, duration_s)  # type: ignore[arg-type]
        self.session = TrialSession(rules, self.recorder, self.clock)
        self.sample, self.frame, self.level, self.capturing = 0, 1, 0.0, False
        self.daq_sends = self.mocap_sends = True

    def arm(self) -> Bench:
        self.session.arm(STREAMS, {"/force": "NI Dev1", "/sync": "NI Dev1", "/markers": "QTM"})
        return self

    def run(self, station_s: float) -> None:
        for _ in range(round(station_s / BLOCK_S)):
            self.clock.advance(BLOCK_S / self.clock.speed)
            if self.daq_sends:
                self.send_daq(np.full(100, self.level))
            if self.capturing and self.mocap_sends:
                self.send_frames(10)
            self.session.tick()

    def send_daq(self, volts: np.ndarray) -> None:
        numbers = np.arange(self.sample, self.sample + len(volts), dtype=np.uint64)
        self.sample += len(volts)
        for stream in ("/force", "/sync"):
            values = volts[:, None] if stream == "/sync" else np.zeros((len(volts), 1))
            times = numbers.astype(np.int64) * 1_000_000
            self.session.handle(Samples(stream, numbers, times, self.clock.utc_ns(), values))

    def send_frames(self, count: int) -> None:
        numbers = np.arange(self.frame, self.frame + count, dtype=np.uint64)
        self.frame += count
        values = np.zeros((count, 1, 4), dtype=np.float32)
        times = numbers.astype(np.int64) * 10_000_000
        self.session.handle(Samples("/markers", numbers, times, self.clock.utc_ns(), values))

    def event(self, kind: str) -> None:
        self.session.handle(Event(kind, kind, self.clock.utc_ns(), "QTM"))

    def start_capture(self) -> None:
        self.level, self.capturing = 5.0, True
        self.event("capture_started")

    def stop_capture(self, with_event: bool = True) -> None:
        self.level, self.capturing = 0.0, False
        if with_event:
            self.event("capture_stopped")


def test_a_trial_runs_from_the_edge_to_the_capture_s_end_and_is_accepted() -> None:
    bench = Bench().arm()
    bench.run(3.0)
    assert bench.session.state is State.ARMED
    assert bench.recorder.items == []
    bench.start_capture()
    bench.run(5.0)
    assert bench.session.state is State.RECORDING
    bench.stop_capture()
    assert bench.session.state is State.CLOSING
    bench.run(2.0)
    assert bench.session.state is State.CLOSED
    assert {"armed", "capture_started", "sync_edge", "capture_stopped", "capture_ended"} >= set(bench.recorder.events())
    sync = np.concatenate([s.values[:, 0] for s in bench.recorder.samples("/sync")])
    assert sync[-1] == 0.0, "the falling edge is recorded too"


def test_exactly_the_last_two_seconds_before_the_edge_are_kept_of_the_daq() -> None:
    bench = Bench().arm()
    bench.run(7.0)
    bench.start_capture()
    bench.run(0.1)
    first = bench.recorder.samples("/force")[0].sample_numbers[0]
    assert first == 5000


def test_marker_frames_that_came_before_the_block_with_the_edge_are_kept() -> None:
    bench = Bench(speed=30.0).arm()
    bench.run(3.0)
    bench.capturing = True
    for _ in range(5):  # frames arrive at once, the DAQ's block a good deal later
        bench.send_frames(10)
        bench.clock.advance(0.1)
    bench.send_daq(np.r_[np.zeros(50), np.full(50, 5.0)])
    assert bench.session.state is State.RECORDING
    assert sum(len(s.sample_numbers) for s in bench.recorder.samples("/markers")) == 50


def test_the_duration_counts_from_the_edge_on_the_daq_s_clock() -> None:
    bench = Bench(duration_s=4.0).arm()
    bench.run(3.0)
    bench.start_capture()
    bench.run(4.5)
    assert bench.session.state is State.CLOSING
    bench.run(1.0)
    assert bench.session.state is State.CLOSED
    assert bench.session.sentence == "4 s recorded after the edge"


def test_frames_that_come_after_the_capture_s_end_are_another_s_and_are_not_recorded() -> None:
    bench = Bench().arm()
    bench.run(3.0)
    bench.start_capture()
    bench.run(2.0)
    bench.stop_capture()
    recorded = len(bench.recorder.samples("/markers"))
    bench.frame = 1
    bench.send_frames(10)
    bench.session.handle(Loss("/markers", "skipped", 11, 5, 0, bench.clock.utc_ns()))
    bench.run(2.0)
    assert (len(bench.recorder.samples("/markers")), bench.session.lost_samples) == (recorded, 0)


def test_a_capture_that_ends_first_ends_the_trial_before_its_duration() -> None:
    bench = Bench(duration_s=100.0).arm()
    bench.run(1.0)
    bench.start_capture()
    bench.run(3.0)
    bench.stop_capture()
    bench.run(2.0)
    assert (bench.session.state, bench.session.sentence) == (State.CLOSED, "the mocap capture ended")


def test_a_mocap_system_without_events_ends_its_capture_by_line_and_silence() -> None:
    bench = Bench().arm()
    bench.run(1.0)
    bench.level, bench.capturing = 5.0, True
    bench.run(3.0)
    bench.stop_capture(with_event=False)
    bench.run(4.0)
    assert bench.session.state is State.CLOSED


def test_a_short_sync_pulse_does_not_end_the_trial() -> None:
    bench = Bench().arm()
    bench.run(1.0)
    bench.start_capture()
    bench.run(0.2)
    bench.level = 0.0
    bench.run(5.0)
    assert bench.session.state is State.RECORDING


@pytest.mark.parametrize(("level", "words"), [(0.0, "stands at 0.00 V"), (5.0, "stands at 5.00 V since arming")])
def test_no_edge_in_time_fails_with_the_level_seen(level: float, words: str) -> None:
    bench = Bench(timeout_s=6.0).arm()
    bench.level = level
    bench.run(6.5)
    assert bench.session.state is State.FAILED
    assert not bench.session.has_edge
    assert words in bench.session.sentence
    assert bench.recorder.items == []


def test_a_glitch_while_armed_starts_nothing_and_is_in_the_file() -> None:
    bench = Bench().arm()
    bench.run(2.5)
    spike = np.zeros(100)
    spike[40:43] = 5.0
    bench.send_daq(spike)
    assert bench.session.state is State.ARMED
    bench.start_capture()
    bench.run(3.0)
    assert bench.session.state is State.RECORDING, "nor is the glitch's end taken for an inverted edge"
    assert "sync_glitch" in bench.recorder.events()


def test_an_inverted_line_is_named_when_the_capture_starts() -> None:
    bench = Bench().arm()
    bench.level = 5.0
    bench.run(3.0)
    bench.level, bench.capturing = 0.0, True
    bench.event("capture_started")
    bench.run(2.0)
    assert bench.session.state is State.FAILED
    assert "fell from 5.00 V to 0.00 V" in bench.session.sentence


def test_the_end_of_an_earlier_capture_is_no_wrong_polarity() -> None:
    bench = Bench().arm()
    bench.level = 5.0
    bench.run(2.0)
    bench.level = 0.0
    bench.run(3.0)
    bench.start_capture()
    bench.run(3.0)
    assert bench.session.state is State.RECORDING


def test_the_hardware_trigger_starts_the_trial_with_the_first_sample() -> None:
    bench = Bench(start="pfi0").arm()
    bench.daq_sends = False
    bench.run(5.0)
    assert bench.session.state is State.ARMED
    bench.daq_sends = True
    bench.start_capture()
    bench.run(0.1)
    assert bench.session.state is State.RECORDING
    assert bench.recorder.samples("/force")[0].sample_numbers[0] == 0


def test_armed_tells_the_level_seen_and_the_time_left() -> None:
    bench = Bench(timeout_s=10.0).arm()
    bench.level = 0.3
    bench.run(4.0)
    armed = bench.session.snapshot()
    assert (armed.sync_level_v, armed.waited_s, armed.left_s) == pytest.approx((0.3, 4.0, 6.0))
    bench.level, bench.capturing = 5.0, True
    bench.run(1.0)
    assert bench.session.snapshot().left_s == 0.0


def test_cancelling_while_armed_records_nothing() -> None:
    bench = Bench().arm()
    bench.run(3.0)
    bench.session.stop()
    assert bench.session.state is State.FAILED
    assert bench.recorder.items == []


def test_stopping_once_keeps_the_trial_and_drains_and_twice_ends_at_once() -> None:
    bench = Bench().arm()
    bench.run(1.0)
    bench.start_capture()
    bench.run(3.0)
    bench.session.stop()
    assert bench.session.state is State.CLOSING
    bench.session.stop(at_once=True)
    assert bench.session.state is State.CLOSED


@pytest.mark.parametrize(("which", "stream"), [("daq_sends", "/force"), ("mocap_sends", "/markers")])
def test_a_stream_that_falls_silent_while_recording_ends_the_trial_with_a_loss(which: str, stream: str) -> None:
    bench = Bench().arm()
    bench.run(1.0)
    bench.start_capture()
    bench.run(2.0)
    setattr(bench, which, False)
    bench.run(4.0)
    assert bench.session.state is State.FAILED
    assert bench.session.has_edge and bench.session.lost_samples > 0
    losses = [i for i in bench.recorder.items if isinstance(i, Loss)]
    assert [(x.stream, x.cause) for x in losses] == [(stream, "silent")]


def test_a_daq_that_froze_before_the_capture_ended_is_not_accepted_and_the_missing_end_is_counted() -> None:
    bench = Bench().arm()
    bench.run(1.0)
    bench.start_capture()
    bench.run(2.0)
    bench.daq_sends = False
    bench.run(1.0)
    bench.stop_capture()
    bench.run(2.0)
    assert bench.session.state is State.FAILED
    assert "in the last 1.0 s of the trial" in bench.session.sentence
    losses = {i.stream: i.count for i in bench.recorder.items if isinstance(i, Loss)}
    assert losses == {"/force": pytest.approx(1000, abs=1), "/sync": pytest.approx(1000, abs=1)}


def test_a_daq_that_falls_silent_after_the_capture_s_end_takes_nothing_with_it() -> None:
    bench = Bench().arm()
    bench.run(1.0)
    bench.start_capture()
    bench.run(2.0)
    bench.stop_capture()
    bench.daq_sends = False
    bench.run(2.0)
    assert (bench.session.state, bench.session.lost_samples) == (State.CLOSED, 0)


def test_closing_waits_for_a_backlog_of_the_daq() -> None:
    bench = Bench().arm()
    bench.run(1.0)
    bench.start_capture()
    bench.run(2.0)
    backlog = [np.full(100, 5.0)] * 20
    bench.daq_sends = False
    bench.run(2.0)
    bench.stop_capture()
    for volts in backlog:
        assert bench.session.state is State.CLOSING
        bench.run(0.1)
        bench.send_daq(volts)
    bench.daq_sends = True
    bench.run(6.0)
    assert (bench.session.state, bench.session.lost_samples) == (State.CLOSED, 0)


def test_a_silent_daq_is_noticed_while_armed() -> None:
    bench = Bench(timeout_s=60.0).arm()
    bench.daq_sends = False
    bench.run(4.0)
    assert bench.session.state is State.FAILED
    assert "NI Dev1 sent nothing" in bench.session.sentence


def test_a_lost_device_fails_a_recording_trial_and_not_a_closing_one() -> None:
    for closing, expected in ((False, State.FAILED), (True, State.CLOSED)):
        bench = Bench().arm()
        bench.run(1.0)
        bench.start_capture()
        bench.run(2.0)
        if closing:
            bench.stop_capture()
        bench.session.fail("QTM is gone")
        bench.run(2.0)
        assert bench.session.state is expected


def test_a_trial_that_is_cut_short_is_closed_well_and_not_accepted() -> None:
    bench = Bench().arm()
    bench.run(3.0)
    bench.start_capture()
    bench.run(1.0)
    bench.session.cut_short("disk_nearly_full", "the disk is nearly full")
    assert bench.session.state is State.CLOSING
    bench.run(2.0)
    assert (bench.session.state, bench.session.sentence) == (State.FAILED, "the disk is nearly full")
    assert "disk_nearly_full" in bench.recorder.events()


def test_a_trial_that_is_cut_short_while_armed_records_nothing() -> None:
    bench = Bench().arm()
    bench.run(1.0)
    bench.session.cut_short("disk_nearly_full", "the disk is nearly full")
    assert (bench.session.state, bench.recorder.items) == (State.FAILED, [])


def test_the_capture_is_wanted_only_after_the_pre_roll() -> None:
    bench = Bench().arm()
    bench.run(1.5)
    assert not bench.session.wants_capture_start
    bench.run(1.0)
    assert bench.session.wants_capture_start


def test_a_device_that_is_away_may_be_silent_until_it_is_back_and_no_other() -> None:
    bench = Bench().arm()
    bench.run(3.0)
    bench.start_capture()
    bench.run(1.0)
    bench.session.handle(Event("connection_lost", "gone", bench.clock.utc_ns(), "NI Dev1"))
    bench.daq_sends = False
    bench.run(8.0)
    assert bench.session.state is State.RECORDING
    bench.session.handle(Event("connection_restored", "back", bench.clock.utc_ns(), "NI Dev1"))
    bench.run(2.0)
    assert bench.session.state is State.RECORDING
    bench.run(2.0)
    assert bench.session.state is State.FAILED
    assert "sent nothing on /force" in bench.session.sentence


def test_while_one_device_is_away_another_that_falls_silent_ends_the_trial() -> None:
    bench = Bench().arm()
    bench.run(3.0)
    bench.start_capture()
    bench.run(1.0)
    bench.session.handle(Event("connection_lost", "gone", bench.clock.utc_ns(), "NI Dev1"))
    bench.daq_sends = bench.mocap_sends = False
    bench.run(4.0)
    assert bench.session.state is State.FAILED
    assert "/markers" in bench.session.sentence


def test_a_mark_is_recorded_where_there_is_something_to_point_at() -> None:
    bench = Bench().arm()
    bench.session.mark()
    bench.run(3.0)
    bench.start_capture()
    bench.run(1.0)
    bench.session.mark()
    bench.session.mark()
    marks = [item.text for item in bench.recorder.items if isinstance(item, Event) and item.kind == "mark"]
    assert marks == ["mark 1", "mark 2"]
    assert bench.session.snapshot().marks == 2
