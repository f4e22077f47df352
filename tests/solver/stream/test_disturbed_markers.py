"""Hidden, exchanged and jumping markers, a person who leaves, and nonsense: outcomes, and the stream goes on.

Noise measured on line, beside the noise that was drawn and the estimate over the whole record.
"""

import numpy as np

from solver.inverse_kinematics.solve import Array, estimate_marker_noise
from solver.stream.stream_frame import StreamFrame, StreamOutcome
from solver.stream.stream_solver import ASSUMED_NOISE, LEAST_NOISE, RunningMarkerNoise
from tests.solver.stream.streams import FIRST, FRAMES, MODEL, NAMES, NOISE, raised, seen, solver, stream

HELD = [MODEL.coordinate_index(name) for name in ("clav_prot", "scapula_upward_rot", "shoulder_elv", "elbow_flexion")]
FAULT = range(25, 35)
INTERVAL, NOISY_FRAMES = 0.01, 1200


def undisturbed() -> list[StreamFrame]:
    return stream(seen(), solver({}))


def outcomes(frames: list[StreamFrame]) -> list[StreamOutcome]:
    return [frame.outcome for frame in frames]


def coordinates(frames: list[StreamFrame]) -> Array:
    return np.array([frame.coordinates for frame in frames])


def place(name: str) -> int:
    return NAMES.index(name)


def test_exchanged_labels_are_exchanged_back_and_named() -> None:
    one, other = place("humerus_0"), place("scapula_2")
    pushed = seen().copy()
    pushed[np.ix_(FAULT, [one, other])] = pushed[np.ix_(FAULT, [other, one])]
    found = stream(pushed, solver({}))
    assert coordinates(found).tobytes() == coordinates(undisturbed()).tobytes()
    for k, frame in enumerate(found):
        is_exchanged = k in FAULT
        assert frame.outcome == (StreamOutcome.MARKERS_EXCHANGED if is_exchanged else StreamOutcome.SOLVED)
        assert {name for pair in frame.exchanged for name in pair} == (
            {"humerus_0", "scapula_2"} if is_exchanged else set()
        )


def test_a_marker_that_jumps_is_left_out_until_it_is_back() -> None:
    pushed = seen().copy()
    pushed[np.ix_(FAULT, [place("ulna_1")])] += [0.0, 0.2, 0.1]
    found = stream(pushed, solver({}))
    judged = range(FAULT.start, FAULT.stop + 1)  # back in the last of them, and used from the next one
    for k, frame in enumerate(found):
        assert frame.left_out == (("ulna_1",) if k in judged else ())
        assert (frame.outcome is StreamOutcome.MARKER_LEFT_OUT) == (k in judged)
    assert np.abs(coordinates(found) - coordinates(undisturbed())).max() < 50 * NOISE


def test_hidden_markers_leave_their_coordinates_without_hold_and_named() -> None:
    pushed, hidden = seen().copy(), [name for name in NAMES if name.startswith(("radius", "hand"))]
    pushed[np.ix_(FAULT, [place(name) for name in hidden])] = np.nan
    found = stream(pushed, solver({}))
    lost = MODEL.coordinate_index("pro_sup")
    for k, frame in enumerate(found):
        assert frame.hidden == (tuple(hidden) if k in FAULT else ())
        assert frame.lost == (("pro_sup",) if k in FAULT else ())
        assert np.isinf(frame.standard_deviations[0, lost]) == (k in FAULT)
    assert np.abs(np.diff(coordinates(found)[:, lost])).max() < 20 * NOISE
    assert np.abs(coordinates(found)[:, HELD] - coordinates(undisturbed())[:, HELD]).max() < 50 * NOISE


def test_frames_without_markers_are_interpolated_within_the_lag() -> None:
    pushed = seen().copy()
    pushed[FAULT] = np.nan
    found = stream(pushed, solver({}))
    assert [k for k, outcome in enumerate(outcomes(found)) if outcome is StreamOutcome.INTERPOLATED] == list(FAULT)
    assert np.abs(coordinates(found) - raised()[FIRST : FIRST + FRAMES]).max() < 0.01
    without_lag = outcomes(stream(pushed, solver({}, lag_s=0.0)))
    assert [k for k, outcome in enumerate(without_lag) if outcome is StreamOutcome.NO_MARKERS] == list(FAULT)


