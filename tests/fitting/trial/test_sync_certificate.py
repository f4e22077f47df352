"""The sync certificate: recovered clocks, errors in newtons and metres, and a stop edge that contradicts."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest

from fitting.results.codes import TrialNoteCode, Verdict
from fitting.session import fit_session
from fitting.trial.sync_certificate import SyncCertificate
from fitting.trial.trial import Trial, build_trial
from recordings.manifest import CuffSite, LoadCell, Manifest, StopEdge, Timing
from recordings.reader import Track
from tests.fitting.experiment import Session, published, track
from tests.refusals import figures_by_code

LABELS = ("a1", "a2", "a3", "cuff")
SECONDS_PER_VOLT = 20.0
LATENESS = 5e-3
"""Mean of the exponential delay of a block [s]."""


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


def test_the_clock_ratio_is_within_its_stated_uncertainty() -> None:
    found = _certificate(_trial())
    assert found.has_both_edges
    assert found.drift == pytest.approx(80e-6, abs=3 * found.drift_sd)
    assert 5e-6 < found.drift_sd < 25e-6
    assert 2.0 < found.offset < 2.002
    assert found.findings == ()
    assert {"offset_of_both_edges_s", "drift", "low", "high"} < found.summary.figures.keys()


def test_the_error_is_that_of_time_times_the_trial_s_peak_rates() -> None:
    found = _certificate(_trial())
    assert 50 < found.force_rate < 200, "12 N at 1 Hz change by 75 N/s; the load is put on faster"
    assert 0.005 < found.speed < 0.1
    assert found.errors.time < 0.5e-3
    assert found.errors.force == pytest.approx(found.errors.time * found.force_rate)
    assert found.errors.displacement == pytest.approx(found.errors.time * found.speed)
    assert found.to_plain()["force_standard_error_n"] == found.errors.force  # type: ignore[index]


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
    assert found.drift_ci95 is not None
    assert found.drift_ci95[0] <= 80e-6 <= found.drift_ci95[1]
    assert found.drift == pytest.approx(80e-6, abs=2.2 * found.drift_sd)
    assert found.errors.time > 2e-3, "10 ms at the end, uniform"
    assert trial.lag.drift > 80e-6, "the place may be the same in every trial"
    assert "drift" in found.summary.figures


@pytest.mark.parametrize("ppm", [-300, -50, 50, 300, 400])
def test_clocks_far_apart_are_covered_and_named_where_a_missing_frame_explains_them(ppm: float) -> None:
    """300 ppm of 30 s are 9 ms, as good as a frame."""
    session = Session(published("hand", friction=1e9, migration=0.0, clock_ppm=1e-6 * ppm), 3)
    trial = build_trial(*session.dynamic(), "a.mcap", "hash")
    found = _certificate(trial)
    assert found.drift_ci95 is not None
    assert found.drift_ci95[0] < 1e-6 * ppm < found.drift_ci95[1]
    assert found.is_identified == (ppm < 100)
    missing = figures_by_code(trial.notes).get(TrialNoteCode.CLOCKS_OR_FRAMES, {})
    assert missing.get("frames") == (1 if ppm > 100 else None)
    assert ("lowest_drift" in found.summary.figures) == (ppm > 100)
    assert found.to_plain()["clock_ratio_is_identified"] == (ppm < 100)  # type: ignore[index]


def test_a_trial_without_its_stop_edge_is_certified_by_the_start_and_the_prior() -> None:
    found = _certificate(_trial(9.0))
    assert not found.has_both_edges
    assert found.drift_sd == pytest.approx(50e-6)
    assert (found.drift_ci95, found.is_identified) == (None, False)
    assert found.summary.figures["assumed_drift"] == 0.0
    assert found.errors.time > 1e-3
    assert "offset_of_start_edge_s" in found.summary.figures
    assert list(figures_by_code(found.findings)) == [TrialNoteCode.SYNC_NO_STOP]


@pytest.mark.parametrize("ppm", [-200, -120, 0, 60, 140])
@pytest.mark.parametrize("seed", [1, 2])
def test_clocks_up_to_200_ppm_apart_leave_less_than_a_millisecond_whatever_the_arrival(ppm: float, seed: int) -> None:
    both, start = (residual(ppm, seed, duration=30.0, stops=stops) for stops in (True, False))
    assert both.worst < 1e-3
    assert both.stated < 1e-3
    assert start.worst > 25e-6 * abs(ppm), "the stop edge is what holds the clocks together"


@dataclass(frozen=True)
class Residual:
    """Largest error of a sample's time [s], and the standard uncertainty of the certificate [s]."""

    worst: float
    stated: float


def residual(ppm: float, seed: int, *, duration: float, stops: bool = True) -> Residual:
    """Residual of a trial of 1 kHz and 100 Hz whose DAQ is fast by ppm; stops: whether the stop edge was recorded."""
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
    assert trial.sync is not None
    return Residual(float(np.abs(trial.force_time - trial.force).max()), trial.sync.errors.time)


def _late(arrived: Track, random: np.random.Generator) -> Track:
    """Arrival times: every block of 50 ms is late at random, and blocks stay in order."""
    block = np.arange(len(arrived.sample_numbers)) // max(1, int(arrived.stream.rate_hz / 20))
    delay = random.exponential(LATENESS, block[-1] + 1)[block]
    arrival = arrived.host_time_ns + np.round(1e9 * delay).astype(np.int64)
    return replace(arrived, host_time_ns=np.maximum.accumulate(arrival))


def _drifting() -> Manifest:
    """Newtons are seconds."""
    return Manifest(
        cuff=CuffSite("hand", "arm", LABELS[:3], LABELS[3:]),
        test="dynamic",
        repeat=1,
        run=1,
        donning="1",
        start="sync_edge",
        sync_threshold_v=2.5,
        load_cell=LoadCell("daq", SECONDS_PER_VOLT, 1),
        start_utc_ns=0,
        timing=Timing(stop_edge="end_of_frame"),
    )
