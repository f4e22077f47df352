"""Faults of a recorded sync line are named, edges are found where they can be, and the certificate holds."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from fitting.cuffs.cuffs_file import sync_entry
from fitting.errors import UnusableTrial
from fitting.results.codes import Verdict
from fitting.results.sentences import Note
from fitting.results.trial_codes import RejectionCode, TrialNoteCode
from fitting.session import fit_session
from fitting.trial.clocks import SyncEdges, find_edges, find_fall
from fitting.trial.timeline import SyncCertificate
from fitting.trial.trial import Trial, build_trial
from recordings.manifest import CuffSite, LoadCell, Manifest, StopEdge, Timing
from recordings.reader import Track
from tests.fitting.experiment import Session, published, track
from tests.refusals import figures_by_code, raises_refusal

Line = tuple[NDArray[np.float64], NDArray[np.float64], float]
CAPTURE = (2500, 6000)
STEP_SD = 1e-3 / np.sqrt(12)  # of a time known to lie between two samples of 1 kHz
TIME = np.arange(3) / 1000
LABELS = ("a1", "a2", "a3", "cuff")
SECONDS_PER_VOLT = 20.0
LATENESS = 5e-3
"""Mean of the exponential delay of a block [s]."""


def line(*pulses: tuple[int, int], low: tuple[tuple[int, int], ...] = (), start: int = 0, end: int = 8000) -> Line:
    """Time, level and threshold of a line sampled every millisecond from start to end: high in the pulses [ms].

    A difference from time 0 is exact, as the limits of a glitch and a bounce are.
    """
    number = np.arange(start, end)
    is_high = np.zeros(len(number), bool)
    for stretches, level in ((pulses, True), (low, False)):
        for first, after in stretches:
            is_high[(number >= first) & (number < after)] = level
    return number / 1000, np.where(is_high, 2.5, 0.1), 2.5


DIPS = (3000, 3003), (4000, 4001), (5000, 5001)


@pytest.mark.parametrize(
    ("recorded", "notes"),
    [
        (line(CAPTURE), []),
        (line(CAPTURE, (1000, 1002)), [("spikes", 1, "1.000 s")]),
        (line(CAPTURE, (1000, 1002), (7000, 7001)), [("spikes", 2, "1.000 s, 7.000 s")]),
        (line(CAPTURE, low=DIPS), [("dips", 3, "3.000 s, 4.000 s, 5.000 s")]),
        (line(CAPTURE, low=(*DIPS, (5500, 5519))), [("dips", 4, "3.000 s, 4.000 s, 5.000 s, …")]),
        (line(CAPTURE, low=((2502, 2505), (2507, 2508))), [("bounces", 2, "2.502 s, 2.507 s")]),
        (line(CAPTURE, (6003, 6005), (6007, 6010)), [("bounces", 2, "6.000 s, 6.005 s")]),
        (
            line(CAPTURE, (1000, 1002), low=((2502, 2505), (4000, 4001))),
            [("bounces", 1, "2.502 s"), ("dips", 1, "4.000 s"), ("spikes", 1, "1.000 s")],
        ),
    ],
    ids=["clean", "spike", "two spikes", "three dips", "four dips", "bouncing start", "bouncing stop", "all"],
)
def test_glitches_and_bounces_are_named_and_leave_the_edges_where_they_are(
    recorded: Line, notes: list[tuple[str, int, str]]
) -> None:
    edges = find_edges(*recorded)
    times = edges.rising, edges.rising_sd, edges.falling, edges.falling_sd
    assert times == pytest.approx((2.4995, STEP_SD, 5.9995, STEP_SD))
    codes = {
        "spikes": TrialNoteCode.SYNC_SPIKES,
        "dips": TrialNoteCode.SYNC_DIPS,
        "bounces": TrialNoteCode.SYNC_BOUNCES,
    }
    assert edges.findings == tuple(Note(codes[name], {"count": count, "at": at}) for name, count, at in notes)


def test_crossings_20_ms_apart_are_two_edges_and_not_a_bounce() -> None:
    with raises_refusal(RejectionCode.SYNC_RISES_AGAIN, count=2):
        find_edges(*line((0, 20), (2500, 6000), start=-2000))
    with raises_refusal(RejectionCode.SYNC_RISES_AGAIN, count=2):
        find_edges(*line((-2000, 0), (20, 6000), start=-4000))
    edges = find_edges(*line((0, 6000), low=((20, 23),), start=-2000))
    assert [note.code for note in edges.findings] == [TrialNoteCode.SYNC_BOUNCES]
    edges = find_edges(*line((-2000, 0), low=((-20, -10),), start=-4000, end=1000))
    assert [note.code for note in edges.findings] == [TrialNoteCode.SYNC_BOUNCES]
    assert edges.falling == pytest.approx(-0.0205)
    edges = find_edges(*line((0, 6000), (7000, 7010), low=((19, 21),), start=-2000))
    assert [note.code for note in edges.findings] == [TrialNoteCode.SYNC_BOUNCES, TrialNoteCode.SYNC_SPIKES]


@pytest.mark.parametrize(("rise", "is_early"), [(11499, True), (11500, False)])
def test_an_edge_before_one_and_a_half_seconds_of_low_line_is_early(rise: int, is_early: bool) -> None:
    edges = find_edges(*line((rise, 14000), start=10000, end=15000))
    assert edges.rising == pytest.approx(rise / 1000 - 0.0005)
    note = Note(TrialNoteCode.SYNC_EARLY, {"rest_s": pytest.approx(1.499)})  # type: ignore[dict-item]
    assert edges.findings == ((note,) if is_early else ())


def test_a_trigger_pulse_gives_a_start_and_no_stop_and_a_missing_stop_edge_is_named() -> None:
    edges = find_edges(*line((2500, 2510)))
    assert (edges.rising, edges.falling) == (pytest.approx(2.4995), None)
    assert edges.findings[0].code is TrialNoteCode.SYNC_SHORT
    assert edges.findings[0].figures["duration_s"] == pytest.approx(0.01)
    edges = find_edges(*line((2500, 9000)))
    assert edges.falling is None
    assert edges.findings == (Note(TrialNoteCode.SYNC_NO_STOP),)


SIX = line(*((i * 1000, i * 1000 + 100) for i in range(1, 7)))
INVERTED = {"gap_s": pytest.approx(3.5), "fell_s": pytest.approx(2.5), "level_v": 2.5, "threshold_v": 2.5}
STARTLESS = {
    "double edge": (line(CAPTURE, (7000, 7500)), "RISES_AGAIN", {"count": 2, "at": "2.50 s, 7.00 s"}),
    "spikes alone": (line((1000, 1002), (2000, 2002)), "RISES_AGAIN", {"count": 2}),
    "six pulses": (SIX, "RISES_AGAIN", {"count": 6, "at": "1.00 s, 2.00 s, 3.00 s, 4.00 s, 5.00 s"}),
    "inverted": (line((0, 2500), (6000, 8000)), "INVERTED", INVERTED),
    "begun before arming": (
        (TIME, np.array([5.0, 4.8, 4.9]), 2.5),
        "STARTS_HIGH",
        {"level_v": 5.0, "threshold_v": 2.5},
    ),
    "begun before arming, and rises once more": (line((0, 2500), (6000, 7000)), "STARTS_HIGH", {}),
    "begun before arming, and rises twice": (line((0, 2500), (3000, 4000), (6000, 8000)), "STARTS_HIGH", {}),
    "silent": ((TIME, np.array([0.1, 1.2, 0.3]), 2.5), "NEVER_RISES", {"highest_v": 1.2, "threshold_v": 2.5}),
    "NaN": ((TIME, np.array([0.1, np.nan, 5.0]), 2.5), "NOT_FINITE", {}),
    "empty": ((TIME[:0], TIME[:0], 2.5), "NOT_FINITE", {}),
}


@pytest.mark.parametrize(("recorded", "code", "figures"), STARTLESS.values(), ids=STARTLESS)
def test_a_line_without_a_single_start_is_refused(recorded: Line, code: str, figures: dict[str, object]) -> None:
    with raises_refusal(RejectionCode[f"SYNC_{code}"], **figures):
        find_edges(*recorded)


STARTED = {
    "glitches": (line((0, 6000), (7000, 7002), low=((3000, 3002),)), 5.9995, ["DIPS", "SPIKES"]),
    "bounce": (line((-20, 6000), (7000, 7002), low=((0, 3),), start=-20), 5.9995, ["BOUNCES", "SPIKES"]),
    "20 ms more": (line((-6000, -3000), (0, 20), start=-6000), -3.0005, []),
    "20 ms": (line((0, 20)), 0.0195, []),
    "19 ms": (line((0, 19)), None, ["SHORT"]),
    "stays high": (line((0, 8000)), None, ["NO_STOP"]),
    "low at sample 0": (line((1, 6000)), None, ["LOW"]),
    "low": (line(), None, ["LOW"]),
}


@pytest.mark.parametrize(("recorded", "falling", "codes"), STARTED.values(), ids=STARTED)
def test_a_line_that_started_the_acquisition_has_its_rise_at_time_0(
    recorded: Line, falling: float | None, codes: list[str]
) -> None:
    edges = find_fall(*recorded)
    assert (edges.rising, edges.rising_sd) == (0.0, 0.0)
    assert (edges.falling, edges.falling_sd) == (
        (None, SyncEdges(0.0, 0.0, None).falling_sd)
        if falling is None
        else (pytest.approx(falling), pytest.approx(STEP_SD))
    )
    assert [note.code for note in edges.findings] == [TrialNoteCode[f"SYNC_{code}"] for code in codes]


@given(st.lists(st.tuples(st.booleans(), st.integers(1, 60)), max_size=12), st.booleans())
def test_whatever_the_line_does_two_edges_in_order_come_out_or_one_sentence(
    stretches: list[tuple[bool, int]], is_started_by_edge: bool
) -> None:
    level = np.concatenate([np.zeros(0), *(np.full(count, 5.0 * is_high) for is_high, count in stretches)])
    try:
        edges = (find_fall if is_started_by_edge else find_edges)(np.arange(len(level)) / 1000, level, 2.5)
    except UnusableTrial as error:
        assert str(error)
    else:
        assert edges.falling is None or edges.rising < edges.falling
        assert all(str(note) for note in edges.findings)


@cache
def _dynamic() -> tuple[Manifest, dict[str, Track]]:
    return Session(published("hand", clock_ppm=80e-6), 5).dynamic()


def _trial(fall_later_by: float = 0.0, stop_edge: StopEdge | None = "end_of_frame") -> Trial:
    """The stop edge moved by `fall_later_by` seconds; stop_edge is what the configuration declares."""
    manifest, tracks = _dynamic()
    manifest = replace(manifest, timing=Timing(stop_edge=stop_edge))
    sync = tracks["/sync"]
    values = sync.values.copy()
    fall = int(np.flatnonzero(values[:, 0] > 2.5)[-1]) + 1
    moved = fall + round(1000 * fall_later_by)
    values[min(fall, moved) : max(fall, moved)] = 5.0 if fall_later_by > 0 else 0.0
    return build_trial(manifest, {**tracks, "/sync": replace(sync, values=values)}, "a.mcap", "hash")


def _certificate(trial: Trial) -> SyncCertificate:
    assert trial.sync is not None
    return trial.sync


def test_a_fall_before_the_last_frame_makes_the_lag_that_uncertain_and_damping_is_open() -> None:
    trial = _trial(-0.06)
    found = _certificate(trial)
    assert not found.has_both_edges
    assert found.contradiction == pytest.approx(-0.06, abs=0.01)
    assert trial.lag.edge == pytest.approx(abs(found.contradiction), rel=0.05)
    (figures,) = figures_by_code(trial.notes).values()
    assert figures["before_end_s"] == -found.contradiction
    fit = fit_session([trial]).cuffs["hand"]
    assert fit.damping and fit.damping.standard_error > 8000 * 0.06
    assert Verdict.LAG in fit.verdicts


@pytest.mark.parametrize("late", [0.8, -0.8])
def test_markers_that_start_with_another_edge_are_named_by_how_far_they_are_off(late: float) -> None:
    manifest, tracks = _dynamic()
    frames = tracks["/markers"]
    moved = replace(frames, host_time_ns=frames.host_time_ns + round(1e9 * late))
    found = _certificate(build_trial(manifest, {**tracks, "/markers": moved}, "a.mcap", "hash"))
    figures = figures_by_code(found.findings)[TrialNoteCode.SYNC_ARRIVAL]
    assert figures["late_s"] == pytest.approx(late, abs=5e-3)
    assert found.errors.time == pytest.approx(0.05, rel=0.01)


def test_whole_frames_missing_at_the_end_contradict_nothing() -> None:
    trial = _trial(0.05)
    found = _certificate(trial)
    assert (found.has_both_edges, found.contradiction) == (False, 0.0)
    assert list(figures_by_code(trial.notes)) == [TrialNoteCode.SYNC_MISSING_FRAMES]
    assert fit_session([trial]).cuffs["hand"].damping is not None


@pytest.mark.parametrize("early", [0.0, 0.003, 0.007, 0.0095], ids=lambda early: f"{1e3 * early:g} ms")
def test_a_line_that_falls_within_the_last_frame_is_covered_where_its_place_is_not_declared(early: float) -> None:
    """3 ms inside a frame gave -198 ± 1 ppm and an error of 0.012 ms."""
    trial = _trial(-early, stop_edge=None)
    found = _certificate(trial)
    assert found.is_identified
    assert found.drift_ci95[0] <= 80e-6 <= found.drift_ci95[1]
    assert found.drift == pytest.approx(80e-6, abs=2.2 * found.drift_sd)
    assert found.errors.time > 2e-3, "10 ms at the end, uniform"
    assert trial.lag.drift > 80e-6, "the place may be the same in every trial"
    assert "drift" in found.summary.figures


@pytest.mark.parametrize("ppm", [-300, 50, 400])
def test_clocks_far_apart_are_covered_and_named_where_a_missing_frame_explains_them(ppm: float) -> None:
    """300 ppm of 30 s are 9 ms, as good as a frame."""
    session = Session(published("hand", friction=1e9, migration=0.0, clock_ppm=1e-6 * ppm), 3)
    trial = build_trial(*session.dynamic(), "a.mcap", "hash")
    found = _certificate(trial)
    assert found.drift_ci95[0] < 1e-6 * ppm < found.drift_ci95[1]
    assert found.is_identified == (ppm < 100)
    missing = figures_by_code(trial.notes).get(TrialNoteCode.CLOCKS_OR_FRAMES, {})
    assert missing.get("frames") == (1 if ppm > 100 else None)
    assert ("lowest_drift" in found.summary.figures) == (ppm > 100)
    assert sync_entry(found).clock_ratio_is_identified == (ppm < 100)


@pytest.mark.parametrize(("ppm", "seed"), [(-200, 1), (-120, 2), (0, 1), (140, 2)])
def test_clocks_up_to_200_ppm_apart_leave_less_than_a_millisecond_whatever_the_arrival(ppm: float, seed: int) -> None:
    (worst, stated), (of_start, _) = (residual(ppm, seed, duration=30.0, stops=stops) for stops in (True, False))
    assert max(worst, stated) < 1e-3
    assert of_start > 25e-6 * abs(ppm), "the stop edge is what holds the clocks together"


def residual(ppm: float, seed: int, *, duration: float, stops: bool = True) -> tuple[float, float]:
    """Largest error of a sample's time, and the standard uncertainty of the certificate [s].

    Of a trial of 1 kHz and 100 Hz whose DAQ is fast by ppm; stops: whether the stop edge was recorded.
    """
    random = np.random.default_rng(seed)
    edge, rate = 2.0 + random.uniform(0, 1e-3), 1000.0
    numbers = np.arange(int((edge + duration + 0.5) * rate))
    true = (numbers / rate - edge) / (1 + 1e-6 * ppm)
    high = (true >= 0) & ((true < duration) | (not stops))
    frames = np.arange(round(duration * 100))
    markers = np.tile(1e3 * np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]]), (len(frames), 1, 1))
    tracks = {
        "/force": track("/force", "V", ("ai0",), rate, numbers, true, 0, true[:, None] / SECONDS_PER_VOLT),
        "/sync": track("/sync", "V", ("ai1",), rate, numbers, true, 0, 5.0 * high[:, None]),
        "/markers": track("/markers", "mm", LABELS, 100.0, frames + 1, frames / 100, 0, markers),
    }
    late = {name: _late(stream, random) for name, stream in tracks.items()}
    trial = build_trial(_drifting(), late, "drift", "")
    return float(np.abs(trial.force_time - trial.force).max()), trial.sync.errors.time


def _late(arrived: Track, random: np.random.Generator) -> Track:
    """Arrival times: every block of 50 ms is late at random, and blocks stay in order."""
    block = np.arange(len(arrived.sample_numbers)) // max(1, int(arrived.stream.rate_hz / 20))
    delay = random.exponential(LATENESS, block[-1] + 1)[block]
    arrival = arrived.host_time_ns + np.round(1e9 * delay).astype(np.int64)
    return replace(arrived, host_time_ns=np.maximum.accumulate(arrival))


def _drifting() -> Manifest:
    """Newtons are seconds."""
    site, cell = CuffSite("hand", "arm", LABELS[:3], LABELS[3:]), LoadCell("daq", SECONDS_PER_VOLT, 1)
    timing = Timing(stop_edge="end_of_frame")
    return Manifest(site, "dynamic", 1, 1, "1", "sync_edge", 2.5, cell, 0, timing=timing)
