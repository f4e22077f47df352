"""Weights that were not what the protocol says, and load cells that were not what the configuration says."""

from __future__ import annotations

import numpy as np
import pytest

from fitting.plateaus import Plateau
from fitting.steps import check_steps

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
    ("scale", "words"),
    [
        (2.0, "capacity_kg were twice"),
        (0.5, "capacity_kg were half"),
        (1 / 4.448, "pounds were taken for newtons"),
        (4.448, "newtons were taken for pounds"),
        (0.4536, "pounds were taken for kilograms"),
        (1.134, "25 lb"),
        (1.3, "no common mistake explains"),
    ],
)
def test_a_scale_that_is_wrong_is_named(scale: float, words: str) -> None:
    (note,) = check_steps(_held(scale=scale), MASSES)
    assert words in note
    assert f"{scale * 14.71:.1f} N where 1.5 kg" in note


def test_a_wrong_scale_is_named_where_all_weights_come_off_at_once() -> None:
    five = (1.5,) * 5
    forces = 2.0 + 2.2046 * WEIGHT * np.array([0.0, 1.5, 3.0, 4.5, 6.0, 7.5, 0.0])
    (note,) = check_steps([Plateau(0, 8, force, 0.02, 0.0, 1e-5, (0.0, 1e-5)) for force in forces], five)
    assert "kilograms were taken for pounds" in note


def test_a_pulley_that_rubs_is_named_and_is_no_wrong_scale() -> None:
    (note,) = check_steps(_held(friction=0.06), MASSES)
    assert "the pulley holds 6 % of the load" in note


def test_a_load_that_is_off_is_named_by_its_time() -> None:
    (note,) = check_steps(_held(off=-5.0), MASSES)
    assert "held from 20.0 s on" in note
    assert "(2 weights)" in note


def test_weights_that_were_left_off_are_counted() -> None:
    (note,) = check_steps(_held((0, 1, 2, 1, 0)), MASSES)
    assert "2 of 3 weights" in note


def test_nothing_is_checked_where_nobody_says_what_was_hung_on() -> None:
    assert check_steps(_held(), ()) == ()
    assert check_steps(_held((0,)), MASSES) == ()
    assert "the first being 14.7 N" in check_steps(_held((0, 0)), MASSES)[0]
