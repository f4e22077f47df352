"""Smoothing of whole trials beside the usual low-pass filter and differences.

    python -m benchmarks.smoothing [--seeds 3]

First, motions that are known, seen through 21 markers with 1 mm of white noise at 100 Hz: how often the 95 % intervals
of q, q̇ and q̈ hold the truth, and the RMS error of q̈ of the smoother, of the filter at 6 Hz, and of the filter at
whichever cut-off is best for this motion. Then the effect on muscles: errors of activations and joint force where the
motion is known, and the differences on public trials, where it is not.
"""

from __future__ import annotations

import argparse

import numpy as np
from numpy.typing import NDArray

from solver.bundled import bundled_model
from solver.inverse_kinematics.smoother import smooth_motion
from solver.inverse_kinematics.solve import solve_inverse_kinematics
from solver.inverse_kinematics.uncertainty import estimate_marker_noise
from solver.model import Model
from solver.motion import Kinematics, Motion, decimate, differentiate
from solver.redundancy.motion import solve_motion
from solver.redundancy.motion_solution import MotionSolution
from solver.redundancy.options import RedundancyOptions
from tests.solver.inverse_kinematics.known_motions import (
    INTERVAL,
    MODEL,
    TASKS,
    Draw,
    arm_raise,
    closed,
    minimum_jerk,
    sines,
    white_jerk,
)
from tests.solver.inverse_kinematics.marked import seen_from
from tests.solver.oracle.varied_trials import TRIALS, tracked

Array = NDArray[np.float64]

FRAMES = 400


def filtered_trial(cutoff: float) -> Draw:
    """Half of a public arm raise, low-pass filtered [Hz]."""

    def motion(chance: np.random.Generator) -> Array:
        trial = tracked(TRIALS["FLX01"])
        names = trial.model.coordinate_names
        filtered = differentiate(Motion(names, trial.time, trial.solve().coordinates), cutoff).positions
        first = int(chance.integers(len(filtered) - FRAMES))
        return closed(filtered[first : first + FRAMES])

    return motion


