"""EMG on session time: on the DAQ's clock, by a recorded sync line, and by clock offsets, with known clocks."""

from dataclasses import replace

import numpy as np
import pytest

from fitting.results.trial_codes import RejectionCode, TrialNoteCode
from fitting.trial.analog_signals import AnalogSignals, build_analog_signals
from fitting.trial.timeline import Timeline, build_timeline
from recordings.manifest import BodyMarkers, EmgAmplifier, LoadCell, Manifest, Timing
from recordings.reader import Track
from recordings.samples import Stream
from tests.refusals import raises_refusal

START_NS = 1_795_000_000_000_000_000
EDGE_S, FALL_S, END_S = 2.0, 12.0, 12.5  # by the station's clock, from START_NS
AHEAD_S, FAST = 4321.25, 1 + 80e-6  # the amplifier's clock against the station's
EMG_HZ = 2000.0
LABELS = ("c7", "t8", "ac", "el")
CELL, TIMING = LoadCell("daq", 100.0, 1), Timing(stop_edge="end_of_frame")
EMG = EmgAmplifier("lsl", {"a": 1.0, "b": 2.0}, sync_threshold=0.5)
MANIFEST = Manifest(
    None, "motion", 1, 1, "1", "sync_edge", 2.5, CELL, START_NS, timing=TIMING, body=BodyMarkers(LABELS), emg=EMG
)


def even(name: str, unit: str, labels: tuple[str, ...], rate: float, values: np.ndarray, **more: float) -> Track:
    """Samples from START_NS on; the device's clock reads more["ahead"] then and runs more["fast"] times as fast."""
    numbers = np.arange(len(values), dtype=np.uint64)
    seconds = numbers / rate
    device = more.get("ahead", 0.0) + seconds * more.get("fast", 1.0)
    stream = Stream(name, unit, labels, rate, "a device")
    host = START_NS + np.rint(1e9 * (np.ceil(seconds / 0.05) * 0.05 + 2e-3)).astype(np.int64)  # in blocks, 2 ms late
    return Track(stream, numbers, np.rint(1e9 * device).astype(np.int64), host, values)


def pulse(rate: float, high: float) -> np.ndarray:
    time = np.arange(round(END_S * rate)) / rate
    return np.where((time >= EDGE_S) & (time < FALL_S), high, 0.0)[:, None]


def recorded() -> dict[str, Track]:
    """Force, sync line and markers of a DAQ and a camera without drift; EMG b is 2 µV at every full session second."""
    force = np.random.default_rng(1).normal(0.0, 0.01, (round(END_S * 1000), 1))
    frames = np.tile(np.random.default_rng(2).normal(size=(1, 4, 4)).astype(np.float32), (1000, 1, 1))
    emg = np.zeros((round(END_S * EMG_HZ), 2))
    emg[:: round(EMG_HZ), 1] = 2.0
    tracks = {
        "/force": even("/force", "V", ("force",), 1000.0, force),
        "/sync": even("/sync", "V", ("sync",), 1000.0, pulse(1000.0, 5.0)),
        "/emg": even("/emg", "uV", ("a", "b"), EMG_HZ, emg, ahead=AHEAD_S, fast=FAST),
        "/emg_sync": even("/emg_sync", "count", ("trigger",), EMG_HZ, pulse(EMG_HZ, 1.0), ahead=AHEAD_S, fast=FAST),
    }
    markers = even("/markers", "mm", LABELS, 100.0, frames)
    host = START_NS + np.rint(1e9 * (EDGE_S + np.arange(1, 1001) / 100)).astype(np.int64)
    return tracks | {
        "/markers": replace(markers, sample_numbers=np.arange(1, 1001, dtype=np.uint64), host_time_ns=host)
    }


def laid_out(tracks: dict[str, Track], manifest: Manifest = MANIFEST) -> tuple[AnalogSignals, Timeline]:
    line = build_timeline(manifest, tracks, LABELS)
    return build_analog_signals(manifest, tracks, line)["/emg"], line


def off_the_second(emg: AnalogSignals) -> np.ndarray:
    """How late [s] each spike is against the full second."""
    return np.mod(emg.time[emg.values[:, 1] > 0] + 0.5, 1.0) - 0.5


def test_a_recorded_sync_line_ties_an_amplifier_to_the_sample_and_values_are_volts_at_the_electrodes() -> None:
    emg, line = laid_out(recorded())
    assert len(off_the_second(emg)) == 10
    np.testing.assert_allclose(off_the_second(emg), 0.0, atol=1 / EMG_HZ + 1e-3)
    assert emg.time_sd < 1e-3 and emg.notes == ()
    assert emg.time[0] >= 0 and emg.time[-1] <= line.marker_time[-1]
    emg, _ = laid_out(recorded())
    assert (emg.unit, emg.labels, emg.rate) == ("V", ("a", "b"), EMG_HZ)
    assert emg.values[:, 1].max() == pytest.approx(2e-6 / 2.0)


