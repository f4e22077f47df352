"""Streams on session time, from tracks written by hand whose times are known."""

from collections.abc import Iterator
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from fitting.cuffs.cuffs_file import sync_entry
from fitting.results.trial_codes import RejectionCode, TrialNoteCode
from fitting.trial.decimation import Decimator, decimate, highest_rate
from fitting.trial.timeline import (
    Timeline,
    align_by_sync_edge,
    build_timeline,
    certify,
    damage_figures,
    loss_notes,
    require_labels,
    require_steady_zero,
    zero_drift,
    zero_notes,
)
from recordings.manifest import BodyMarkers, CuffSite, LoadCell, Manifest, Timing
from recordings.reader import Track
from recordings.samples import Samples, Stream
from tests.fitting.experiment import Session, published
from tests.refusals import figures_by_code, raises_refusal

HOST_NS = 1_790_000_000_000_000_000
CUFF = CuffSite("hand", "arm", ("a",), ("b",))
CELL = LoadCell("daq", 2.0, -1)
MANIFEST = Manifest(CUFF, "static", 1, 1, "1", "one_clock", 2.5, CELL, HOST_NS, origin_s=10.0)
EDGE = replace(MANIFEST, start="sync_edge", origin_s=0.0, timing=Timing(stop_edge="end_of_frame"))
Tracks = dict[str, Track]


def track(
    stream: Stream,
    numbers: NDArray[np.int64],
    device_s: NDArray[np.float64],
    values: NDArray[np.float64],
    host_s: float,
) -> Track:
    """host_s: of a device time of zero at the host."""
    stamps = np.round(1e9 * device_s).astype(np.int64)
    return Track(stream, numbers.astype(np.uint64), stamps, stamps + HOST_NS + round(1e9 * host_s), values)


def force(numbers: NDArray[np.int64], start_s: float = 0.0, host_s: float = 0.0, unit: str = "V") -> Track:
    """1 kHz; the value of sample n is n / 1000 above 3, in steps of 0.001."""
    stream = Stream("/force", unit, ("force",), 1000.0, "DAQ")
    return track(stream, numbers, start_s + numbers / 1000, 3 + numbers[:, None] / 1000, host_s)


def markers(numbers: NDArray[np.int64], start_s: float = 0.0, host_s: float = 0.0) -> Track:
    """100 Hz; the markers b, a and another; of frame n marker b is at (n, 1, 2) and a at (n, 3, 4) mm."""
    stream = Stream("/markers", "mm", ("b", "other", "a"), 100.0, "QTM")
    values = np.zeros((len(numbers), 3, 4))
    values[..., 0] = numbers[:, None]
    values[:, 0, 1:3], values[:, 2, 1:3] = (1, 2), (3, 4)
    return track(stream, numbers, start_s + numbers / 100, values, host_s)


def sync(count: int, rise: int, fall: int) -> Track:
    """1 kHz, high from sample `rise` to before `fall`."""
    numbers = np.arange(count)
    high = (numbers >= rise) & (numbers < fall)
    return track(Stream("/sync", "V", ("sync",), 1000.0, "DAQ"), numbers, numbers / 1000, 5.0 * high[:, None], 0.0)


def one_clock(**changes: object) -> Tracks:
    """Force from −0.5 s to 3 s, frames from 0.5 s to 2.5 s of session time."""
    return {"/force": force(np.arange(3501), 9.5), "/markers": markers(np.arange(7, 208), 10.43)} | changes  # type: ignore[dict-item]


def captured(rise: int = 2000, frames: int = 300, late_s: float = 0.0, **changes: Track) -> Tracks:
    """A capture of frames 1 to 300 that begins between the samples before and at the rise of the sync line."""
    edge_s = (rise - 0.5) / 1000
    numbers = np.arange(1, frames + 1)
    tracks = {
        "/force": force(np.arange(6000)),
        "/sync": sync(6000, rise, rise + 10 * frames),
        "/markers": markers(numbers, -0.01, edge_s + late_s),
    }
    return tracks | changes


def build(tracks: Tracks, manifest: Manifest = MANIFEST) -> Timeline:
    return build_timeline(manifest, tracks, ("a", "b"))


