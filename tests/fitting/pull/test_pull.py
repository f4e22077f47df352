"""Force and displacement that do not belong together: not on one clock, or a force that drifts under held loads."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy import stats

from fitting.errors import UnusableTrial
from fitting.pull.consistency import require_common_steps, require_steady_cell
from fitting.pull.plateaus import Plateau, check_steps, find_plateaus, find_steps, load_scale
from fitting.pull.pull import make_pulls
from fitting.results.trial_codes import RejectionCode, TrialNoteCode
from fitting.trial.calibration import GainMistake
from fitting.trial.trial import Trial, build_trial
from tests.fitting.defects import Law, OddSession, Rig
from tests.fitting.experiment import PUBLISHED, Session, Truth, published
from tests.refusals import figures_by_code, raises_refusal

LEVELS = (2.0, 12.0, 22.0, 32.0, 12.0, 2.0)
MASSES = (1.5, 1.5, 1.0)
WEIGHT = 9.80665
MISTAKES = {
    1 / 4.448: (GainMistake.POUNDS_FOR_NEWTONS,),
    0.5: (GainMistake.CAPACITY_HALVED,),
    0.1: (GainMistake.CAPACITY_TENTH, GainMistake.KILOGRAMS_FOR_NEWTONS),
}
SETS = [(1.5,) * 5, (0.5,) * 8, (0.3,) * 4, (2.0, 1.0, 0.5), (2.0,) * 3]


@pytest.mark.parametrize("test", ["static", "dynamic"])
def test_a_load_cell_that_drifts_is_named(test: str) -> None:
    """Loads that drift are not held: no weight would be counted."""
    session = Session(published("hand"), 1)
    manifest, tracks = getattr(session, test)()
    for drift in (-2.0, 0.0, 2.0, 5.0):
        force = tracks["/force"]
        seconds = force.sample_numbers / session.truth.force_rate
        volts = force.values + (drift / session.truth.newtons_per_volt * seconds)[:, None]
        _, reasons = make_pulls([build_trial(manifest, {**tracks, "/force": replace(force, values=volts)}, "s", "s")])
        assert [reason.code for reason in reasons.values()] == [RejectionCode.FORCE_DRIFTS] * (drift != 0.0)
        for reason in reasons.values():
            assert reason.figures["drift_n_per_s"] == pytest.approx(drift, rel=0.1)


def test_a_force_that_the_cuff_follows_or_that_returns_does_not_drift() -> None:
    time = np.arange(0.0, 40.0, 0.01)
    pulled, still = 2.0 * time, 1e-5 * np.sin(9 * time)
    require_steady_cell(time, pulled, time, pulled / 8000, 5.0)
    require_steady_cell(time, np.where(time < 39.0, 0.5 * time, 0.0), time, still, 5.0)
    require_steady_cell(time, 0.1 * time, time, still, 5.0)
    slow, noise = 0.5 * 3 * time, 1e-4 * np.random.default_rng(1).standard_normal(len(time))
    require_steady_cell(3 * time, slow, 3 * time, slow / 5000 + noise, 5.0)
    with raises_refusal(RejectionCode.FORCE_DRIFTS, drift_n_per_s=pytest.approx(0.5, rel=0.01)):
        require_steady_cell(3 * time, slow, 3 * time, noise, 5.0)
    with raises_refusal(RejectionCode.FORCE_DRIFTS, drift_n_per_s=pytest.approx(0.2), duration_s=pytest.approx(40.0)):
        require_steady_cell(time, 0.2 * time, time, still, 5.0)


@cache
def _static(cuff: str, hold: float, force_rate: float) -> Trial:
    return build_trial(*Session(published(cuff, hold=hold, force_rate=force_rate), 1).static(1), "s", "s")


@pytest.mark.parametrize(
    ("cuff", "hold", "force_rate"),
    [
        ("hand", 4.0, 1000.0),
        ("waist", 8.0, 20.0),
        *(pytest.param(cuff, *r, marks=pytest.mark.slow) for cuff in PUBLISHED for r in ((8.0, 1000.0), (4.0, 20.0))),
    ],
)
def test_loads_that_step_apart_are_rejected_with_their_distance(cuff: str, hold: float, force_rate: float) -> None:
    trial = _static(cuff, hold, force_rate)
    ((pull,), _) = make_pulls([trial])
    require_common_steps(trial.force_time - 0.3, trial.force, trial.marker_time, pull.displacement)
    for late in (1.0, 2.0, -3.0):
        with pytest.raises(UnusableTrial) as refused:
            require_common_steps(trial.force_time - late, trial.force, trial.marker_time, pull.displacement)
        assert refused.value.reason.code is RejectionCode.STEPS_APART
        assert refused.value.reason.figures["offset_s"] == pytest.approx(late, abs=0.15)
    _, reasons = make_pulls([replace(trial, force_time=trial.force_time - late)])
    assert reasons["s"] == refused.value.reason


@pytest.mark.parametrize(
    ("law", "unloads_at_once"),
    [
        (Law(friction=4.0), True),
        (Law(slip_from=20.0), False),
        (Law(slow=(0.5, 15.0)), True),
        (Law(slow=(2.0, 30.0)), False),
        (Law(fast=(0.4, 0.3)), True),
    ],
)
def test_a_cuff_that_creeps_slips_or_has_friction_is_on_the_clock_of_its_force(law: Law, unloads_at_once: bool) -> None:
    truth = Truth(friction=1e9, migration=0.0, hold=6.0, unloads_at_once=unloads_at_once)
    pulls, _ = make_pulls([build_trial(*OddSession(law, Rig(), 1, truth).static(1), "s", "s")])
    assert len(pulls) == 1


@pytest.mark.parametrize(("gap_s", "is_used"), [(0.049, True), (0.051, False)])
def test_frames_in_a_long_gap_of_the_force_are_left_out(gap_s: float, is_used: bool) -> None:
    """The force was interpolated over any gap, and read as measured."""
    trial = _static("hand", 4.0, 1000.0)
    whole = make_pulls([trial])[0][0]
    (pull,) = make_pulls([replace(trial, force_gaps=((10.0, 10.0 + gap_s),))])[0]
    inside = (trial.marker_time > 10.0) & (trial.marker_time < 10.0 + gap_s)
    np.testing.assert_array_equal(np.isfinite(pull.displacement[inside]), is_used)
    np.testing.assert_allclose(pull.displacement[~inside], whole.displacement[~inside], atol=1e-5)


@pytest.mark.parametrize(
    ("share", "is_noted", "is_refused"), [(0.1, False, False), (0.3, True, False), (0.6, True, True)]
)
def test_the_share_of_frames_without_force_is_stated_apart_from_hidden_markers(
    share: float, is_noted: bool, is_refused: bool
) -> None:
    trial = _static("hand", 4.0, 1000.0)
    begin, end = trial.marker_time[[0, -1]]
    gap = (end - share * (end - begin), end + 1.0)
    pulls, reasons = make_pulls([replace(trial, force_gaps=(gap,))])
    if is_refused:
        assert reasons["s"].code is RejectionCode.FORCE_MISSING
        assert reasons["s"].figures["share"] == pytest.approx(share, abs=0.01)
        return
    shares = [note.figures["share"] for note in pulls[0].notes if note.code is TrialNoteCode.FORCE_MISSING]
    assert shares == [pytest.approx(share, abs=0.01)] * is_noted
    assert TrialNoteCode.MARKERS_HIDDEN not in {note.code for note in pulls[0].notes}


@pytest.mark.parametrize(("hidden_from", "is_refused"), [(0.0, True), (0.6, False)])
def test_force_and_cuff_must_be_known_together_in_half_of_the_frames(hidden_from: float, *, is_refused: bool) -> None:
    """The last 40 % are without force; 40 % of the markers are hidden at another time, or at the same."""
    trial = _static("hand", 4.0, 1000.0)
    begin, end = trial.marker_time[[0, -1]]
    frames = len(trial.marker_time)
    markers = trial.markers.copy()
    markers[round(hidden_from * frames) : round((hidden_from + 0.4) * frames)] = np.nan
    gap = (end - 0.4 * (end - begin), end + 1.0)
    pulls, reasons = make_pulls([replace(trial, markers=markers, force_gaps=(gap,))])
    assert len(pulls) != is_refused
    if is_refused:
        assert reasons["s"].code is RejectionCode.LITTLE_IN_COMMON
        assert reasons["s"].figures["share"] == pytest.approx(0.2, abs=0.01)


@pytest.mark.parametrize(("cuff", "own"), [("hand", "anchor_1"), ("waist", "anchor_3")])
def test_labels_of_anchor_and_cuff_that_are_exchanged_from_the_first_trial_on_are_named(cuff: str, own: str) -> None:
    trial = _static(cuff, 4.0, 1000.0)
    other = trial.cuff.cuff_markers[0]
    places = [trial.labels.index(own), trial.labels.index(other)]
    markers = trial.markers.copy()
    markers[:, places] = markers[:, places[::-1]]
    pulls, reasons = make_pulls([replace(trial, markers=markers)])
    assert pulls == [] and reasons["s"].code is RejectionCode.LABELS_EXCHANGED
    assert (reasons["s"].figures["anchor"], reasons["s"].figures["cuff"]) == (own, other)
    assert reasons["s"].figures["exchanged_m"] < 0.5e-3


def test_an_anchor_that_defines_no_frame_is_not_taken_for_exchanged_labels() -> None:
    trial = _static("hand", 4.0, 1000.0)
    places = [trial.labels.index(label) for label in trial.cuff.anchor_markers]
    markers = trial.markers.copy()
    for place, share in zip(places[2:], (0.5, 0.25), strict=True):
        markers[:, place] = (1 - share) * markers[:, places[0]] + share * markers[:, places[1]]
    assert make_pulls([replace(trial, markers=markers)])[1]["s"].code is RejectionCode.ANCHOR_COLLINEAR


def _staircase(rate: float, seed: int, transfer: float = 0.3, hold: float = 6.0) -> tuple[np.ndarray, np.ndarray]:
    time = np.arange(0, hold * len(LEVELS), 1 / rate)
    force = np.full(len(time), LEVELS[0])
    for i in range(1, len(LEVELS)):
        force += (LEVELS[i] - LEVELS[i - 1]) * np.clip((time - hold * i) / transfer, 0, 1)
    force += 0.3 / 60 * time  # an amplifier that drifts
    return time, force + 0.5 * np.random.default_rng(seed).standard_normal(len(time))


def test_a_hold_that_still_slips_is_read_at_its_end() -> None:
    time, force = _staircase(1000.0, 1)
    frames = np.arange(0, 36.0, 0.01)
    slip = np.where((frames > 18) & (frames < 24), 1e-3 * (1 - np.exp(-(frames - 18) / 2)), 0.0)
    noise = 1e-5 * np.random.default_rng(3).standard_normal(len(frames))
    held = find_plateaus(time, force, 0.0, frames, slip + noise)[3]
    reached = 1e-3 * (1 - np.exp(-(held.end - 18) / 2))
    value, error = held.late
    assert abs(value - reached) < 2 * error
    assert abs(held.displacement - reached) > abs(value - reached)


def test_hidden_markers_do_not_move_a_plateau() -> None:
    time, force = _staircase(1000.0, 1)
    frames = np.arange(0, 36.0, 0.01)
    x = np.full(len(frames), 3e-3)
    x[::3] = np.nan
    for plateau in find_plateaus(time, force, 0.0, frames, x):
        assert plateau.displacement == pytest.approx(3e-3)


@pytest.mark.parametrize("rate", [20.0, 1000.0])
def test_of_hundreds_of_steps_none_is_missed_and_none_is_false(rate: float) -> None:
    """T13: six steps in each of a hundred records, an amplifier that drifts by 20 mV a minute."""
    for seed in range(100):
        random = np.random.default_rng(seed)
        times = np.cumsum(random.uniform(6.0, 10.0, 6))
        time = np.arange(0, times[-1] + 8, 1 / rate)
        load = 2 + sum(10 * (1 if i < 3 else -1) * np.clip((time - at) / 0.4, 0, 1) for i, at in enumerate(times))
        force = load + 98 * 0.02 / 60 * time + 0.51 * random.standard_normal(len(time))
        found = [step.time for step in find_steps(time, force)]
        assert len(found) == 6
        assert np.all(np.abs(np.array(found) - times) < 0.5)


def test_known_steps_replace_those_that_are_found() -> None:
    time, force = _staircase(1000.0, 1)
    frames = np.arange(0, 36.0, 0.01)
    x = 1e-3 + 1e-6 * np.sin(frames)
    reported = find_plateaus(time, force, 0.0, frames, x, (6.0, 18.0))
    assert [(p.start, p.end) for p in reported] == [(0.0, 5.5), (7.0, 17.5), (19.0, pytest.approx(36.0, abs=0.01))]


@pytest.mark.parametrize("rate", [20.0, 1000.0])
@pytest.mark.parametrize("scale", [0.05, 0.1, 0.225])
def test_steps_read_on_a_wrong_scale_are_found_all_the_same(rate: float, scale: float) -> None:
    for seed in range(5):
        time, force = _staircase(rate, seed)
        assert len(find_steps(time, scale * force)) == len(LEVELS) - 1


def test_noise_alone_is_no_step() -> None:
    for seed in range(20):
        noise = np.random.default_rng(seed).standard_normal(1200)
        assert find_steps(np.arange(1200) / 20, 0.5 * noise) == []


@pytest.mark.parametrize("rate", [20.0, 1000.0])
@pytest.mark.parametrize(
    ("hold", "transfer"), [*((hold, 0.3) for hold in (1.5, 2.0, 2.5, 3.0, 3.5)), (6.0, 0.1), (6.0, 1.5)]
)
def test_every_step_and_every_held_load_is_found_and_nothing_else(rate: float, hold: float, transfer: float) -> None:
    frames = np.arange(0, hold * len(LEVELS), 0.01)
    for seed in range(5 if hold < 6 else 10):
        time, force = _staircase(rate, seed, transfer, hold)
        steps = [step.time for step in find_steps(time, force)]
        assert steps == pytest.approx(hold * np.arange(1, len(LEVELS)) + transfer / 2, abs=max(0.3, transfer / 2))
        plateaus = find_plateaus(time, force, 0.0, frames, np.zeros(len(frames)) + 1e-4 * np.sin(1e3 * frames))
        assert [plateau.force for plateau in plateaus] == pytest.approx(LEVELS, abs=0.6)
        if hold < 6:
            assert [plateau.hold for plateau in plateaus] == pytest.approx([hold] * len(LEVELS), abs=0.5)
        else:
            assert all(plateau.end - plateau.start > 2.5 for plateau in plateaus)


def test_a_stretch_with_a_step_that_was_not_found_is_no_plateau() -> None:
    time, force = _staircase(1000.0, 1, hold=0.6)
    frames = np.arange(0, time[-1], 0.01)
    assert all(
        np.ptp(force[(time > p.start) & (time < p.end)]) < 6 for p in find_plateaus(time, force, 0, frames, frames)
    )


# Weights that were not what the protocol says, and load cells that were not what the configuration says.


def _held(
    weights: tuple[int, ...] = (0, 1, 2, 3, 2, 1, 0), *, scale: float = 1.0, friction: float = 0.0, off: float = 0.0
) -> list[Plateau]:
    """So many weights on, one level after the other, under a hook of 2 N; a pulley holds back a part of the load."""
    random = np.random.default_rng(1)
    on = np.concatenate(([0.0], np.cumsum(MASSES)))
    held, before = [], 0
    for i, count in enumerate(weights):
        load = 2.0 + WEIGHT * on[count] * (1 - friction * np.sign(count - before)) + off * (i == 2)
        force = scale * load + 0.02 * random.standard_normal() + 7.0
        held.append(Plateau(10.0 * i, 10.0 * i + 8, force, 0.02, 0.0, 1e-5, (0.0, 1e-5)))
        before = count
    return held


def test_weights_as_planned_are_no_news_and_nothing_is_checked_without_known_weights() -> None:
    assert check_steps(_held(), MASSES) == ()
    assert check_steps(_held((0, 1, 2, 3, 0)), MASSES) == ()
    assert check_steps(_held((0, 1, 2, 3)), MASSES) == ()
    assert check_steps(_held(scale=1.02), MASSES) == ()
    assert check_steps(_held(), ()) == ()
    assert check_steps(_held((0,)), MASSES) == ()
    (note,) = check_steps(_held((0, 0)), MASSES)
    assert note.code is TrialNoteCode.NO_WEIGHT
    assert note.figures["weight_n"] == pytest.approx(14.71, abs=0.01)


@pytest.mark.parametrize(
    ("scale", "mistake"),
    [
        (2.0, GainMistake.CAPACITY_DOUBLED),
        (1.08, GainMistake.UNKNOWN),
        (1.05, GainMistake.UNKNOWN),
        (0.95, GainMistake.UNKNOWN),
    ],
)
def test_a_scale_that_is_wrong_is_named(scale: float, mistake: GainMistake) -> None:
    figures = figures_by_code(check_steps(_held(scale=scale), MASSES))[TrialNoteCode.WEIGHT_GAIN]
    assert figures["mistake"] is mistake
    assert figures["mass_kg"] == 1.5
    assert figures["rise_n"] == pytest.approx(scale * 14.71, rel=5e-3)
    assert abs(figures["gain"] - scale) < 4 * figures["standard_error"] < 0.02 * scale


def test_a_wrong_scale_is_named_where_all_weights_come_off_at_once() -> None:
    five = (1.5,) * 5
    forces = 2.0 + 2.2046 * WEIGHT * np.array([0.0, 1.5, 3.0, 4.5, 6.0, 7.5, 0.0])
    (note,) = check_steps([Plateau(0, 8, force, 0.02, 0.0, 1e-5, (0.0, 1e-5)) for force in forces], five)
    assert note.figures["mistake"] is GainMistake.KILOGRAMS_FOR_POUNDS


def test_friction_of_a_pulley_is_named_and_is_no_wrong_scale() -> None:
    (note,) = check_steps(_held(friction=0.06), MASSES)
    assert note.code is TrialNoteCode.PULLEY
    assert note.figures["friction"] == pytest.approx(0.06, abs=2e-3)


def _loads(masses: tuple[float, ...], seed: int, scale: float, friction: float, noise: float = 0.05) -> list[Plateau]:
    """Every weight on and off again over a pulley, one by one; the zero drifts by a newton."""
    random = np.random.default_rng(seed)
    up = np.concatenate(([0.0], np.cumsum(masses)))
    on, way = np.append(up, up[-2::-1]), np.append(np.ones(len(up)), -np.ones(len(masses)))
    held = []
    for i, (mass, goes) in enumerate(zip(on, way, strict=True)):
        force = scale * (2.0 + WEIGHT * mass * (1 - friction * goes) + noise * random.standard_normal()) + i / len(on)
        held.append(Plateau(10.0 * i, 10.0 * i + 8, force, abs(scale) * noise, 0.0, 1e-5, (0.0, 1e-5)))
    return held


@pytest.mark.parametrize("masses", SETS)
def test_each_mistake_is_named_whatever_the_weights(masses: tuple[float, ...]) -> None:
    for seed in range(5):
        assert check_steps(_loads(masses, seed, 1.0, 0.0), masses) == ()
        assert check_steps(_loads(masses, seed, 1.02, 0.0), masses) == ()
        for scale, mistakes in MISTAKES.items():
            notes = check_steps(_loads(masses, seed, scale, 0.0), masses)
            assert figures_by_code(notes)[TrialNoteCode.WEIGHT_GAIN]["mistake"] in mistakes
        assert check_steps(_loads(masses, seed, -1.0, 0.0), masses)[0].code is TrialNoteCode.LOAD_FALLS


@pytest.mark.parametrize("friction", [0.05, 0.08, 0.15])
@pytest.mark.parametrize("masses", SETS)
def test_a_pulley_s_friction_is_measured_and_leaves_the_scale_alone(masses: tuple[float, ...], friction: float) -> None:
    for seed in range(5):
        scale = load_scale(_loads(masses, seed, 1.05, friction), masses)
        assert scale.friction is not None
        for found, true in ((scale.gain, 1.05), (scale.friction, friction)):
            assert abs(found.value - true) < 5 * found.standard_error < 0.1
        assert scale.is_off
        assert scale.has_friction


def test_the_gain_s_interval_is_honest() -> None:
    found = [load_scale(_loads((1.5,) * 5, seed, 1.05, 0.02), (1.5,) * 5) for seed in range(100)]
    scores = [(each.gain.value - 1.05) / each.gain.standard_error for each in found if each is not None]
    assert len(scores) == 100
    assert stats.chi2.ppf(0.0005, 100) < np.sum(np.square(scores)) < 1.3 * stats.chi2.ppf(0.9995, 100)


def test_a_load_that_is_off_is_named_by_its_time_and_weights_left_off_are_counted() -> None:
    (note,) = check_steps(_held(off=-5.0), MASSES)
    assert note.code is TrialNoteCode.WRONG_LOAD
    assert (note.figures["start_s"], note.figures["count"]) == (20.0, 2)
    (note,) = check_steps(_held((0, 1, 2, 1, 0)), MASSES)
    assert (note.code, note.figures) == (TrialNoteCode.FEW_WEIGHTS, {"count": 2, "total": 3})
