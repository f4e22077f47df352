"""A motion with drawn errors of posture and another cycle of the same movement."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from solver.model import Array, Model
from solver.motion import Kinematics
from solver.multibody.constraints import constraint_rows
from solver.multibody.postures import postures, rates_of_coordinates
from solver.scaling import Scaling, scale_skeleton
from solver.uncertainty.factors import Scores
from solver.uncertainty.sources import MotionSpread

MOTION_FACTORS = ("drawn_motion", "posture", "noise", "amplitude", "duration")
LEAST_SPREAD = 1e-4  # rad or m
NOISE_CUTOFF = 1.0  # Hz; faster errors are filtered from a motion


@dataclass(frozen=True, eq=False)
class DrawnMotion:
    """A motion of the posterior of a wearer, on the body that was drawn with it: scaling from the assessed body."""

    scaling: Scaling
    kinematics: Kinematics


@dataclass(frozen=True, eq=False)
class MotionDraws:
    """Common inputs of the drawn motions of a model.

    assessed   the assessed motion;  drawn: those of the posterior of a wearer, if any
    """

    model: Model
    assessed: Kinematics
    drawn: tuple[DrawnMotion, ...] = ()

    @cached_property
    def is_angle(self) -> NDArray[np.bool_]:
        """(coordinates,)"""
        return np.array([coordinate.motion == "rotation" for coordinate in self.model.coordinates])

    @cached_property
    def is_measured(self) -> NDArray[np.bool_]:
        """(coordinates,) that the draws vary: those of which a wearer's markers know something."""
        positions = [self.assessed.positions, *(draw.kinematics.positions for draw in self.drawn)]
        return np.asarray(np.std(positions, axis=0).max(axis=0) > LEAST_SPREAD)

    @cached_property
    def _of_assessed(self) -> ConstrainedMotion:
        return constrained_motion(self.model, self.assessed)

    def chosen(self, scores: Scores) -> DrawnMotion | None:
        """The draw that the score of drawn_motion chooses; None stands for the assessed motion, as the score 0 does."""
        if not _is_drawn(scores, "drawn_motion"):
            return None
        count = len(self.drawn)
        return self.drawn[min(int(count * scipy.special.ndtr(scores["drawn_motion"][0])), count - 1)]

    def compatible(self, chosen: DrawnMotion | None, displaced: Array) -> Array:
        """Displacements (frames, coordinates) of a motion, nearest to these, that keep the model's constraints to first
        order. Those of the assessed motion are kept, which people share without drawn ones.
        """
        if chosen is None:
            return self._of_assessed.compatible(displaced)
        return constrained_motion(scale_skeleton(self.model, chosen.scaling), chosen.kinematics).compatible(displaced)


def varied_motion(draws: MotionDraws, spread: MotionSpread, scores: Scores) -> Kinematics:
    """The motion of one cycle of one person; the sources are described at MotionSpread.

    The scores of drawn_motion and noise choose one of many; 0, which is never drawn, stands for the assessed motion
    without noise.
    """
    chosen = draws.chosen(scores)
    motion = chosen.kinematics if chosen else draws.assessed
    displaced = np.zeros_like(motion.positions)
    if "posture" in scores:
        displaced += spread.posture * np.where(draws.is_angle & ~draws.is_measured, scores["posture"], 0.0)
    if _is_drawn(scores, "noise"):
        displaced += (
            spread.noise * draws.is_angle * _smooth_noise(motion, float(scipy.special.ndtr(scores["noise"][0])))
        )
    if "amplitude" in scores:
        displaced += spread.amplitude * scores["amplitude"] * (motion.positions - motion.positions[0])
    if displaced.any():
        positions = motion.positions + draws.compatible(chosen, displaced)
        speeds = np.gradient(positions, motion.interval, axis=0)
        accelerations = np.gradient(speeds, motion.interval, axis=0)
        motion = replace(motion, positions=positions, speeds=speeds, accelerations=accelerations)
    return (
        _stretched(motion, float(np.exp(spread.duration * scores["duration"][0]))) if "duration" in scores else motion
    )


def _is_drawn(scores: Scores, name: str) -> bool:
    return name in scores and scores[name][0] != 0.0


def _stretched(motion: Kinematics, ratio: float) -> Kinematics:
    """The same postures in `ratio` times the time."""
    return replace(
        motion,
        time=motion.time * ratio,
        interval=motion.interval * ratio,
        speeds=motion.speeds / ratio,
        accelerations=motion.accelerations / ratio**2,
    )


def _smooth_noise(motion: Kinematics, chance: float) -> Array:
    """(frames, coordinates) of variance 1: sines and cosines below NOISE_CUTOFF with random amplitudes."""
    generator = np.random.default_rng(int(chance * 2**53))
    seconds = motion.interval * len(motion.time)
    count = max(1, int(NOISE_CUTOFF * seconds))
    phases = 2 * np.pi * np.arange(1, count + 1) * (motion.time - motion.time[0])[:, None] / seconds
    waves = np.concatenate([np.sin(phases), np.cos(phases)], axis=1)
    noise: Array = waves @ generator.standard_normal((2 * count, motion.positions.shape[1])) / np.sqrt(count)
    return noise


@dataclass(frozen=True, eq=False)
class ConstrainedMotion:
    """Constraints of a motion: q̇ = N u and G u = 0.

    rows       G (frames, rows, coordinates);  gram  (G Gᵀ)⁺ (frames, rows, rows)
    to_rates   N (frames, mixed, mixed) of the coordinates whose rates are not their speeds;  mixed  their indices
    """

    rows: Array
    gram: Array
    to_rates: Array
    mixed: NDArray[np.int64]

    def compatible(self, displaced: Array) -> Array:
        """N (1 − G⁺ G) N⁻¹ times displaced (frames, coordinates), with G⁺ = Gᵀ (G Gᵀ)⁺."""
        moved = displaced.copy()
        moved[:, self.mixed] = np.linalg.solve(self.to_rates, displaced[:, self.mixed, None])[..., 0]
        violation = self.gram @ (self.rows @ moved[..., None])
        moved -= (np.swapaxes(self.rows, 1, 2) @ violation)[..., 0]
        moved[:, self.mixed] = (self.to_rates @ moved[:, self.mixed, None])[..., 0]
        return moved


def constrained_motion(model: Model, motion: Kinematics) -> ConstrainedMotion:
    state = postures(model, motion.positions, np.zeros_like(motion.positions))
    rows, _ = constraint_rows(model, state)
    to_rates, _ = rates_of_coordinates(model, state)
    is_other = (to_rates != np.eye(to_rates.shape[-1])).any(axis=0)
    mixed = np.flatnonzero(is_other.any(axis=0) | is_other.any(axis=1))
    gram = np.linalg.pinv(rows @ np.swapaxes(rows, 1, 2), hermitian=True).astype(np.float64, copy=False)
    return ConstrainedMotion(rows, gram, to_rates[:, mixed[:, None], mixed], mixed)