def test_streams_of_one_clock_have_its_time_less_the_origin_and_the_lag_of_force() -> None:
    timeline = build(one_clock(), replace(MANIFEST, timing=Timing(lag_s=0.0042, lag_sd_s=0.001)))
    time = np.arange(3501) / 1000 - 0.5 + 0.0042
    chosen = (time >= 0) & (time <= 2.5)
    np.testing.assert_allclose(timeline.force_time, time[chosen], atol=1e-9)
    np.testing.assert_allclose(timeline.force, -2 * (3 + np.arange(3501) / 1000)[chosen], atol=1e-12)
    assert timeline.force_step == pytest.approx(0.002)
    np.testing.assert_allclose(timeline.marker_time, 0.5 + np.arange(201) / 100, atol=1e-9)
    for marker, (y, z) in enumerate([(3, 4), (1, 2)]):
        expected = [(1e-3 * n, 1e-3 * y, 1e-3 * z) for n in range(7, 208)]
        np.testing.assert_allclose(timeline.markers[:, marker], expected, atol=1e-12)
    lag = timeline.lag
    assert (lag.edge, lag.declared, lag.drift, lag.value) == (0.0, 0.001, 0.0, 0.0042)
    clock = timeline.clock
    assert (clock.start, clock.ratio, clock.has_both_edges) == (10.0, 1.0, False)
    assert clock.covariance.tolist() == [[0.0, 0.0], [0.0, 0.0]]
    assert timeline.notes == timeline.force_gaps == timeline.frame_gaps == () and timeline.sync_fall is None
    assert timeline.capture_end is None  # the file of the force is longer


def test_two_clocks_that_were_declared_to_agree_drift_apart() -> None:
    assert build(one_clock(), replace(MANIFEST, start="declared")).lag.drift == 50e-6


def test_lost_samples_are_gaps_and_lost_frames_not_a_number() -> None:
    """Gaps before time 0 and after the end of the frames at 2.5 s are no loss of the trial."""
    kept = np.ones(3501, bool)
    for first, last in ((100, 110), (490, 510), (1000, 1001), (2993, 3010), (3100, 3200)):
        kept[first:last] = False
    numbers = np.delete(np.arange(7, 208), [50, 51])
    timeline = build(one_clock(**{"/force": force(np.arange(3501)[kept], 9.5), "/markers": markers(numbers, 10.43)}))
    assert timeline.force_gaps == tuple(
        pytest.approx(gap, abs=1e-9) for gap in ((-0.011, 0.01), (0.499, 0.501), (2.492, 2.51))
    )
    assert timeline.frame_gaps == (pytest.approx((0.99, 1.02), abs=1e-9),)
    assert len(timeline.markers) == 201
    assert np.isnan(timeline.markers).any(axis=(1, 2)).nonzero()[0].tolist() == [50, 51]
    found = figures_by_code(timeline.notes)
    assert found[TrialNoteCode.FORCE_LOST]["count"] == 3
    lost = pytest.approx(0.03)
    assert found[TrialNoteCode.FRAMES_LOST] == {"count": 1, "total_s": lost, "longest_s": lost}


def test_a_gap_that_ends_at_time_zero_or_begins_at_the_end_is_none_and_one_before_the_last_sample_is() -> None:
    """Times are exact: the first 501 samples last to 0, and the last frame is at 2.5 s."""
    kept = np.ones(3501, bool)
    kept[490:500] = kept[3001:3010] = False
    assert build(one_clock(**{"/force": force(np.arange(3501)[kept], 9.5)})).force_gaps == ()
    timeline = build(one_clock(**{"/force": force(np.array([*range(2001), 2010]), 9.5)}))
    assert timeline.force_gaps == (pytest.approx((1.5, 1.51), abs=1e-9),)


