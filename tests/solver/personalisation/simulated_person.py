"""A person who is not the generic model: drawn sizes, marker offsets and girdle, seen through sliding skin."""

from dataclasses import dataclass, replace

import numpy as np

from solver.bundled import bundled_model
from solver.inverse_kinematics.solve import assemble
from solver.model import Array, Marker, ModelError
from solver.multibody.postures import points_in_ground, postures
from solver.personalisation.anthropometry import BodyPriors, body_factors, population_priors
from solver.scaling import Scaling, scale_skeleton

MODEL = bundled_model()
PLACES = {
    "thorax": ((0.02, 0.0, 0.0), (-0.10, 0.03, 0.0), (0.07, -0.16, 0.0), (-0.12, -0.15, 0.01)),
    "scapula": ((-0.045, 0.003, 0.017), (-0.09, -0.002, -0.1), (-0.11, -0.115, -0.09)),
    "humerus": ((0.0, -0.28, 0.025), (0.0, -0.28, -0.045), (0.03, -0.15, 0.03)),
    "radius": ((0.05, -0.22, 0.03),),
    "ulna": ((-0.016, -0.24, 0.03),),
}
MARKERS = tuple(
    Marker(f"{body}_{k}", MODEL.body_index(body), np.array(place))
    for body, places in PLACES.items()
    for k, place in enumerate(places)
)

PRIORS = population_priors(MODEL, MARKERS)


@dataclass(frozen=True, eq=False)
class Person:
    """The truth (factors,), (markers, 3) [m], and what is seen of it: trials of (frames, markers, 3) [m]."""

    factors: Array
    offsets: Array
    trials: tuple[Array, ...]


def draw_person(seed: int, frames: int = 24, scatter: float = 1.0) -> Person:
    """From the population's priors; scatter multiplies that of the skin, which moves by harmonics of the cycle."""
    chance = np.random.default_rng(seed)
    priors = PRIORS
    logs, mean = _draw_size(priors, chance)
    offsets = chance.standard_normal((len(MARKERS), 3)) * priors.errors.offset[:, None]
    by_body = body_factors(priors.factors, np.exp(logs))
    body = scale_skeleton(MODEL, Scaling(by_body))
    moved = [
        replace(marker, location=marker.location * by_body[MODEL.bodies[marker.body].name] + offset)
        for marker, offset in zip(MARKERS, offsets, strict=True)
    ]
    trials = []
    for arm in ("plane_elv", "shoulder_elv"):
        motion = _motion(priors, mean, arm, frames, chance)
        state = postures(body, np.array([assemble(body, wanted) for wanted in motion]), np.zeros_like(motion))
        seen = np.stack([points_in_ground(state, marker.body, marker.location) for marker in moved], axis=1)
        trials.append(seen + scatter * _skin(priors, frames, chance))
    return Person(np.exp(logs), offsets, tuple(trials))


def _draw_size(priors: BodyPriors, chance: np.random.Generator) -> tuple[Array, Array]:
    """Logarithms of the factors, and mean posture (coordinates,) from the joint prior of both: bones that would need an
    unusual girdle to meet at the acromioclavicular joint are as unlikely as that girdle.
    """
    girdle = [MODEL.coordinate_index(name) for name in priors.girdle]
    defaults = MODEL.default_coordinates
    while True:
        logs = chance.multivariate_normal(np.zeros(len(priors.factors)), priors.covariance)
        body = scale_skeleton(MODEL, Scaling(body_factors(priors.factors, np.exp(logs))))
        try:
            nearest = (assemble(body) - defaults)[girdle] / priors.person
        except ModelError:  # no posture lets them meet
            continue
        if chance.uniform() < np.exp(-0.5 * nearest @ nearest):
            wanted = defaults.copy()
            wanted[girdle] += priors.person * chance.standard_normal(len(girdle))
            return logs, assemble(body, wanted)


def _motion(priors: BodyPriors, mean: Array, arm: str, frames: int, chance: np.random.Generator) -> Array:
    """Two cycles of the arm about a mean posture (coordinates,); the girdle goes along with the cycle."""
    phase = np.linspace(0.0, 4.0 * np.pi, frames)
    wanted = np.tile(mean, (frames, 1))
    wanted[:, MODEL.coordinate_index(arm)] += 0.6 * (1.0 - np.cos(phase))
    wanted[:, MODEL.coordinate_index("elbow_flexion")] += 0.3 + 0.2 * np.sin(phase)
    for name, deviation in priors.girdle.items():
        swing = deviation * chance.standard_normal()
        wanted[:, MODEL.coordinate_index(name)] += np.sqrt(2.0) * swing * np.cos(phase)
    return wanted


def _skin(priors: BodyPriors, frames: int, chance: np.random.Generator) -> Array:
    """(frames, markers, 3) [m]: each marker's scatter in four harmonics of the cycle."""
    phase = np.linspace(0.0, 4.0 * np.pi, frames)
    waves = np.stack([wave(k * phase) for k in (0.5, 1.0) for wave in (np.sin, np.cos)])
    parts = chance.standard_normal((4, len(MARKERS), 3)) / np.sqrt(2.0)
    slide: Array = np.einsum("wf,wmi->fmi", waves, parts) * priors.errors.scatter[:, None]
    return slide
