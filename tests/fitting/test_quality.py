"""When not to believe a trial, from others and from that trial alone."""

from dataclasses import replace

import numpy as np
import pytest

from fitting.pull.cuff_motion import MarkerQuality, marker_notes, marker_quality
from fitting.pull.pull import require_live_force, require_plausible_displacement
from fitting.results.sentences import Note
from fitting.results.trial_codes import RejectionCode, TrialNoteCode
from fitting.session import find_rejection
from fitting.trial.trial import RejectedTrial, Trial, TrialReading, build_bounce, build_trial
from tests.fitting.bouncing import Bounce
from tests.fitting.bouncing import recorded as bounce
from tests.fitting.experiment import Session, published
from tests.refusals import raises_refusal

TIME = np.arange(3000) / 100
FORCE = 25 + 12 * np.sin(2 * np.pi * TIME)
SOUND = MarkerQuality(0.0, {}, 2e-4, 0.0, 1e-3)


def _quality(residual: np.ndarray, body: np.ndarray) -> MarkerQuality:
    return marker_quality(np.zeros((len(TIME), 3)), residual, body, FORCE, {})


def test_skin_that_follows_the_pull_shows_in_the_anchor_s_residual() -> None:
    noise = np.abs(2e-4 * np.random.default_rng(1).standard_normal(len(TIME)))
    body = np.zeros((len(TIME), 3))
    still, follows = _quality(noise, body), _quality(noise + 2e-5 * FORCE, body)
    assert abs(still.anchor_follows_force) < 0.1
    assert marker_notes(still) == ()
    assert follows.anchor_follows_force > 0.3
    assert marker_notes(follows)[0].code is TrialNoteCode.SKIN


def test_a_body_that_leans_with_the_load_is_measured() -> None:
    sway = 2e-3 * np.sin(0.4 * TIME)
    body = np.column_stack((3e-4 * FORCE + sway, 4e-4 * FORCE, 0 * TIME))
    found = _quality(np.full(len(TIME), 1e-4) + 1e-6 * np.sin(9.1 * TIME), body)
    assert found.lean == pytest.approx(5e-4 * 24, rel=0.05)
    assert marker_notes(found)[0].figures["lean_m"] == found.lean


def test_ghosts_and_hidden_frames_are_reported() -> None:
    ghosts = marker_notes(replace(SOUND, ghosts={"anchor_3": 12}))
    assert ghosts == (Note(TrialNoteCode.GHOSTS, {"markers": "anchor_3 (frames: 12)"}),)
    assert marker_notes(replace(SOUND, hidden=0.3)) == (Note(TrialNoteCode.MARKERS_HIDDEN, {"hidden": 0.3}),)
    with raises_refusal(RejectionCode.MARKERS_HIDDEN, hidden=0.6):
        marker_notes(replace(SOUND, hidden=0.6))


def test_force_that_is_stuck_while_the_cuff_moves_is_refused() -> None:
    way = FORCE / 8000
    stuck = np.where((TIME > 10) & (TIME < 12), FORCE[1000], FORCE)
    with raises_refusal(RejectionCode.FORCE_STUCK_MOVING, start_s=pytest.approx(10.0, abs=0.05)):
        require_live_force(TIME, stuck, TIME, way)
    require_live_force(TIME, FORCE, TIME, way)


def test_a_force_of_noise_alone_while_the_cuff_moves_is_refused() -> None:
    noise = 0.1 * np.random.default_rng(1).standard_normal(len(TIME))
    travel = float(np.ptp(FORCE)) / 8000
    with raises_refusal(
        RejectionCode.FORCE_NOISE, force_n=pytest.approx(20, abs=0.01), travel_m=pytest.approx(travel, rel=0.01)
    ):
        require_live_force(TIME, 20 + noise, TIME, FORCE / 8000)
    require_live_force(TIME, 20 + noise, TIME, 1e-4 * noise)  # a cuff that rests, too
    require_live_force(TIME, (FORCE + noise) / 1000, TIME, FORCE / 8000)  # kilonewtons, which a later check names


def test_a_held_load_may_read_one_code_but_not_while_the_cuff_moves() -> None:
    held = np.where(TIME < 15, 2.0, 17.0)
    rests = held / 8000 + 1e-5 * np.sin(9 * TIME)
    require_live_force(TIME, held, TIME, rests)
    with raises_refusal(
        RejectionCode.FORCE_STUCK_MOVING, force_n=2.0, duration_s=pytest.approx(15.0, abs=0.05), start_s=0.0
    ):
        require_live_force(TIME, held, TIME, rests + 2e-3 * np.sin(TIME))