def test_a_person_who_leaves_and_returns_elsewhere_begins_a_new_motion() -> None:
    away = 60
    hidden, elsewhere = np.full((away, *seen().shape[1:]), np.nan), seen()[40:] + np.array([0.5, 0.0, -0.3])
    pushed = np.concatenate([seen()[:20], hidden, elsewhere])
    found = stream(pushed, solver({}))
    assert outcomes(found[:20]) == [StreamOutcome.SOLVED] * 20
    assert outcomes(found[20 : 20 + away]) == [StreamOutcome.NO_MARKERS] * away
    assert all(np.isnan(frame.coordinates).all() and not frame.suits for frame in found[20 : 20 + away])
    back = found[20 + away :]
    assert outcomes(back) == [StreamOutcome.SOLVED] * 20
    moved = MODEL.coordinate_index("shoulder_elv")
    assert np.abs(coordinates(back)[:, moved] - raised()[FIRST + 40 : FIRST + FRAMES, moved]).max() < 0.01


def test_random_gaps_never_end_the_stream_and_stay_within_their_uncertainty() -> None:
    chance = np.random.default_rng(7)
    for part in (0.1, 0.4):
        pushed = np.where(chance.random(seen().shape[:2])[..., None] < part, np.nan, seen())
        found = stream(pushed, solver({}))
        assert len(found) == FRAMES
        given = [k for k, frame in enumerate(found) if frame.outcome is StreamOutcome.SOLVED]
        assert len(given) > 0.9 * FRAMES
        for k in given:
            away = np.abs(found[k].coordinates - raised()[FIRST + k])
            assert (away < 8 * found[k].standard_deviations[0] + 2e-3).all()


def test_nonsense_costs_its_own_frames_only() -> None:
    chance, pushed = np.random.default_rng(8), seen().copy()
    pushed[20] = chance.uniform(-5.0, 5.0, pushed[20].shape)
    pushed[30] = np.inf
    pushed[40] = 0.0
    found = stream(pushed, solver({}))
    assert len(found) == FRAMES
    assert found[30].outcome is StreamOutcome.INTERPOLATED
    assert len(found[30].hidden) == len(NAMES)
    untouched = [k for k in range(FRAMES) if k not in (20, 30, 40)]
    assert [found[k].outcome for k in untouched] == [StreamOutcome.SOLVED] * len(untouched)
    assert np.abs(coordinates(found) - coordinates(undisturbed())).max() < 50 * NOISE


def test_the_noise_of_every_marker_is_found_while_it_moves() -> None:
    chance, time = np.random.default_rng(2), INTERVAL * np.arange(NOISY_FRAMES)
    drawn = np.array([2e-4, 6e-4, 2e-3])
    path = np.stack([0.3 * np.sin(3 * time), 0.2 * np.cos(2 * time), 0.1 * time], axis=1)
    positions = path[:, None] + drawn[:, None] * chance.standard_normal((NOISY_FRAMES, 3, 3))
    positions[300:310, 1] = np.nan
    positions[500:, 0] += 0.3  # a jump is no noise
    running = RunningMarkerNoise(3)
    assert (running.standard_deviation == ASSUMED_NOISE).all()
    for k in range(NOISY_FRAMES):
        running.add(time[k], positions[k])
    np.testing.assert_allclose(running.standard_deviation, drawn, rtol=0.15)
    np.testing.assert_allclose(running.standard_deviation, estimate_marker_noise(positions, INTERVAL), rtol=0.15)


def test_uneven_frames_do_not_count_and_no_marker_is_without_noise() -> None:
    running, uneven = RunningMarkerNoise(1), RunningMarkerNoise(1)
    chance, time = np.random.default_rng(3), 0.0
    for k in range(NOISY_FRAMES):
        running.add(k * INTERVAL, np.zeros((1, 3)))
        time += INTERVAL * chance.choice([1.0, 1.6])
        uneven.add(time, chance.standard_normal((1, 3)))
    assert LEAST_NOISE <= running.standard_deviation[0] < 2e-4
    assert uneven.standard_deviation[0] == ASSUMED_NOISE
