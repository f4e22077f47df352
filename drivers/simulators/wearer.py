"""A person with markers on the skin, who holds a pose or raises an arm, wears a cord, and has muscles with electrodes.

Frames: "ground" is that of shoulder.py, y up, in which the person stands; the laboratory has z up. Does not imitate:
skin that follows the bone less the higher the arm is raised, the other arm, fatigue, the cord's pull on the posture.

The arm is raised several times, by a share of a full raise over time. The girdle follows the arm by straight lines over
the share of the raise (a rhythm of our own); the clavicle and one coordinate of the scapula close the acromioclavicular
joint.

Surface EMG has its simplest model: band-limited noise with an amplitude proportional to the activation. N. Hogan, R. W.
Mann, "Myoelectric signal processing: optimal estimation applied to electromyography", IEEE Trans. Biomed. Eng. 27(7)
(1980). Does not imitate: motor units, cross-talk between muscles, motion artefacts, mains hum.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from drivers.simulators.markers import random_wander, rotation_matrices
from drivers.simulators.settings import PersonSettings, RaiseSettings
from drivers.simulators.shoulder import Shoulder, published_shoulder

Floats = NDArray[np.float64]
Worn = Literal["unsuited", "slack", "tight", "mvc"]
BODY_TESTS = ("pose", "motion")

Y_UP_TO_Z_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
BASELINE = 0.03
"""Activation at rest."""
SWAY_HZ = 0.05, 0.8
SKIN_TERMS = 40
RHYTHM_DEG = {
    "clav_prot": (-24.0, -34.0),
    "clav_elev": (-6.0, 8.0),
    "scapula_abduction": (-17.0, -6.0),
    "scapula_elevation": (-5.0, -6.0),
    "scapula_upward_rot": (10.0, 48.0),
    "scapula_winging": (6.0, -4.0),
    "plane_elv": (40.0, 40.0),
    "shoulder_elv": (15.0, 100.0),
    "axial_rot": (-10.0, -25.0),
}
"""Degrees with the arm at rest and raised; three of the girdle's then change until its joint is closed."""
CLOSING = ("clav_prot", "clav_elev", "scapula_elevation")
KNOTS = 41
PERIOD_S = 16.0
RATE_HZ = 4096.0  # of the table, which is interpolated linearly
LOWEST_HZ, HIGHEST_HZ = 20.0, 450.0


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
        self._stance = rotation_matrices((0.0, 0.0, np.radians(settings.facing_deg))) @ Y_UP_TO_Z_UP
        self._noise = {name: EmgNoise(self._rng) for name in emg_channels}
        self._trials = [_Trial(is_of_person=False, worn=None, since=-math.inf, start=math.inf, raises=no_raises(0.0))]

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        return self._shoulder.coordinate_names

    def set_up(self, test: str, worn: Worn | None, now: float) -> None:
        """Set the test of the next capture, of the wearer or not, and the cuff that is worn from now on."""
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
        at = np.asarray(1e3 * places @ self._stance.T + np.array(self._settings.position_mm))
        is_suited = self._is_worn(t, "slack") | self._is_worn(t, "tight")
        at[~is_suited, len(self._shoulder.markers) :] = np.nan
        return at

    def has_load_cell(self, t: Floats) -> NDArray[np.bool_]:
        """(n,) whether the load cell is in the cord, or is not under load, at t (n,): in all trials of the person."""
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


class RaisedPosture:
    """Coordinates (n, 15) at shares (n,) of a full raise from 0 to 1, the thorax upright in ground."""

    def __init__(self, shoulder: Shoulder) -> None:
        from scipy.interpolate import CubicSpline  # a fifth of the start of a bench, most of which have no wearer

        share = np.linspace(0.0, 1.0, KNOTS)
        coordinates = np.zeros((KNOTS, len(shoulder.coordinate_names)))
        for name, (low, high) in RHYTHM_DEG.items():
            coordinates[:, shoulder.index(name)] = np.radians(low + (high - low) * share)
        self._spline = CubicSpline(share, shoulder.closed(coordinates, CLOSING))

    def __call__(self, share: Floats) -> Floats:
        return np.asarray(self._spline(share))


@dataclass(frozen=True)
class Raises:
    """Cycles of up, hold, down, rest, each realised with its own chance; seconds from the start of the capture.

    starts (cycles,); up, hold, down (cycles,) [s]; heights (cycles,): the share that is reached
    """

    starts: Floats
    up: Floats
    hold: Floats
    down: Floats
    heights: Floats
    duration: float

    def share(self, t: Floats) -> Floats:
        """(n,) of a full raise at t (n,), by minimum-jerk curves; 0 outside the cycles."""
        since = t[:, None] - self.starts
        rise = _eased(since / self.up)
        fall = _eased((since - self.up - self.hold) / self.down)
        return np.asarray(((rise - fall) * self.heights).sum(axis=1))


def realised_raises(settings: RaiseSettings, rng: np.random.Generator) -> Raises:
    """One trial's cycles."""
    count = settings.cycles
    pace = 1.0 + rng.normal(0.0, settings.duration_jitter, (4, count))
    planned = np.array([settings.up_s, settings.hold_s, settings.down_s, settings.rest_s])
    up, hold, down, rest = planned[:, None] * np.clip(pace, 0.5, 2.0)
    lengths = up + hold + down + rest
    starts = settings.lead_in_s + np.concatenate(([0.0], np.cumsum(lengths)[:-1]))
    heights = np.clip(1.0 - np.abs(rng.normal(0.0, settings.height_jitter, count)), 0.5, 1.0)
    return Raises(starts, up, hold, down, heights, float(starts[-1] + lengths[-1] + settings.lead_out_s))


def no_raises(duration: float) -> Raises:
    """A pose that is held."""
    none = np.ones(0)
    return Raises(none, none, none, none, none, duration)


def _eased(progress: Floats) -> Floats:
    p = np.clip(progress, 0.0, 1.0)
    return np.asarray(p**3 * (10 - 15 * p + 6 * p * p))


class EmgNoise:
    """Noise of variance 1 as a function of time, periodic with PERIOD_S."""

    def __init__(self, rng: np.random.Generator) -> None:
        count = round(PERIOD_S * RATE_HZ)
        frequency = np.fft.rfftfreq(count, 1 / RATE_HZ)
        is_in_band = (frequency >= LOWEST_HZ) & (frequency <= HIGHEST_HZ)
        phases = rng.uniform(0.0, 2 * np.pi, len(frequency))
        table = np.fft.irfft(is_in_band * np.exp(1j * phases), count)
        self._table = np.append(table, table[0]) / np.std(table)

    def __call__(self, t: Floats) -> Floats:
        """(n,) at t (n,) [s]."""
        place = np.mod(t, PERIOD_S) * RATE_HZ
        low = np.minimum(place.astype(np.int64), len(self._table) - 2)
        part = place - low
        return np.asarray((1 - part) * self._table[low] + part * self._table[low + 1])