MOTIONS: dict[str, Draw] = {
    "white jerk": white_jerk,
    "sines up to 1 Hz": sines,
    "minimum jerk and rest": minimum_jerk,
    "the bundled arm raise": arm_raise,
    "FLX01, filtered at 2 Hz": filtered_trial(2.0),
    "FLX01, filtered at 3 Hz": filtered_trial(3.0),
}
NOISE = 1e-3
CUTOFFS = (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0)  # Hz
INNER = slice(10, -10)
"""Frames away from the ends, where the filter has its reflections."""
EVERY = 5
"""Frames between those whose muscles are solved."""
FREE = {"SHRUG01": ("plane_elv", "axial_rot")}
"""Coordinates whose accelerations are not tracked, as published."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=3)
    seeds = range(parser.parse_args().seeds)
    print("| motion | q held | q̇ | q̈ | RMS error of q̈ [rad or m/s²] | filter, best cut-off | at 6 Hz |")
    print("|---|---:|---:|---:|---:|---:|---:|")
    for name, motion in MOTIONS.items():
        print(_accuracy_row(name, motion, seeds), flush=True)
    print("\n| arm raise, muscles | mean error of activations | largest | error of the joint force, median | 95 % |")
    print("|---|---:|---:|---:|---:|")
    for row in _simulated_muscles():
        print(row, flush=True)
    print("\n| public trial, smoothed beside | mean difference of activations | largest | joint force, median | 95 % |")
    print("|---|---:|---:|---:|---:|")
    for trial in ("FLX01", "ABD02", "SHRUG01"):
        for row in _public_muscles(trial):
            print(row, flush=True)


def _accuracy_row(name: str, motion: Draw, seeds: range) -> str:
    held, errors = [], []
    for seed in seeds:
        chance = np.random.default_rng(seed)
        truth = motion(chance)
        rates = np.gradient(truth, INTERVAL, axis=0)
        wanted = np.stack([truth, rates, np.gradient(rates, INTERVAL, axis=0)])
        observed = _seen(truth, chance)
        found = smooth_motion(MODEL, observed, INTERVAL, TASKS, NOISE)
        away = np.stack([found.positions, found.speeds, found.accelerations]) - wanted
        held.append((np.abs(away) < 1.96 * found.standard_deviations).mean(axis=(1, 2)))
        errors.append([_rms(away[2]), *(_rms(k.accelerations - wanted[2]) for k in _filtered(observed, CUTOFFS))])
    mean = np.sqrt(np.mean(np.square(errors), axis=0))
    best = 1 + int(np.argmin(mean[1:]))
    parts = [f"{100 * part:.0f} %" for part in np.mean(held, axis=0)]
    rms = (f"{mean[0]:.3f}", f"{mean[best]:.3f} ({CUTOFFS[best - 1]:g} Hz)", f"{mean[-1]:.2f}")
    return f"| {' | '.join((name, *parts, *rms))} |"


def _simulated_muscles() -> list[str]:
    chance = np.random.default_rng(0)
    truth = arm_raise(chance)
    observed = _seen(truth, chance)
    time = INTERVAL * np.arange(len(truth))
    smoothed = smooth_motion(MODEL, observed, INTERVAL, TASKS, NOISE).kinematics(time)
    model = bundled_model()
    wanted = _muscles(model, differentiate(Motion(MODEL.coordinate_names, time, truth), None))
    ways = {"smoothed": smoothed} | dict(
        zip(("filter at 3 Hz", "at 6 Hz"), _filtered(observed, (3.0, 6.0)), strict=True)
    )
    return [_difference_row(name, _muscles(model, motion), wanted) for name, motion in ways.items()]


def _public_muscles(trial_name: str) -> list[str]:
    trial = tracked(TRIALS[trial_name])
    interval = float(np.median(np.diff(trial.time)))
    noise = np.maximum(estimate_marker_noise(trial.observed, interval), 1e-5)
    smoothed = smooth_motion(trial.model, trial.observed, interval, trial.tasks, noise)
    time = interval * np.arange(len(trial.time))
    found = _muscles(trial.model, smoothed.kinematics(time), FREE.get(trial_name, ()))
    motion = Motion(trial.model.coordinate_names, time, trial.solve().coordinates)
    rows = []
    name = f"{trial_name} ({smoothed.outcome.value})"
    for cutoff in (3.0, 6.0):
        filtered = _muscles(trial.model, differentiate(motion, cutoff), FREE.get(trial_name, ()))
        rows.append(_difference_row(f"{name}, filter at {cutoff:g} Hz", found, filtered))
    return rows


def _difference_row(name: str, found: MotionSolution, other: MotionSolution) -> str:
    activations = np.abs(found.activations - other.activations)
    forces = np.abs(np.linalg.norm(found.reaction[:, 3:], axis=1) - np.linalg.norm(other.reaction[:, 3:], axis=1))
    median, most = np.percentile(forces, [50, 95])
    return f"| {name} | {activations.mean():.4f} | {activations.max():.3f} | {median:.1f} N | {most:.0f} N |"


def _muscles(model: Model, motion: Kinematics, free: tuple[str, ...] = ()) -> MotionSolution:
    return solve_motion(model, decimate(motion, EVERY), RedundancyOptions(free_coordinates=free))


def _filtered(observed: Array, cutoffs: tuple[float, ...]) -> list[Kinematics]:
    frames = solve_inverse_kinematics(MODEL, observed, TASKS).coordinates
    motion = Motion(MODEL.coordinate_names, INTERVAL * np.arange(len(frames)), frames)
    return [differentiate(motion, cutoff) for cutoff in cutoffs]


def _seen(truth: Array, chance: np.random.Generator) -> Array:
    return seen_from(MODEL, truth) + NOISE * chance.standard_normal((len(truth), len(MODEL.markers), 3))


def _rms(errors: Array) -> float:
    return float(np.sqrt(np.mean(errors[INNER] ** 2)))


if __name__ == "__main__":
    main()