@pytest.mark.parametrize(
    ("name", "changed", "code", "figures"),
    [
        ("/force", None, "NO_SAMPLES", {"stream": "/force"}),
        ("/markers", markers(np.arange(0)), "NO_SAMPLES", {"stream": "/markers"}),
        ("/force", force(np.array([5, 6, 6, 7]), 9.5), "NUMBERS_GO_BACK", {"stream": "/force", "sample": 6}),
        ("/force", force(np.array([5, 9, 7, 8]), 9.5), "NUMBERS_GO_BACK", {"stream": "/force", "sample": 9}),
    ],
    ids=["no force", "no frames", "a number twice", "numbers go back"],
)
def test_a_stream_without_samples_or_with_numbers_that_go_back_is_refused(
    name: str, changed: Track | None, code: str, figures: dict[str, object]
) -> None:
    tracks = one_clock() | ({name: changed} if changed else {})
    if changed is None:
        del tracks[name]
    with raises_refusal(RejectionCode[code], **figures):
        build(tracks)


@pytest.mark.parametrize(
    ("frames", "figures"),
    [
        (np.arange(7, 107), {"frames": 100, "samples": 1491, "force_end_s": 3.0, "marker_end_s": 1.49, "both_s": 0.99}),
        (np.arange(400, 600), {"frames": 0, "both_s": 0.0}),
        (np.array([7, 207]), None),
    ],
    ids=["0.99 s", "after the force", "two frames"],
)
def test_less_than_a_second_of_force_and_frames_together_is_refused(
    frames: NDArray[np.int64], figures: dict[str, object] | None
) -> None:
    tracks = one_clock(**{"/markers": markers(frames, 10.43)})
    if figures is None:
        assert build(tracks).marker_time[0] == pytest.approx(0.5)
        return
    expected = {name: pytest.approx(value, abs=1.1 if name == "samples" else 1e-9) for name, value in figures.items()}
    with raises_refusal(RejectionCode.NO_OVERLAP, expected_s=1.0, **expected):
        build(tracks)


@pytest.mark.parametrize(
    ("numbers", "frames_from_s", "samples"),
    [
        (np.arange(1000, 3000), 0.4905, 1001),
        (np.arange(0, 2001), 0.4995, 1501),
        (np.array([600, 2500]), 0.5, 2),
        (np.array([100, 2500]), 0.5, None),
        (np.arange(1001, 3000), 0.4905, None),
        (np.arange(0, 2000), 0.4995, None),
    ],
    ids=["force begins last", "force ends first", "two samples", "one sample", "0.9995 s", "0.9995 s to the end"],
)
def test_force_counts_from_its_first_to_its_last_sample(
    numbers: NDArray[np.int64], frames_from_s: float, samples: int | None
) -> None:
    """Force and frames have 1.0005 s in common, or 0.9995 s."""
    frames = np.arange(7, 109) if frames_from_s == 0.4905 else np.arange(7, 208)
    tracks = {"/force": force(numbers, 9.5), "/markers": markers(frames, 10 + frames_from_s - 0.07)}
    if samples is None:
        with raises_refusal(RejectionCode.NO_OVERLAP):
            build(tracks)
        return
    timeline = build(tracks)
    assert len(timeline.force_time) == samples


def test_the_capture_begins_at_the_rise_and_lasts_as_long_as_its_frames() -> None:
    timeline = build(captured(), EDGE)
    assert (timeline.clock.start, timeline.clock.ratio) == (pytest.approx(1.9995), pytest.approx(1.0, abs=1e-6))
    np.testing.assert_allclose(timeline.marker_time, np.arange(300) / 100, atol=1e-12)
    assert timeline.force_time[:2] == pytest.approx([0.0005, 0.0015], abs=1e-6)
    assert timeline.force[0] == -2 * 5.0
    assert timeline.sync_fall == pytest.approx(3.0, abs=1e-5)
    assert timeline.notes == ()
    assert timeline.lag.edge == pytest.approx(1e-3 / np.sqrt(24), rel=0.01), "the middle of two edges"
    assert timeline.lag.drift == timeline.clock.common_drift == 0.0


