"""A smooth random motion without end: sinusoids of random phase within a band."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Wander:
    """value(t) = Σ sine sin ωt + cosine cos ωt, with ω (terms,) in rad/s and sine, cosine (terms, axes)."""

    omega: Floats
    sine: Floats
    cosine: Floats

    def value(self, t: Floats) -> Floats:
        """(n, axes) at the times t (n,) in seconds."""
        angle = np.multiply.outer(t, self.omega)
        return np.sin(angle) @ self.sine + np.cos(angle) @ self.cosine

    def rate(self, t: Floats) -> Floats:
        """The time derivative of value, (n, axes) per second."""
        return Wander(self.omega, -self.cosine * self.omega[:, None], self.sine * self.omega[:, None]).value(t)

    def integral(self, t: Floats) -> Floats:
        """An antiderivative of value, (n, axes)."""
        return Wander(self.omega, self.cosine / self.omega[:, None], -self.sine / self.omega[:, None]).value(t)

    def along(self, directions: Floats) -> Wander:
        """The motion projected: directions (axes, m) gives m axes."""
        return Wander(self.omega, self.sine @ directions, self.cosine @ directions)


def random_wander(
    rng: np.random.Generator, deviations: Floats, lowest_hz: float, highest_hz: float, terms: int = 9
) -> Wander:
    """A wander with the standard deviations (axes,); amplitudes fall with frequency as a swaying body's do."""
    frequency = np.geomspace(lowest_hz, highest_hz, terms) * rng.uniform(0.9, 1.1, terms)
    weight = frequency**-0.5
    amplitude = deviations * (np.sqrt(2) * weight / np.linalg.norm(weight))[:, None]
    phase = rng.uniform(0, 2 * np.pi, amplitude.shape)
    return Wander(2 * np.pi * frequency, amplitude * np.cos(phase), amplitude * np.sin(phase))
