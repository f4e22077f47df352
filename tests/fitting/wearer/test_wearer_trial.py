"""A recording of the wearer on one clock, from the streams of test_analog_signals."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fitting.results.trial_codes import RejectionCode, TrialNoteCode
from fitting.wearer.wearer_trial import (
    CycleDetector,
    build_wearer_trial,
    elevation,
    elevation_from_markers,
    find_cycles,
)
from recordings.manifest import BodyMarkers, EmgAmplifier
from tests.fitting.trial.test_analog_signals import LABELS, MANIFEST, recorded
from tests.refusals import raises_refusal

TIME = np.arange(0.0, 20.0, 0.01)
DEGREE = np.pi / 180


def test_markers_are_metres_and_emg_is_beside_them() -> None:
    tracks = recorded()
    trial = build_wearer_trial(MANIFEST, tracks, "a.mcap", "0" * 64)
    np.testing.assert_allclose(trial.markers[0], 1e-3 * tracks["/markers"].values[0, :, :3], rtol=1e-6)
    assert trial.emg is not None and trial.emg.labels == ("a", "b")
    assert trial.elevation is None and trial.cycles == () and trial.is_whole


def test_emg_without_a_common_clock_is_left_out_with_a_note_and_the_markers_stay() -> None:
    trial = build_wearer_trial(replace(MANIFEST, emg=EmgAmplifier("lsl")), recorded(), "a.mcap", "0" * 64)
    assert trial.emg is None
    assert len(trial.time) and TrialNoteCode.EMG_LEFT_OUT in [note.code for note in trial.notes]


@pytest.mark.parametrize("samples", [0, 4000])
def test_a_load_cell_that_is_not_used_does_not_limit_the_trial(samples: int) -> None:
    tracks = recorded()
    whole = build_wearer_trial(MANIFEST, tracks, "a.mcap", "0" * 64)
    force = tracks["/force"]
    kept = np.flatnonzero(np.arange(samples) % 2000 < 1500)  # with gaps
    cut = {name: getattr(force, name)[kept] for name in ("sample_numbers", "device_time_ns", "host_time_ns", "values")}
    short = build_wearer_trial(MANIFEST, tracks | {"/force": replace(force, **cut)}, "a.mcap", "0" * 64)
    np.testing.assert_array_equal(short.markers, whole.markers)
    assert short.is_whole and len(short.force) < max(1, samples)
    assert whole.body is not None
    used = replace(MANIFEST, body=replace(whole.body, is_cord_measured=True))
    if not samples:
        with raises_refusal(RejectionCode.NO_SAMPLES, stream="/force"):
            build_wearer_trial(used, tracks | {"/force": replace(force, **cut)}, "a.mcap", "0" * 64)
    else:
        assert not build_wearer_trial(used, tracks | {"/force": replace(force, **cut)}, "a.mcap", "0" * 64).is_whole


def test_hidden_markers_are_counted() -> None:
    tracks = recorded()
    values = tracks["/markers"].values.copy()
    values[250:500, 2] = np.nan
    tracks["/markers"] = replace(tracks["/markers"], values=values)
    hidden = build_wearer_trial(MANIFEST, tracks, "a.mcap", "0" * 64).hidden()
    assert hidden == pytest.approx(dict.fromkeys(LABELS, 0.0) | {LABELS[2]: 0.25}, abs=0.01)


@pytest.mark.parametrize(
    ("body", "code", "figures"),
    [
        (None, RejectionCode.NO_BODY, {"file": "a.mcap"}),
        (BodyMarkers(("c7", "nose")), RejectionCode.MISSING_MARKERS, {"missing": "nose"}),
    ],
)
def test_what_is_no_wearer_or_lacks_his_markers_is_refused(
    body: BodyMarkers | None, code: RejectionCode, figures: dict[str, str]
) -> None:
    with raises_refusal(code, **figures):
        build_wearer_trial(replace(MANIFEST, body=body), recorded(), "a.mcap", "0" * 64)


def raised(starts: list[float], heights: list[float], length: float = 3.0) -> np.ndarray:
    """Elevation [rad]: 30° at rest, a raised cosine of so many degrees from each start on."""
    angle = np.full(TIME.shape, 30.0)
    for start, height in zip(starts, heights, strict=True):
        inside = (start <= TIME) & (start + length >= TIME)
        angle[inside] += height * (1 - np.cos(2 * np.pi * (TIME[inside] - start) / length)) / 2
    return angle * DEGREE


@given(st.floats(0.05, 3.0), st.integers(0, 2**32 - 1))
def test_elevation_is_the_angle_between_arm_and_trunk_in_any_frame(angle: float, seed: int) -> None:
    down = np.array([0.0, 0.0, -1.0])
    arm = np.array([np.sin(angle), 0.0, -np.cos(angle)])
    turn = Rotation.random(rng=np.random.default_rng(seed))
    points = turn.apply([np.zeros(3), 0.3 * arm, [0.1, 0.2, 0.0], 0.4 * down + [0.1, 0.2, 0.0]])
    assert elevation(*(point[None] for point in points))[0] == pytest.approx(angle, abs=1e-9)


def test_a_hidden_marker_leaves_no_angle_and_an_undeclared_one_no_curve() -> None:
    markers = np.random.default_rng(1).normal(size=(3, 4, 3))
    markers[1, 2] = np.nan
    angle = elevation_from_markers(markers, ("s", "e", "u", "l"), ("s", "e"), ("u", "l"))
    assert angle is not None and np.isnan(angle).tolist() == [False, True, False]
    assert elevation_from_markers(markers, ("s", "e", "u", "x"), ("s", "e"), ("u", "l")) is None
    assert elevation_from_markers(markers, ("s", "e", "u", "l"), (), ()) is None


def test_every_raise_is_a_cycle_with_its_times_and_its_height() -> None:
    cycles = find_cycles(TIME, raised([1.0, 5.0, 9.0], [80, 90, 85]))
    assert [cycle.peak for cycle in cycles] == pytest.approx([2.5, 6.5, 10.5], abs=0.011)
    assert [cycle.highest / DEGREE for cycle in cycles] == pytest.approx([110, 120, 115], abs=0.1)
    tenth = 3.0 * np.arccos(0.8) / (2 * np.pi)
    assert [cycle.start for cycle in cycles] == pytest.approx([1 + tenth, 5 + tenth, 9 + tenth], abs=0.02)
    assert [cycle.end for cycle in cycles] == pytest.approx([4 - tenth, 8 - tenth, 12 - tenth], abs=0.02)


def test_small_movements_low_attempts_and_an_arm_that_never_moves_are_no_cycles() -> None:
    assert find_cycles(TIME, raised([2.0, 8.0], [15, 20])) == ()
    assert len(find_cycles(TIME, raised([1.0, 5.0, 9.0, 13.0], [80, 30, 75, 20]))) == 2
    assert find_cycles(TIME, np.full(TIME.shape, np.nan)) == ()
    assert find_cycles(TIME, np.full(TIME.shape, 0.5)) == ()


def test_a_raise_that_has_not_come_down_is_no_cycle_yet() -> None:
    angle = raised([1.0, 18.0], [80, 80])
    assert len(find_cycles(TIME, angle)) == 1
    detector = CycleDetector()
    detector.update(TIME, angle)
    assert detector.is_raised and len(detector.turns) == 1


def test_noise_and_hidden_frames_neither_add_nor_take_a_cycle() -> None:
    random = np.random.default_rng(3)
    angle = raised([1.0, 5.0, 9.0, 13.0], [80, 90, 85, 88]) + random.normal(0.0, 2 * DEGREE, TIME.shape)
    angle[random.uniform(size=TIME.shape) < 0.2] = np.nan
    angle[(TIME > 6.2) & (TIME < 6.8)] = np.nan
    assert len(find_cycles(TIME, angle)) == 4


def test_live_and_afterwards_the_count_is_the_same() -> None:
    angle = raised([1.0, 5.0, 9.0], [80, 90, 85])
    detector, counts = CycleDetector(), []
    for first in range(0, len(TIME), 5):
        detector.update(TIME[first : first + 5], angle[first : first + 5])
        counts.append(len(detector.turns))
    assert counts[-1] == len(find_cycles(TIME, angle)) == 3
    assert TIME[5 * counts.index(1)] == pytest.approx(3.2, abs=0.2), "counted on the way down"