def test_part_of_the_error_of_an_undeclared_stop_edge_is_common_and_without_one_the_clocks_may_drift() -> None:
    timeline = build(captured(), replace(EDGE, timing=Timing()))
    assert timeline.lag.drift == timeline.clock.common_drift > 0
    own = timeline.clock.time_sd(1.495) ** 2 - (timeline.clock.common_drift * 1.495) ** 2
    assert timeline.lag.edge == pytest.approx(np.sqrt(max(0.0, own)), abs=1e-9)
    timeline = build(captured(**{"/sync": sync(6000, 2000, 6000)}), EDGE)
    assert timeline.capture_end == pytest.approx(4.0, abs=2e-3)
    shorter = captured(**{"/sync": sync(4000, 2000, 4000), "/force": force(np.arange(4000))})
    assert build(shorter, EDGE).capture_end == pytest.approx(2.99, abs=2e-3)
    assert timeline.sync_fall is None and not timeline.clock.has_both_edges
    assert (timeline.lag.edge, timeline.lag.drift) == (pytest.approx(1e-3 / np.sqrt(12)), 50e-6)
    assert figures_by_code(timeline.notes).keys() == {TrialNoteCode.SYNC_NO_STOP}


def test_lost_first_frames_leave_the_time_of_a_capture_and_live_preview_before_it_is_left_out() -> None:
    tracks = captured()
    later = markers(np.arange(21, 301), -0.01, 1.9995)
    timeline = build(tracks | {"/markers": later}, EDGE)
    assert timeline.marker_time[0] == pytest.approx(0.2)
    assert timeline.markers[0, 0, 0] == pytest.approx(0.021)
    preview, capture = markers(np.arange(500, 600), -6.0, 1.0), captured()["/markers"]
    names = ("sample_numbers", "device_time_ns", "host_time_ns", "values")
    both = [np.concatenate([getattr(preview, name), getattr(capture, name)]) for name in names]
    timeline = build(captured(**{"/markers": Track(capture.stream, *both)}), EDGE)
    np.testing.assert_allclose(timeline.markers[:, 0, 0], 1e-3 * np.arange(1, 301))


def test_the_fall_of_the_line_is_on_the_clock_of_the_frames() -> None:
    """The DAQ counts 3.001 s in the 3 s of the frames."""
    timeline = build(captured(**{"/sync": sync(6000, 2000, 5001)}), EDGE)
    assert timeline.clock.ratio == pytest.approx(1 + 1 / 3000, abs=5e-5)
    assert timeline.sync_fall == timeline.capture_end == pytest.approx(3.0, abs=1e-4)


@pytest.mark.parametrize(
    ("fall", "late_s", "code", "figures", "edge_sd"),
    [
        (5200, 0.2, TrialNoteCode.SYNC_BEFORE_FRAMES, {"early_s": pytest.approx(0.2)}, 0.2),
        (4900, 0.0, TrialNoteCode.SYNC_CONTRADICTION, {"before_end_s": pytest.approx(0.1), "limit": 5e-4}, 0.1),
    ],
    ids=["rises before the first frame", "falls before the last frame"],
)
def test_a_pulse_that_contradicts_the_number_of_frames_is_noted_and_in_the_error(
    fall: int, late_s: float, code: TrialNoteCode, figures: dict[str, object], edge_sd: float
) -> None:
    timeline = build(captured(late_s=late_s, **{"/sync": sync(6000, 2000, fall)}), EDGE)
    assert figures_by_code(timeline.notes) == {code: figures}
    assert timeline.lag.edge == pytest.approx(edge_sd, rel=1e-3)


@pytest.mark.parametrize(("late_s", "is_late"), [(0.499, False), (-0.499, False), (0.501, True), (-0.501, True)])
def test_frames_that_arrive_half_a_second_off_have_their_time_from_the_host(late_s: float, is_late: bool) -> None:
    timeline = build(captured(rise=3000, frames=250, late_s=late_s), EDGE)
    found = figures_by_code(timeline.notes)
    assert (TrialNoteCode.SYNC_ARRIVAL in found) is is_late
    first = timeline.marker_time[0]
    if is_late:
        assert found[TrialNoteCode.SYNC_ARRIVAL] == {"late_s": pytest.approx(late_s), "standard_error_s": 0.05}
        assert timeline.lag.edge == pytest.approx(0.05, rel=0.01)
        assert first == pytest.approx(late_s % 0.01 if late_s < 0 else late_s, abs=1e-6)
    else:
        assert first == 0.0


