"""A cuff that yields in three dimensions, pulled along ropes in any direction, at rest and swinging.

Balance of forces in space, K X + C Ẋ + m Ẍ = F u, integrated by its matrix exponential: imports nothing of solver, nor
of what is fitted with. Two markers ride on the rope. The first trial begins in the posture in which K and C are given;
in the others the body stands a little turned, and it sways in all.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.signal import lfilter

from fitting.trial.clocks import LagUncertainty
from fitting.trial.trial import Trial
from recordings.manifest import CuffSite
from tests.fitting.experiment import ANCHOR, CUFF
from tests.fitting.pulls import trial_of, wander

LABELS = ("anchor_1", "anchor_2", "anchor_3", "anchor_4", "cuff_1", "rope_1", "rope_2")
ROPE = (0.1, 0.6)
"""Metres of the rope's markers from the cuff;"""
STEP = 0.01
INSIDE = 10
"""Steps of the integration in a frame."""


@dataclass(frozen=True)
class Space:
    """The cuff and the rig; SI units. Entries of K and C; loads in newtons."""

    stiffness: NDArray[np.float64]
    damping: NDArray[np.float64]
    mass: float = 0.2
    loads: tuple[float, ...] = (15.0, 30.0, 45.0, 30.0, 15.0)
    hold: float = 6.0
    swing: float = 14.0
    frequency: float = 1.0
    force_rate: float = 100.0
    force_noise: float = 0.3
    zero: float = 1.0
    marker_noise: float = 0.2e-3
    sway: float = 2e-3
    turn: float = 5e-3
    lag_sd: float = 0.2e-3
    lag: float = 0.0
    rope_error: float = 0.0
    """Radians by which the markers show the rope where it is not."""


def elbow(random: np.random.Generator) -> Space:
    """The published elbow cuff along one axis, 1.6 and 0.5 times as stiff along two others, turned at random."""
    turned, _ = np.linalg.qr(random.standard_normal((3, 3)))
    axes = np.diag([1.0, 1.6, 0.5])
    return Space(2530.0 * turned @ axes @ turned.T, 139.0 * turned @ axes @ turned.T)


def directions(spread: float, count: int = 5) -> NDArray[np.float64]:
    """Unit vectors (count, 3): straight ahead, then right, up, left and down by `spread` degrees."""
    angle = np.radians(spread)
    around = np.arange(4) * np.pi / 2
    turned = [(np.cos(angle), np.sin(angle) * np.cos(a), np.sin(angle) * np.sin(a)) for a in around]
    return np.array([(1.0, 0.0, 0.0), *turned])[:count]


def pulled(space: Space, u: NDArray[np.float64], test: str, repeat: int, random: np.random.Generator) -> Trial:
    """One static or dynamic trial along u (3,)."""
    load = _held(space, random) if test == "static" else _swung(space, random)
    time = STEP / INSIDE * np.arange(len(load))
    x = _answer(space, load, u)
    frames = time[::INSIDE]
    still = np.clip(frames - 2.0, 0, 1)[:, None]
    rest = space.sway * still * np.column_stack([wander(frames, random) for _ in range(3)])
    angles = space.turn * still * np.column_stack([wander(frames, random) for _ in range(3)])
    if (test, repeat) != ("static", 1):
        angles += space.turn * random.standard_normal(3)
    turns = np.eye(3) + np.cross(angles[:, None, :], np.eye(3)[None], axisc=1)
    turns, _ = np.linalg.qr(turns)
    turns *= np.sign(np.einsum("nii->ni", turns))[:, None, :]
    shown = np.cross(u, (0.3, 0.4, 0.87))
    rope = u + space.rope_error * shown / np.linalg.norm(shown)
    places = np.concatenate(
        (
            np.repeat(ANCHOR[None], len(frames), axis=0),
            (CUFF + x)[:, None],
            *((CUFF + x + r * rope)[:, None] for r in ROPE),
        ),
        axis=1,
    )
    lab = np.einsum("nij,nmj->nmi", turns, places) + rest[:, None] + np.array([0.4, -0.2, 1.1])
    lab += space.marker_noise * random.standard_normal(lab.shape)
    force_time = np.arange(0.0, time[-1], 1 / space.force_rate)
    force = np.interp(force_time + space.lag, time, load) + space.zero
    of = {"test": test, "repeat": repeat, "start_utc_ns": (2 * repeat + (test == "dynamic")) * 10**12}
    of |= {"file": f"{test}-{repeat}", "sha256": f"{test}{repeat}", "cuff_mass": space.mass}
    measured = force_time, force + space.force_noise * random.standard_normal(len(force))
    site = CuffSite("elbow", "arm", LABELS[:4], LABELS[4:5], LABELS[5:])
    return trial_of(site, measured, (frames, LABELS, lab), LagUncertainty(0.0, space.lag_sd, 0.0), **of)


def _held(space: Space, random: np.random.Generator) -> NDArray[np.float64]:
    levels = (0.0, *space.loads, 0.0)
    time = np.arange(0.0, space.hold * len(levels), STEP / INSIDE)
    load = np.full(len(time), 2.0)
    for i, change in enumerate(np.diff(levels), 1):
        load += change * np.clip((time - space.hold * i - random.uniform(-0.3, 0.3)) / 0.4, 0, 1)
    return load


def _swung(space: Space, random: np.random.Generator) -> NDArray[np.float64]:
    time = np.arange(0.0, space.swing, STEP / INSIDE)
    phase = 2 * np.pi * space.frequency * time + 0.4 * wander(time, random)
    return np.asarray(25.0 + 12.0 * (1 + 0.1 * wander(time, random)) * np.sin(phase))


def _answer(space: Space, load: NDArray[np.float64], u: NDArray[np.float64]) -> NDArray[np.float64]:
    """X (frames, 3) from rest under the first load; each small step has its mean load."""
    motion = np.zeros((7, 7))
    motion[:3, 3:6] = np.eye(3)
    motion[3:6, :3], motion[3:6, 3:6] = -space.stiffness / space.mass, -space.damping / space.mass
    motion[3:6, 6] = u / space.mass
    onward = expm(motion * STEP / INSIDE)
    state = np.concatenate((np.linalg.solve(space.stiffness, load[0] * u), np.zeros(3)))
    driving = (load + np.append(load[1:], load[-1])) / 2
    values, vectors = np.linalg.eig(onward[:6, :6])
    drive = np.linalg.solve(vectors, onward[:6, 6].astype(complex))
    modal = np.linalg.solve(vectors, state.astype(complex))
    places = np.empty((len(load), 6), complex)
    for mode in range(6):
        places[:, mode] = lfilter([0.0, drive[mode]], [1.0, -values[mode]], driving, zi=modal[mode : mode + 1])[0]
    return np.asarray((places[::INSIDE] @ vectors[:3].T).real)
