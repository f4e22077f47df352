"""Weights that were not what the protocol says, and load cells that were not what the configuration says."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from fitting.pull.hung_weights import check_steps, load_scale
from fitting.pull.plateaus import Plateau
from fitting.results.codes import GainMistake, TrialNoteCode
from tests.fitting.refusals import figures_by_code

MASSES = (1.5, 1.5, 1.0)
WEIGHT = 9.80665


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


def test_weights_as_planned_are_no_news() -> None:
    assert check_steps(_held(), MASSES) == ()
    assert check_steps(_held((0, 1, 2, 3, 0)), MASSES) == ()
    assert check_steps(_held((0, 1, 2, 3)), MASSES) == ()
    assert check_steps(_held(scale=1.02), MASSES) == ()


@pytest.mark.parametrize(
    ("scale", "mistake"),
    [
        (2.0, GainMistake.CAPACITY_DOUBLED),
        (0.5, GainMistake.CAPACITY_HALVED),
        (1 / 4.448, GainMistake.POUNDS_FOR_NEWTONS),
        (4.448, GainMistake.NEWTONS_FOR_POUNDS),
        (0.4536, GainMistake.POUNDS_FOR_KILOGRAMS),
        (1.134, GainMistake.CAPACITY_25_LB),
        (1.3, GainMistake.UNKNOWN),
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


MISTAKES = {
    1 / 4.448: (GainMistake.POUNDS_FOR_NEWTONS,),
    0.5: (GainMistake.CAPACITY_HALVED,),
    0.1: (GainMistake.CAPACITY_TENTH, GainMistake.KILOGRAMS_FOR_NEWTONS),
}
SETS = [(1.5,) * 5, (0.5,) * 8, (0.3,) * 4, (2.0, 1.0, 0.5), (2.0,) * 3]


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
        assert scale is not None
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


def test_a_load_that_is_off_is_named_by_its_time() -> None:
    (note,) = check_steps(_held(off=-5.0), MASSES)
    assert note.code is TrialNoteCode.WRONG_LOAD
    assert (note.figures["start_s"], note.figures["count"]) == (20.0, 2)


def test_weights_that_were_left_off_are_counted() -> None:
    (note,) = check_steps(_held((0, 1, 2, 1, 0)), MASSES)
    assert (note.code, note.figures) == (TrialNoteCode.FEW_WEIGHTS, {"count": 2, "total": 3})


def test_nothing_is_checked_without_known_weights() -> None:
    assert check_steps(_held(), ()) == ()
    assert check_steps(_held((0,)), MASSES) == ()
    (note,) = check_steps(_held((0, 0)), MASSES)
    assert note.code is TrialNoteCode.NO_WEIGHT
    assert note.figures["weight_n"] == pytest.approx(14.71, abs=0.01)