def test_a_serial_load_cell_is_aligned_by_its_arrival() -> None:
    """Its clock shows 100 s when that of the DAQ shows 0, and its samples arrive as those of the DAQ do."""
    manifest = replace(EDGE, load_cell=replace(CELL, source="serial"))
    timeline = build(captured(**{"/force": force(np.arange(6000), 100.0, -100.0, "N")}), manifest)
    assert timeline.force_time[:2] == pytest.approx([0.0005, 0.0015], abs=1e-5)
    assert (timeline.lag.edge, timeline.lag.drift) == (pytest.approx(0.05, rel=1e-3), 50e-6)


@pytest.mark.parametrize("has_sync", [True, False])
def test_a_trigger_starts_sample_0_at_the_edge(has_sync: bool) -> None:
    tracks = captured(rise=0)
    tracks["/markers"] = markers(np.arange(1, 301), -0.01, 0.0)
    if not has_sync:
        del tracks["/sync"]
    timeline = build(tracks, replace(EDGE, start="pfi0"))
    assert (timeline.force_time[0], timeline.marker_time[0]) == (pytest.approx(0.0, abs=1e-6), 0.0)
    assert timeline.force[0] == -2 * 3.0
    assert timeline.sync_fall == (pytest.approx(2.9995, abs=2e-3) if has_sync else None)
    assert has_sync or (timeline.lag.edge, timeline.lag.drift) == (0.0, 50e-6)


@pytest.mark.parametrize(("unit", "is_saturated"), [("V", True), ("N", False)])
def test_the_range_of_the_converter_limits_volts_alone(unit: str, is_saturated: bool) -> None:
    manifest = replace(MANIFEST, load_cell=replace(CELL, range_v=5.0))
    tracks = one_clock(**{"/force": force(np.arange(3501), 9.5, unit=unit)})
    if is_saturated:
        with raises_refusal(RejectionCode.FORCE_SATURATED, limit=5.0):
            build(tracks, manifest)
    else:
        assert len(build(tracks, manifest).force)


@pytest.mark.parametrize("is_measured", [True, False])
def test_the_force_of_a_motion_counts_only_if_the_cord_is_measured(is_measured: bool) -> None:
    body = BodyMarkers(("a",), ("b",), is_cord_measured=is_measured)
    manifest = replace(MANIFEST, cuff=None, body=body, load_cell=replace(CELL, range_v=5.0))
    if is_measured:
        with raises_refusal(RejectionCode.FORCE_SATURATED):
            build(one_clock(), manifest)
        return
    gap = force(np.delete(np.arange(3501), np.arange(1000, 1100)), 9.5)
    timeline = build(one_clock(**{"/force": gap}), manifest)
    assert len(timeline.force) and (timeline.force_gaps, timeline.notes) == ((), ())
    timeline = build({"/markers": one_clock()["/markers"]}, manifest)
    assert len(timeline.force) == len(timeline.force_time) == 0 and len(timeline.marker_time) == 201


def test_a_captured_motion_without_force_has_the_time_of_its_start_edge() -> None:
    """The edge lies within 1 ms."""
    body = BodyMarkers(("a",), ("b",), is_cord_measured=False)
    tracks = captured()
    del tracks["/force"]
    timeline = build(tracks, replace(EDGE, cuff=None, body=body))
    assert len(timeline.force) == len(timeline.force_time) == 0
    np.testing.assert_allclose(timeline.marker_time, np.arange(300) / 100, atol=1e-12)
    assert (timeline.lag.edge, timeline.lag.drift) == (pytest.approx(1e-3 / np.sqrt(12)), 50e-6)


# What is kept of a recording says the same of its clocks and rates as all of it, however it came in blocks.


@cache
def _dynamic() -> tuple[Manifest, Tracks]:
    return Session(published("hand", clock_ppm=80e-6, occlusion=0.02), 5).dynamic()


def _blocks(track: Track, sizes: list[int]) -> Iterator[Samples]:
    first = 0
    while first < len(track.sample_numbers):
        last = first + sizes[first % len(sizes)]
        part = slice(first, last)
        host_ns = int(track.host_time_ns[part][-1])
        yield Samples(
            track.stream.name, track.sample_numbers[part], track.device_time_ns[part], host_ns, track.values[part]
        )
        first = last