def test_jitter_of_the_stamps_is_taken_out() -> None:
    tracks = recorded()
    jitter = np.random.default_rng(4).normal(0.0, 5e6, len(tracks["/emg"].values)).astype(np.int64)
    for name in ("/emg", "/emg_sync"):
        tracks[name] = replace(tracks[name], device_time_ns=tracks[name].device_time_ns + jitter)
    emg, _ = laid_out(tracks)
    np.testing.assert_allclose(off_the_second(emg), 0.0, atol=1.5e-3)


def offsets(*measured: tuple[float, float]) -> Track:
    """Clock offsets with their uncertainty [s]: each is wrong by as much."""
    host = START_NS + np.array([2, 5, 9][: len(measured)], np.int64) * 1_000_000_000
    device = [AHEAD_S + (at - START_NS) * 1e-9 * FAST + wrong for at, (wrong, _) in zip(host, measured, strict=True)]
    stream = Stream("/emg_clock", "s", ("offset", "uncertainty"), 0.2, "an outlet")
    numbers = np.arange(len(measured), dtype=np.uint64)
    return Track(stream, numbers, np.rint(1e9 * np.array(device)).astype(np.int64), host, np.array(measured))


def test_without_a_sync_line_the_surest_clock_offset_ties_it_and_a_note_says_how_well() -> None:
    tracks = recorded() | {"/emg_clock": offsets((0.03, 0.06), (0.0005, 0.001), (-0.02, 0.05))}
    manifest = replace(MANIFEST, emg=EmgAmplifier("lsl"))
    emg, _ = laid_out(tracks, manifest)
    np.testing.assert_allclose(off_the_second(emg), 0.0, atol=5e-3)
    assert emg.time_sd == pytest.approx(0.05, abs=0.001)
    assert emg.notes[0].figures["reason_code"] == TrialNoteCode.EMG_NO_SYNC


def test_a_sync_line_that_was_not_connected_falls_back_to_the_clock_offsets() -> None:
    tracks = recorded() | {"/emg_clock": offsets((0.0, 0.001))}
    flat = tracks["/emg_sync"]
    tracks["/emg_sync"] = replace(flat, values=np.zeros_like(flat.values))
    emg, _ = laid_out(tracks)
    assert emg.notes[0].figures["reason_code"] == RejectionCode.SYNC_NEVER_RISES
    np.testing.assert_allclose(off_the_second(emg), 0.0, atol=5e-3)


@pytest.mark.parametrize("has_sync", [True, False])
@pytest.mark.parametrize("jump_s", [1e9, 200_000.0, -200_000.0])
def test_a_jump_of_the_amplifiers_clock_does_not_move_its_samples(jump_s: float, has_sync: bool) -> None:
    """The clock offset that was measured after the jump is the most certain one, and of another clock."""
    measured = offsets((0.0, 0.001), (0.0, 0.001), (jump_s, 1e-4))
    tracks = recorded() | {"/emg_clock": measured}
    at = int(6.0 * EMG_HZ)
    for name in ("/emg", "/emg_sync"):
        device = tracks[name].device_time_ns.copy()
        device[at:] += round(1e9 * jump_s)
        tracks[name] = replace(tracks[name], device_time_ns=device)
    emg, _ = laid_out(tracks, MANIFEST if has_sync else replace(MANIFEST, emg=EmgAmplifier("lsl")))
    assert len(off_the_second(emg)) >= 9
    np.testing.assert_allclose(off_the_second(emg), 0.0, atol=5e-3)


def test_an_amplifier_that_nothing_ties_is_refused() -> None:
    with raises_refusal(RejectionCode.EMG_NO_CLOCK):
        laid_out(recorded(), replace(MANIFEST, emg=EmgAmplifier("lsl")))


def test_inputs_of_the_daq_are_on_its_clock_and_moved_by_the_amplifier_s_lag() -> None:
    tracks = recorded()
    tracks["/emg"] = even("/emg", "V", ("a", "b"), EMG_HZ, tracks["/emg"].values)
    tracks["/analog"] = even("/analog", "V", ("angle",), 1000.0, np.ones((12_500, 1)))
    manifest = replace(MANIFEST, emg=EmgAmplifier("daq", {"b": 1000.0}, lag_s=-0.048, lag_sd_s=0.002))
    line = build_timeline(manifest, tracks, LABELS)
    found = build_analog_signals(manifest, tracks, line)
    np.testing.assert_allclose(off_the_second(found["/emg"]), -0.048, atol=1.1e-3)
    assert found["/emg"].values.max() == pytest.approx(2e-3)
    assert found["/emg"].time_sd == pytest.approx(0.002, rel=0.05)
    assert set(found["/analog"].values.ravel()) == {1.0}
