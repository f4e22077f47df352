"""A person with markers on the skin, who holds a pose or raises an arm, wears a cord, and has muscles with electrodes.

Frames: "ground" is that of shoulder.py, y up, in which the person stands; the laboratory has z up. Does not imitate:
skin that follows the bone less the higher the arm is raised, the other arm, fatigue, the cord's pull on the posture.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from drivers.simulators.arm_raise import RaisedPosture, Raises, no_raises, realised_raises
from drivers.simulators.emg_noise import EmgNoise
from drivers.simulators.settings import PersonSettings
from drivers.simulators.shoulder import published_shoulder
from drivers.simulators.wander import random_wander

Floats = NDArray[np.float64]
Worn = Literal["unsuited", "slack", "tight", "mvc"]
BODY_TESTS = ("pose", "motion")

Y_UP_TO_Z_UP = Rotation.from_euler("x", 90, degrees=True)
BASELINE = 0.03
"""Activation at rest."""
SWAY_HZ = 0.05, 0.8
SKIN_TERMS = 40


@dataclass(frozen=True)
class _Trial:
    """From set-up to the next one [world s]; start is that of its capture, inf before."""

    is_of_person: bool
    worn: Worn | None
    since: float
    start: float
    raises: Raises


class Person:
    """Times are world seconds. Between trials, and in the trials of a cuff, the person stands with the arm at rest."""

    def __init__(self, settings: PersonSettings, emg_channels: tuple[str, ...], seed: int) -> None:
        self._settings = settings
        self._rng = np.random.default_rng((seed, 4))
        self._shoulder = published_shoulder()
        self._posture = RaisedPosture(self._shoulder)
        self._points = [*self._shoulder.markers.values(), *self._shoulder.cord.values()]
        self.labels: tuple[str, ...] = (*self._shoulder.markers, *self._shoulder.cord)
        deviations = np.full(3 * len(self._points), 1e-3 * settings.soft_tissue_mm)
        self._skin = random_wander(self._rng, deviations, *settings.soft_tissue_hz, terms=SKIN_TERMS)
        sway = np.array([*[np.radians(settings.sway_deg)] * 3, *[1e-3 * settings.sway_mm] * 3])
        self._sway = random_wander(self._rng, sway, *SWAY_HZ)
        self._stance = Rotation.from_euler("z", settings.facing_deg, degrees=True) * Y_UP_TO_Z_UP
        self._noise = {name: EmgNoise(self._rng) for name in emg_channels}
        self._trials = [_Trial(is_of_person=False, worn=None, since=-math.inf, start=math.inf, raises=no_raises(0.0))]

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        return self._shoulder.coordinate_names

    def set_up(self, test: str, worn: Worn | None, now: float) -> None:
        """What the next capture plays, and what is worn from now on; the test may be one of something else."""
        settings = self._settings
        raises = realised_raises(settings.raises, self._rng) if test == "motion" else no_raises(settings.pose_s)
        self._trials.append(_Trial(test in BODY_TESTS, worn, now, math.inf, raises))

    def begin(self, start: float) -> float:
        """The capture begins at `start`; returns when the person will have finished."""
        last = self._trials[-1]
        self._trials[-1] = replace(last, start=start)
        return start + last.raises.duration

    def coordinates(self, t: Floats) -> Floats:
        """(n, 15) true coordinates [rad, m] at t (n,), in the order of coordinate_names."""
        coordinates = self._posture(self._share(t))
        sway = self._sway.value(t)
        for column, name in enumerate(("rot_x", "rot_y", "rot_z", "tx", "ty", "tz")):
            coordinates[:, self._shoulder.index(f"ground_thorax_{name}")] += sway[:, column]
        return coordinates

    def markers(self, t: Floats) -> Floats:
        """(n, labels, 3) [mm] in the laboratory at t (n,), on moving skin; NaN for those of a suit that is not worn."""
        places = self._shoulder.places(self.coordinates(t), self._points)
        places += self._skin.value(t).reshape(places.shape)
        at = self._stance.apply(1e3 * places.reshape(-1, 3)).reshape(places.shape)
        at += np.array(self._settings.position_mm)
        is_suited = self._is_worn(t, "slack") | self._is_worn(t, "tight")
        at[~is_suited, len(self._shoulder.markers) :] = np.nan
        return at

    def has_load_cell(self, t: Floats) -> NDArray[np.bool_]:
        """(n,) whether the load cell is in the cord, or lies beside it, at t (n,): in all trials of the person."""
        return self._in(t, lambda trial: trial.is_of_person)

    def tension(self, t: Floats) -> Floats:
        """(n,) [N] of the cord, a linear spring that does not push: 0 where the suit is not worn."""
        settings, cord = self._settings, list(self._shoulder.cord.values())
        is_tight = self._is_worn(t, "tight")
        if not is_tight.any():
            return np.zeros(t.shape)
        points = self._shoulder.places(self.coordinates(t), cord)
        length = np.linalg.norm(np.diff(points, axis=1), axis=2).sum(axis=1)
        pull = settings.cord_stiffness_n_per_m * np.maximum(0.0, length - settings.cord_rest_length_m)
        return np.where(is_tight, pull, 0.0)

    def emg(self, channel: str, t: Floats) -> Floats:
        """(n,) [V] at the electrodes at t (n,)."""
        return np.asarray(1e-3 * self._settings.emg_full_mv * self.activation(channel, t) * self._noise[channel](t))

    def activation(self, channel: str, t: Floats) -> Floats:
        """(n,) from 0 to 1: with the raise of the arm; a tight cord carries a part of it, and mvc is all."""
        number = list(self._noise).index(channel)
        highest = np.full(t.shape, 0.5 / (1 + 0.5 * number))
        highest[self._is_worn(t, "tight")] *= 1 - self._settings.cord_relief
        highest[self._is_worn(t, "mvc")] = 1.0 - BASELINE
        return BASELINE + highest * self._share(t)

    def _share(self, t: Floats) -> Floats:
        share = np.zeros(t.shape)
        for trial, is_now in self._in_trials(t):
            if math.isfinite(trial.start):
                share[is_now] = trial.raises.share(t[is_now] - trial.start)
        return share

    def _is_worn(self, t: Floats, worn: Worn) -> NDArray[np.bool_]:
        return self._in(t, lambda trial: trial.worn == worn)

    def _in(self, t: Floats, is_such: Callable[[_Trial], bool]) -> NDArray[np.bool_]:
        found = np.zeros(t.shape, dtype=bool)
        for trial, is_now in self._in_trials(t):
            found[is_now] = is_such(trial)
        return found

    def _in_trials(self, t: Floats) -> list[tuple[_Trial, NDArray[np.bool_]]]:
        """Every trial that one of the times t (n,) lies in, and which of them do."""
        bounds = [trial.since for trial in self._trials]
        which = np.searchsorted(bounds, t, side="right") - 1
        return [(self._trials[index], which == index) for index in np.unique(which)]