def _hosts_by_block(track: Track, sizes: list[int]) -> Track:
    hosts = [np.full(len(block.sample_numbers), block.host_time_ns) for block in _blocks(track, sizes)]
    return replace(track, host_time_ns=np.concatenate(hosts))


@pytest.mark.parametrize("sizes", [[50], [1, 7, 23], [1000]])
def test_block_by_block_or_as_a_whole_the_same_rows_are_kept(sizes: list[int]) -> None:
    manifest, tracks = _dynamic()
    tracks = {name: _hosts_by_block(track, sizes) for name, track in tracks.items()}
    decimator = Decimator(manifest, [track.stream for track in tracks.values()])
    for track in tracks.values():
        for block in _blocks(track, sizes):
            decimator.take(block)
    kept = decimator.tracks()
    for name, whole in decimate(manifest, tracks).items():
        np.testing.assert_array_equal(kept[name].sample_numbers, whole.sample_numbers)
        np.testing.assert_array_equal(kept[name].device_time_ns, whole.device_time_ns)
        np.testing.assert_array_equal(kept[name].host_time_ns, whole.host_time_ns)
        np.testing.assert_allclose(kept[name].values, whole.values, rtol=1e-12)
    assert certify(manifest, kept) == certify(manifest, decimate(manifest, tracks))


def test_what_is_kept_grows_by_twenty_rows_a_second_and_ties_the_clocks_as_all_of_it_does() -> None:
    manifest, tracks = _dynamic()
    decimated = decimate(manifest, tracks)
    seconds = len(tracks["/force"].sample_numbers) / 1000
    assert len(decimated["/force"].sample_numbers) == pytest.approx(20 * seconds, abs=2)
    assert len(decimated["/markers"].sample_numbers) <= 20 * seconds
    assert len(decimated["/sync"].sample_numbers) <= 10
    whole, kept = align_by_sync_edge(manifest, tracks), align_by_sync_edge(manifest, decimated)
    assert (kept.clock.start, kept.clock.ratio) == (whole.clock.start, whole.clock.ratio)
    assert kept.sync_fall == whole.sync_fall and kept.sync_findings == whole.sync_findings
    assert kept.edge_sd == pytest.approx(whole.edge_sd, rel=1e-3)


@pytest.mark.parametrize("has_stop", [True, False])
def test_the_certificate_of_uniform_edges_has_their_closed_form(has_stop: bool) -> None:
    """Edges lie within 1 ms, the capture lasts 2.99 s, force rises by 2 N/s and marker b by 100 mm/s."""
    tracks = captured() if has_stop else captured(**{"/sync": sync(6000, 2000, 6000)})
    values = tracks["/markers"].values.copy()
    values[:, 2, 0] = 0.0
    tracks |= {"/markers": replace(tracks["/markers"], values=values)}
    found = certify(EDGE, decimate(EDGE, tracks))
    assert found is not None
    edge_sd, half_width = 1e-3 / np.sqrt(12), (1 - np.sqrt(0.05)) * 1e-3 / 3
    drift_sd = np.sqrt(2) * edge_sd / 3 if has_stop else 50e-6
    time_sd = edge_sd if has_stop else np.hypot(edge_sd, 2.99 * drift_sd)
    entry = sync_entry(found)
    stated = entry.model_dump(exclude={"findings", "finding_codes"})
    assert stated == {
        "has_both_edges": has_stop,
        "offset_s": pytest.approx(1.9995),
        "offset_standard_error_s": pytest.approx(edge_sd),
        "clock_ratio_ppm": pytest.approx(0.0, abs=0.2),
        "clock_ratio_standard_error_ppm": pytest.approx(1e6 * drift_sd, rel=1e-3),
        "clock_ratio_ci95_ppm": pytest.approx([-1e6 * half_width, 1e6 * half_width], abs=0.2) if has_stop else None,
        "clock_ratio_is_identified": has_stop,
        "stop_edge_contradiction_s": 0.0,
        "peak_force_rate_n_per_s": pytest.approx(2.0),
        "peak_speed_m_per_s": pytest.approx(0.1),
        "time_standard_error_s": pytest.approx(time_sd, rel=1e-3),
        "force_standard_error_n": pytest.approx(2.0 * time_sd, rel=1e-3),
        "displacement_standard_error_m": pytest.approx(0.1 * time_sd, rel=1e-3),
    }
    assert [note.code for note in found.findings] == ([] if has_stop else [TrialNoteCode.SYNC_NO_STOP])
    assert [(note.code, note.figures) for note in entry.finding_codes] == [
        (one.code, one.figures) for one in found.findings
    ]
    assert entry.findings == list(map(str, found.findings))
    figures = found.summary.figures
    common = {"offset_sd_s": found.offset_sd, "time_sd_s": found.errors.time, "force_sd_n": found.errors.force}
    common |= {"force_rate_n_per_s": found.force_rate, "displacement_sd_m": found.errors.displacement}
    common |= {"speed_m_per_s": found.speed}
    if has_stop:
        assert found.drift_ci95 is not None
        low, high = found.drift_ci95
        own = {"offset_of_both_edges_s": found.offset, "drift": found.drift, "low": low, "high": high}
        unknown = replace(found, is_identified=False).summary.figures
        assert (unknown["lowest_drift"], unknown["highest_drift"], "drift" in unknown) == (low, high, False)
    else:
        own = {"offset_of_start_edge_s": found.offset, "assumed_drift": found.drift, "drift_sd": found.drift_sd}
    assert figures == common | own


