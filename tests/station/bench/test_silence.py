from __future__ import annotations

import numpy as np
import pytest

from drivers.errors import DeviceLost
from recordings.samples import Event, Loss, Samples
from station.bench.view import TrialState
from station.messages.codes import TrialCode
from tests.station.bench_by_hand import Bench


@pytest.mark.parametrize(
    ("which", "missing"),
    [("daq_sends", {"/force": 3000, "/sync": 3000}), ("mocap_sends", {"/markers": 300})],
)
def test_a_device_that_falls_silent_while_recording_ends_the_trial_with_a_loss_of_each_stream(
    which: str, missing: dict[str, int]
) -> None:
    bench = Bench().arm()
    bench.run(1.0)
    bench.start_capture()
    bench.run(2.0)
    setattr(bench, which, False)
    bench.run(4.0)
    assert bench.trial.state is TrialState.FAILED
    assert bench.trial.has_edge and bench.trial.lost_samples > 0
    losses = [i for i in bench.writer.items if isinstance(i, Loss)]
    assert {x.cause for x in losses} == {"silent"}
    assert {x.stream: x.count for x in losses} == pytest.approx(missing, rel=0.05)
    for loss in losses:
        assert loss.first_missing == bench.writer.samples(loss.stream)[-1].sample_numbers[-1] + 1


@pytest.mark.parametrize("has_preview", [False, True])
def test_a_short_capture_without_a_frame_is_not_accepted(has_preview: bool) -> None:
    bench = Bench().arm()
    bench.run(1.0)
    if has_preview:
        bench.send_frames(10)
        bench.run(0.5)
    bench.mocap_sends = False
    bench.start_capture()
    bench.run(2.0)
    bench.stop_capture()
    bench.run(2.0)
    assert bench.trial.state is TrialState.FAILED
    assert bench.codes == [TrialCode.CAPTURE_ENDED, TrialCode.EMPTY_CAPTURE]
    assert bench.trial.messages[1].figures == {"source": "QTM 127.0.0.1:22223"}
    losses = [(i.stream, i.count) for i in bench.writer.items if isinstance(i, Loss)]
    assert losses == [("/markers", pytest.approx(200, abs=10))]


def test_a_daq_that_froze_before_the_capture_ended_is_not_accepted_and_the_missing_end_is_counted() -> None:
    bench = Bench().arm()
    bench.run(1.0)
    bench.start_capture()
    bench.run(2.0)
    bench.daq_sends = False
    bench.run(1.0)
    bench.stop_capture()
    bench.run(1.5)
    assert bench.trial.state is TrialState.CLOSING, "a busy machine may still bring them"
    bench.run(2.5)
    assert bench.trial.state is TrialState.FAILED
    assert bench.codes == [TrialCode.END_MISSING, TrialCode.NO_STOP_EDGE]
    assert bench.trial.messages[0].figures["missing_s"] == pytest.approx(1.0, abs=0.01)
    losses = {i.stream: i.count for i in bench.writer.items if isinstance(i, Loss)}
    assert losses == {"/force": pytest.approx(1000, abs=1), "/sync": pytest.approx(1000, abs=1)}


def test_a_daq_that_is_silent_after_the_end_of_the_capture_loses_no_samples() -> None:
    bench = Bench().arm()
    bench.run(1.0)
    bench.start_capture()
    bench.run(2.0)
    bench.stop_capture()
    bench.daq_sends = False
    bench.run(2.0)
    assert (bench.trial.state, bench.trial.lost_samples) == (TrialState.CLOSED, 0)


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
        assert bench.trial.state is TrialState.CLOSING
        bench.run(0.1)
        bench.send_daq(volts)
    bench.daq_sends = True
    bench.run(6.0)
    assert (bench.trial.state, bench.trial.lost_samples) == (TrialState.CLOSED, 0)


def test_a_lost_device_fails_a_recording_trial_and_not_a_closing_one() -> None:
    for closing, expected in ((False, TrialState.FAILED), (True, TrialState.CLOSED)):
        bench = Bench().arm()
        bench.run(1.0)
        bench.start_capture()
        bench.run(2.0)
        if closing:
            bench.stop_capture()
        bench.trial.fail(DeviceLost("QTM is gone"))
        bench.run(2.0)
        assert bench.trial.state is expected


