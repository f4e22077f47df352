"""Held loads in a trial's force."""

from __future__ import annotations

import numpy as np
import pytest

from fitting.pull.plateaus import find_plateaus, find_steps

LEVELS = (2.0, 12.0, 22.0, 32.0, 12.0, 2.0)


def _staircase(rate: float, seed: int, transfer: float = 0.3, hold: float = 6.0) -> tuple[np.ndarray, np.ndarray]:
    time = np.arange(0, hold * len(LEVELS), 1 / rate)
    force = np.full(len(time), LEVELS[0])
    for i in range(1, len(LEVELS)):
        force += (LEVELS[i] - LEVELS[i - 1]) * np.clip((time - hold * i) / transfer, 0, 1)
    force += 0.3 / 60 * time  # an amplifier that drifts
    return time, force + 0.5 * np.random.default_rng(seed).standard_normal(len(time))


@pytest.mark.parametrize("rate", [20.0, 1000.0])
@pytest.mark.parametrize("transfer", [0.1, 1.5])
def test_every_held_load_is_found_and_nothing_else(rate: float, transfer: float) -> None:
    frames = np.arange(0, 6.0 * len(LEVELS), 0.01)
    for seed in range(10):
        time, force = _staircase(rate, seed, transfer)
        plateaus = find_plateaus(time, force, 0.0, frames, np.zeros(len(frames)) + 1e-4 * np.sin(1e3 * frames))
        assert [p.force for p in plateaus] == pytest.approx(LEVELS, abs=0.6)
        assert all(p.end - p.start > 2.5 for p in plateaus)


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


def test_the_error_of_a_mean_grows_with_coloured_noise() -> None:
    time, force = _staircase(1000.0, 1)
    frames = np.arange(0, 36.0, 0.01)
    random = np.random.default_rng(4)
    white = 1e-4 * random.standard_normal(len(frames))
    coloured = np.convolve(white, np.ones(50) / np.sqrt(50), mode="same")
    first, second = (find_plateaus(time, force, 0.0, frames, x) for x in (white, coloured))
    assert np.mean([p.displacement_sd for p in second]) > 3 * np.mean([p.displacement_sd for p in first])


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
    told = find_plateaus(time, force, 0.0, frames, x, (6.0, 18.0))
    assert [(p.start, p.end) for p in told] == [(0.0, 5.5), (7.0, 17.5), (19.0, pytest.approx(36.0, abs=0.01))]


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
@pytest.mark.parametrize("hold", [1.5, 2.0, 2.5, 3.0, 3.5])
def test_every_step_between_short_holds_is_found(rate: float, hold: float) -> None:
    frames = np.arange(0, hold * len(LEVELS), 0.01)
    for seed in range(5):
        time, force = _staircase(rate, seed, hold=hold)
        steps = [step.time for step in find_steps(time, force)]
        assert steps == pytest.approx(hold * np.arange(1, len(LEVELS)) + 0.15, abs=0.3)
        plateaus = find_plateaus(time, force, 0.0, frames, np.zeros(len(frames)) + 1e-4 * np.sin(1e3 * frames))
        assert [plateau.force for plateau in plateaus] == pytest.approx(LEVELS, abs=0.6)
        assert [plateau.hold for plateau in plateaus] == pytest.approx([hold] * len(LEVELS), abs=0.5)


def test_a_stretch_with_a_step_that_was_not_found_is_no_plateau() -> None:
    time, force = _staircase(1000.0, 1, hold=0.6)
    frames = np.arange(0, time[-1], 0.01)
    assert all(
        np.ptp(force[(time > p.start) & (time < p.end)]) < 6 for p in find_plateaus(time, force, 0, frames, frames)
    )