@pytest.mark.parametrize("fast", ["first", "last"])
@pytest.mark.parametrize("samples", [6000, 4000], ids=["frames end first", "force ends first"])
def test_rates_are_the_highest_between_the_edge_and_the_end_of_the_shorter_stream(samples: int, fast: str) -> None:
    """9 N/s and 0.9 m/s elsewhere; 6 N/s and 0.6 m/s in the first or the last two rows of 50 ms, 3 and 0.3 within."""
    end, last_frame = (4950, 299) if samples == 6000 else (4000, 200)
    time, frame = np.arange(6000), np.arange(1, 300)
    first, quick = (2000, frame < 15) if fast == "first" else (end - 100, frame > last_frame - 10)
    slope = np.where((time >= 2000) & (time < end), np.where((time >= first) & (time < first + 100), 3.0, 1.5), 4.5)
    force_values = 1e-3 * np.cumsum(slope)[:samples, None]
    step = np.where(frame <= last_frame, np.where(quick, 6.0, 3.0), 9.0)
    tracks = captured(frames=299)
    tracks["/force"] = replace(force(np.arange(samples)), values=force_values)
    values = np.zeros_like(tracks["/markers"].values)
    values[:, 0, 0] = np.cumsum(step)
    tracks["/markers"] = replace(tracks["/markers"], values=values)
    found = certify(EDGE, decimate(EDGE, tracks))
    assert found is not None
    assert (found.force_rate, found.speed) == (pytest.approx(6.0), pytest.approx(0.6))
    assert (found.errors.force, found.errors.displacement) == pytest.approx(
        (6.0 * found.errors.time, 0.6 * found.errors.time)
    )


def test_streams_of_one_clock_have_no_certificate_and_labels_that_are_missing_are_named() -> None:
    assert certify(MANIFEST, one_clock()) is None
    elsewhere = replace(EDGE, cuff=CuffSite("hand", "arm", ("a", "c"), ("d",)))
    with raises_refusal(RejectionCode.MISSING_MARKERS, missing="c, d", present="b, other, a"):
        certify(elsewhere, captured())
    with raises_refusal(RejectionCode.MISSING_MARKERS, missing="c", present="none"):
        require_labels(("c",), ())


def test_damage_is_its_first_note_and_a_count_of_the_others() -> None:
    assert [damage_figures(tuple("abc"[:count])) for count in (1, 2, 3)] == [
        {"damage": "a"},
        {"damage": "a", "more": 1},
        {"damage": "a", "more": 2},
    ]