def test_a_disconnected_device_may_be_silent_and_no_other() -> None:
    bench = Bench().arm()
    bench.run(3.0)
    bench.start_capture()
    bench.run(1.0)
    bench.trial.handle(Event("connection_lost", "gone", bench.clock.utc_ns(), "NI Dev1"))
    bench.daq_sends = False
    bench.run(8.0)
    assert bench.trial.state is TrialState.RECORDING
    bench.trial.handle(Event("connection_restored", "back", bench.clock.utc_ns(), "NI Dev1"))
    bench.run(2.0)
    assert bench.trial.state is TrialState.RECORDING
    bench.run(2.0)
    assert bench.trial.state is TrialState.FAILED
    assert silent_stream(bench) == "/force"


def test_a_silent_device_ends_the_trial_while_another_is_disconnected() -> None:
    bench = Bench().arm()
    bench.run(3.0)
    bench.start_capture()
    bench.run(1.0)
    bench.trial.handle(Event("connection_lost", "gone", bench.clock.utc_ns(), "NI Dev1"))
    bench.daq_sends = bench.mocap_sends = False
    bench.run(4.0)
    assert bench.trial.state is TrialState.FAILED
    assert silent_stream(bench) == "/markers"


def test_after_a_stall_of_the_station_no_device_is_silent_and_the_backlog_is_recorded() -> None:
    bench = Bench().arm()
    bench.run(1.0)
    bench.start_capture()
    bench.run(2.0)
    bench.clock.advance(60.0)
    bench.trial.tick()
    bench.run(2.0)
    assert bench.trial.state is TrialState.RECORDING and bench.trial.lost_samples == 0
    (paused,) = (i for i in bench.writer.items if isinstance(i, Event) and i.kind == "station_paused")
    assert "60.0 s" in paused.text
    bench.mocap_sends = False
    bench.run(4.0)
    assert bench.trial.state is TrialState.FAILED, "a device that falls silent afterwards is reported"


def test_a_replaced_capture_ends_the_trial_without_acceptance() -> None:
    bench = Bench().arm()
    bench.run(1.0)
    bench.start_capture()
    bench.run(2.0)
    before = frames_recorded(bench)
    bench.event("capture_replaced")
    bench.run(2.0)
    assert bench.trial.state is TrialState.FAILED
    assert frames_recorded(bench) == before, "the frames of the other capture are not ours"


def test_a_slow_computer_is_reported_during_the_trial_and_in_its_result() -> None:
    bench = Bench().arm()
    bench.run(1.0)
    bench.start_capture()
    bench.run(2.0)
    bench.trial.handle(Loss("/force", "overrun", 10_000, 250, 0, bench.clock.utc_ns()))
    bench.run(1.0)
    bench.trial.handle(Loss("/sync", "queue_overflow", 10_000, 50, 0, bench.clock.utc_ns()))
    bench.stop_capture()
    bench.run(3.0)
    assert bench.writer.events().count("overloaded") == 1
    assert bench.codes == [TrialCode.CAPTURE_ENDED, TrialCode.OVERWRITTEN]
    assert bench.trial.messages[1].figures == {"samples": 300}
    assert bench.trial.state is TrialState.CLOSED


def test_samples_that_wait_in_the_station_are_an_overload() -> None:
    bench = Bench().arm()
    bench.run(1.0)
    bench.start_capture()
    bench.run(2.0)
    late = next(i for i in reversed(bench.writer.items) if isinstance(i, Samples) and i.stream == "/force")
    bench.clock.advance(3.0)
    bench.trial.handle(late)
    (overloaded,) = (item for item in bench.writer.items if isinstance(item, Event) and item.kind == "overloaded")
    assert "3.0 s" in overloaded.text


def silent_stream(bench: Bench) -> float | str:
    (message,) = bench.trial.messages
    assert message.code is TrialCode.DEVICE_SILENT
    return message.figures["stream"]


def frames_recorded(bench: Bench) -> int:
    blocks = [item for item in bench.writer.items if isinstance(item, Samples) and item.stream == "/markers"]
    return sum(len(block.sample_numbers) for block in blocks)
