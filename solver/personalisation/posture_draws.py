"""A trial's postures, drawn from the uncertainty of the person's body and from the scatter of the markers.

Every draw is another body of the posterior (size, places of the markers, posture of the girdle) and another
displacement of the skin under each marker, which lasts the whole trial; inverse kinematics is then solved again.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from solver.inverse_kinematics.posture_draws import draw_postures
from solver.inverse_kinematics.solve import InverseKinematics
from solver.model import Marker, Model
from solver.personalisation.estimate import BodyEstimate, body_of

Array = NDArray[np.float64]


def draw_postures_of_person(
    generic: Model,
    markers: Sequence[Marker],
    estimate: BodyEstimate,
    observed: Array,
    solution: InverseKinematics,
    noise: ArrayLike,
    *,
    count: int,
    seed: int = 1,
) -> Iterator[Array]:
    """`count` drawn sequences of postures, each (frames, coordinates) [rad or m].

    generic and markers are what the body was estimated from; observed (frames, markers, 3) [m] and solution are one of
    its trials; noise is the standard deviation along each axis [m] of white noise, one for all or (markers,).
    """
    generator = np.random.default_rng(seed)
    root = np.linalg.cholesky(estimate.covariance)
    for _ in range(count):
        parameters = estimate.parameters + root @ generator.standard_normal(len(root))
        skeleton, tasks = body_of(generic, markers, estimate.priors, parameters)
        scatter = estimate.priors.errors.scatter
        chance = int(generator.integers(2**32))
        yield from draw_postures(skeleton, observed, tasks, solution, noise, scatter, count=1, seed=chance)