def test_losses_of_both_streams_are_counted_summed_and_the_longest_named() -> None:
    force, frames = loss_notes(((0.0, 0.5), (1.0, 3.0)), ((2.0, 2.25),))
    assert (force.code, force.figures) == (TrialNoteCode.FORCE_LOST, {"count": 2, "total_s": 2.5, "longest_s": 2.0})
    lost = {"count": 1, "total_s": 0.25, "longest_s": 0.25}
    assert (frames.code, frames.figures) == (TrialNoteCode.FRAMES_LOST, lost)
    assert loss_notes((), ()) == ()


def rests(end: float, start: float = 0.0, slope: float = 0.0) -> float | None:
    """Drift of the zero of a pull by 100 N for 10 s, with rests of 1.5 s; slope [N/s] of the force in the first."""
    time = np.arange(1000) / 100
    force = np.full(1000, 100.0)
    force[:150], force[-150:] = start + slope * (time[:150] - 0.5), end
    return zero_drift(time, force)


def test_the_zero_drifts_by_the_difference_of_the_rests_at_both_ends() -> None:
    assert rests(3.0) == pytest.approx(3.0, abs=1e-9) and rests(1.0, start=3.0) == pytest.approx(-2.0, abs=1e-9)
    assert rests(24.0) == pytest.approx(24.0) and rests(25.0) is None, "the lowest quarter of the range"
    assert rests(0.0, start=24.8, slope=1.6) is None, "both halves"
    assert rests(3.0, slope=3.8) == pytest.approx(3.0, abs=0.02) and rests(3.0, slope=4.2) is None, "halves by 2 %"
    assert rests(9.0, start=-20.0) == pytest.approx(29.0) and rests(11.0, start=-20.0) is None
    assert zero_drift(np.array([0.0, 5.0, 9.0]), np.zeros(3)) is None, "one sample is no rest"


def test_a_rest_is_less_than_a_second_from_the_end_and_has_halves_that_differ_by_less_than_2_percent() -> None:
    """Of a range of 100 N, in binary fractions, with the hook at -50 N."""
    time = np.array([0.0, 0.5, 1.0, 5.0, 9.0, 9.25, 10.0])

    def drift(*ends: float) -> float | None:
        return zero_drift(time, np.array([*ends[:2], 50.0, 50.0, 50.0, *ends[2:]]))

    assert drift(-50.0, -50.0, -46.0, -46.0) == 4.0
    assert drift(-50.0, -48.015625, -46.0, -46.0) == pytest.approx(3.0078125)
    assert drift(-50.0, -48.0, -46.0, -46.0) is None is drift(-50.0, -50.0, -46.0, -48.0)


@pytest.mark.parametrize(
    ("drift", "span", "limit"),
    [(0.6, 0.0, 0.5), (-0.6, 25.0, 0.5), (-2.1, 100.0, 2.0), (0.5, 0.0, None), (2.0, 100.0, None), (None, 100.0, None)],
)
def test_a_drift_is_noted_above_half_a_newton_and_2_percent_of_the_range(
    drift: float | None, span: float, limit: float | None
) -> None:
    notes = zero_notes(drift, span)
    assert [(note.code, note.figures) for note in notes] == (
        [] if limit is None else [(TrialNoteCode.ZERO_DRIFT, {"drift_n": drift, "limit_n": limit})]
    )


def test_the_zero_is_steady_up_to_its_limit() -> None:
    for drift in (None, 4.9, -4.9):
        require_steady_zero(drift, 4.9)
    for drift in (5.0, -5.0):
        with raises_refusal(RejectionCode.ZERO_DRIFT, drift_n=drift, limit_n=4.9):
            require_steady_zero(drift, 4.9)


def test_the_highest_rate_passes_over_gaps_and_rows_that_are_not_full() -> None:
    numbers = np.arange(49, 1000, 50)  # rows of 50 samples at 1 kHz, named by their last one
    means = np.column_stack((3.0 * numbers, 4.0 * numbers)) * 1e-3
    means[5] = np.nan
    numbers[10:] += 50
    means[10:] += 100.0
    assert highest_rate(numbers, means, 1000.0) == pytest.approx(5.0)
    assert highest_rate(numbers[:1], means[:1], 1000.0) == 0.0
    assert highest_rate(np.arange(5), np.array([[0.0], [1.0], [3.0], [3.0], [3.0]]), 10.0) == pytest.approx(20.0)