def _steps(
    seed: int, rate: float, noise: float, code: float, hold: float = 7.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Five weights on, one by one, as a converter reads them: time, load and what is read."""
    random = np.random.default_rng(seed)
    time = np.arange(0, 6 * hold, 1 / rate)
    load = 2.0 + random.uniform(0, code) + np.repeat(np.arange(6), len(time) // 6) * 15.0
    return time, load, code * np.round((load + noise * random.standard_normal(len(load))) / code)


@pytest.mark.parametrize("rate", [20.0, 1000.0])
@pytest.mark.parametrize(
    ("start", "length", "code"), [(20.0, 12.0, "MOVING"), (15.0, 3.0, "QUIET")], ids=["over steps", "within a hold"]
)
def test_a_converter_that_hangs_is_distinguished_from_a_held_load(
    rate: float, start: float, length: float, code: str
) -> None:
    for seed in range(4):
        time, load, read = _steps(seed, rate, 0.5, 0.48)
        way = np.interp(TIME * 1.4, time, load) / 8000 + 5e-5 * np.random.default_rng(seed).standard_normal(len(TIME))
        require_live_force(time, read, TIME * 1.4, way)
        hung = (time >= start) & (time < start + length)
        read[hung] = read[hung][0]
        stretch = {"duration_s": pytest.approx(length, abs=0.2), "start_s": pytest.approx(start, abs=0.2)}
        with raises_refusal(RejectionCode[f"FORCE_STUCK_{code}"], **stretch):
            require_live_force(time, read, TIME * 1.4, way)


@pytest.mark.parametrize("rate", [20.0, 1000.0])
@pytest.mark.parametrize(
    ("noise", "seeds"),
    [
        *((noise, range(4)) for noise in (0.0, 0.1, 0.2, 0.5, 4.0)),
        *(pytest.param(noise, range(4, 8), marks=pytest.mark.slow) for noise in (0.0, 0.1, 0.2, 0.5, 4.0)),
        *(pytest.param(noise, range(8), marks=pytest.mark.slow) for noise in (0.05, 0.15, 0.3, 1.0)),
    ],
)
def test_codes_that_repeat_because_the_force_is_quiet_are_no_hanging_converter(
    rate: float, noise: float, seeds: range
) -> None:
    """Noise in codes of a 14-bit converter; a swing has rests at both ends."""
    code = 0.12
    for seed in seeds:
        time, load, read = _steps(seed, rate, noise * code, code)
        require_live_force(time, read, TIME * 1.4, np.interp(TIME * 1.4, time, load) / 8000)
        swing = load[0] + 23.0 * (np.abs(time - 21) < 17) + 12.0 * np.sin(6.3 * time) * (np.abs(time - 21) < 15)
        noisy = swing + noise * code * np.random.default_rng(seed).standard_normal(len(time))
        way = np.interp(TIME * 1.4, time, swing) / 8000
        require_live_force(time, code * np.round(noisy / code), TIME * 1.4, way)


@pytest.mark.parametrize("scale", [1e3, 1e-6])
def test_a_displacement_in_the_wrong_unit_is_refused(scale: float) -> None:
    require_plausible_displacement(FORCE / 8000)
    with raises_refusal(RejectionCode.DISPLACEMENT_UNIT):
        require_plausible_displacement(scale * FORCE / 8000)


def _until(trial: Trial, end: float) -> Trial:
    forces, frames = trial.force_time < end, trial.marker_time < end
    return replace(
        trial,
        force_time=trial.force_time[forces],
        force=trial.force[forces],
        marker_time=trial.marker_time[frames],
        markers=trial.markers[frames],
    )


def _code(reading: TrialReading) -> object:
    reason = find_rejection(reading)
    return reason and reason.code


def test_trials_can_be_used_unless_they_end_under_load_or_early_or_their_force_does_not_swing() -> None:
    session = Session(published("hand", hold=4.0, duration=12.0), 3)
    static = build_trial(*session.static(), "static", "s")
    dynamic = build_trial(*session.dynamic(), "dynamic", "s")
    assert find_rejection(static) is None and find_rejection(dynamic) is None
    assert _code(_until(static, 0.6 * static.end)) is RejectionCode.NOT_UNLOADED, "migration is unknown"
    assert _code(_until(static, 9.0)) is RejectionCode.FEW_LOADS
    assert _code(replace(dynamic, force=np.full(len(dynamic.force), 20.0))) is RejectionCode.NO_MOTION


def test_a_bounce_can_be_used_where_it_calibrates_and_what_could_not_be_read_has_its_reason() -> None:
    whole = build_bounce(*bounce(Bounce(), 1), "bounce", "s")
    assert find_rejection(whole) is None
    hidden = replace(whole, position=np.full(whole.position.shape, np.nan))
    assert _code(hidden) is RejectionCode.BOUNCE_HIDDEN
    reason = Note(RejectionCode.UNREADABLE, {"problem": "empty"})
    assert find_rejection(RejectedTrial("a.mcap", reason)) == reason
