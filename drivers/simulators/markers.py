"""Marker positions: a swaying body, the cuff displaced along the rope, the rope towards its pulley.

Frames: "anchor" is fixed to the anchoring body; "ground" is the laboratory, z up. Millimetres, as QTM sends. Wander is
the smooth random motion of a body or a hand: sinusoids of random phase within a band.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drivers.simulators.settings import Settings

Floats = NDArray[np.float64]
_CROSS = np.zeros((3, 3, 3))
"""v @ _CROSS is the matrix whose product with x is the cross product v × x."""
_CROSS[[0, 1, 2], [2, 0, 1], [1, 2, 0]], _CROSS[[0, 1, 2], [1, 2, 0], [2, 0, 1]] = 1.0, -1.0
_OCCLUSION_BLOCK_S = 10.0


def rotation_matrices(vectors: ArrayLike) -> Floats:
    """Rotations (…, 3, 3) about vectors (…, 3) whose lengths are the angles [rad], by Rodrigues' formula.

    SciPy's Rotation gives the same, and its import takes two fifths of the start of a simulated bench.
    """
    vectors = np.asarray(vectors, dtype=float)
    angle = np.linalg.norm(vectors, axis=-1)[..., None, None]
    cross = np.tensordot(vectors, _CROSS, axes=1)
    sine, versine = np.sinc(angle / np.pi), 0.5 * np.sinc(angle / (2 * np.pi)) ** 2
    return np.asarray(np.eye(3) + sine * cross + versine * (cross @ cross))


class Wearer:
    """The body the cuff is worn on: a rigid anchor that sways."""

    def __init__(self, settings: Settings, rng: np.random.Generator) -> None:
        wearer = settings.wearer
        deviations = np.array([wearer.sway_mm] * 3 + [np.radians(wearer.sway_deg)] * 3)
        self._sway = random_wander(rng, deviations, wearer.lowest_hz, wearer.highest_hz)
        self._stance = rotation_matrices(np.radians(wearer.orientation_deg))
        self._position = np.array(wearer.position_mm)
        self._cuff_in_anchor = np.array(settings.cuff_body.position_mm)
        self._pulley = np.array(settings.rig.pulley_mm)

    def pose(self, t: Floats) -> tuple[Floats, Floats]:
        """transform_anchor_to_ground at t (n,): rotations (n, 3, 3), and the origins (n, 3) [mm]."""
        sway = self._sway.value(t)
        return rotation_matrices(sway[:, 3:]) @ self._stance, self._position + sway[:, :3]

    def rope(self, t: Floats) -> tuple[Floats, Floats]:
        """Position of the unloaded cuff (n, 3) [mm], and unit direction (n, 3) of the rope from there, in ground."""
        return self.rope_at(*self.pose(t))

    def rope_at(self, rotation: Floats, origin: Floats) -> tuple[Floats, Floats]:
        """The same at a pose of the anchor."""
        place = rotation @ self._cuff_in_anchor + origin
        reach = self._pulley - place
        return place, reach / np.linalg.norm(reach, axis=1, keepdims=True)

    def along_rope(self) -> Wander:
        """Displacement of the unloaded cuff along the mean pull [m] by the sway of the body, for small angles."""
        arm = self._stance @ self._cuff_in_anchor
        reach = self._pulley - self._position - arm
        direction = reach / np.linalg.norm(reach)
        return self._sway.along(np.concatenate([direction, np.cross(arm, direction)])[:, None] * 1e-3)


class MarkerCloud:
    """All markers as the cameras see them, with noise and occlusions."""

    def __init__(self, settings: Settings, wearer: Wearer, seed: int, person_labels: tuple[str, ...] = ()) -> None:
        self._mocap = settings.mocap
        self._wearer = wearer
        self._seed = seed
        self._rng = np.random.default_rng((seed, 1))
        cuff = np.array(settings.cuff_body.position_mm)
        self._on_anchor = np.array(
            [*self._mocap.anchor_markers_mm.values(), *(cuff + p for p in self._mocap.cuff_markers_mm.values())]
        )
        self._is_on_cuff = np.arange(len(self._on_anchor)) >= len(self._mocap.anchor_markers_mm)
        self.labels: tuple[str, ...] = (
            *self._mocap.anchor_markers_mm,
            *self._mocap.cuff_markers_mm,
            *self._mocap.rope_markers_mm,
            *((settings.bounce.marker,) if settings.bounce else ()),
            *person_labels,
        )
        self._weight_at_rest = np.array(settings.bounce.position_mm) if settings.bounce else None

    def seen(
        self, t: Floats, displacement: Floats, weight: Floats | None = None, person: Floats | None = None
    ) -> Floats:
        """(n, labels, 3) [mm] at t (n,) with the cuff displaced by displacement (n,) [m]; NaN where hidden.

        weight (n,) [m] is how far the bouncing weight is below its rest; None: at rest. person (n, person_labels, 3)
        [mm] are the markers of the person, None where there is none.
        """
        points = self.true_points(t, displacement)
        if self._weight_at_rest is not None:
            place = np.repeat(self._weight_at_rest[None], len(t), axis=0)
            place[:, 2] -= 0.0 if weight is None else 1e3 * weight
            points = np.concatenate([points, place[:, None]], axis=1)
        if person is not None:
            points = np.concatenate([points, person], axis=1)
        points += self._rng.normal(0.0, self._mocap.noise_mm, points.shape)
        points[self._hidden(t)] = np.nan
        return points

    def true_points(self, t: Floats, displacement: Floats) -> Floats:
        """(n, labels, 3) [mm] on the wearer and the rope, without noise, none hidden."""
        rotation, origin = self._wearer.pose(t)
        place, direction = self._wearer.rope_at(rotation, origin)
        shift = direction * (displacement * 1e3)[:, None]
        on_body = np.einsum("nij,mj->nmi", rotation, self._on_anchor) + origin[:, None]
        on_body[:, self._is_on_cuff] += shift[:, None]
        distances = np.array(list(self._mocap.rope_markers_mm.values()))
        on_rope = (place + shift)[:, None] + direction[:, None] * distances[:, None]
        return np.concatenate([on_body, on_rope], axis=1)

    def _hidden(self, t: Floats) -> NDArray[np.bool_]:
        """(n, labels): whether the marker is occluded; independent of earlier queries."""
        hidden = np.zeros((len(t), len(self.labels)), dtype=bool)
        blocks = np.floor(t / _OCCLUSION_BLOCK_S).astype(int)
        for block in np.unique(blocks):
            starts, lengths = self._occlusions(int(block))
            since = t[blocks == block, None] - starts
            hidden[blocks == block] = (since >= 0) & (since < lengths)
        return hidden

    def _occlusions(self, block: int) -> tuple[Floats, Floats]:
        """Start and length [s] of at most one occlusion per marker in one block of time; length 0 for none."""
        rng = np.random.default_rng((self._seed, 2, block))
        chance = self._mocap.occlusions_per_minute * _OCCLUSION_BLOCK_S / 60
        starts = (block + rng.uniform(size=len(self.labels))) * _OCCLUSION_BLOCK_S
        lengths = rng.exponential(self._mocap.mean_occlusion_s, len(self.labels))
        return starts, np.where(rng.uniform(size=len(self.labels)) < chance, lengths, 0.0)


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

    def derivative(self) -> Wander:
        """The wander whose value is the time derivative of this one's, per second."""
        return Wander(self.omega, -self.cosine * self.omega[:, None], self.sine * self.omega[:, None])

    def rate(self, t: Floats) -> Floats:
        """The time derivative of value, (n, axes) per second."""
        return self.derivative().value(t)

    def integral(self, t: Floats) -> Floats:
        """An antiderivative of value, (n, axes)."""
        return Wander(self.omega, self.cosine / self.omega[:, None], -self.sine / self.omega[:, None]).value(t)

    def along(self, directions: Floats) -> Wander:
        """The motion projected: directions (axes, m) gives m axes."""
        return Wander(self.omega, self.sine @ directions, self.cosine @ directions)


class WanderOnGrid:
    """A wander at evenly spaced times, without a sine of each: those of a first time are turned by a table's angles."""

    def __init__(self, wander: Wander, step_s: float, most: int) -> None:
        rate = wander.derivative()
        self._omega = wander.omega
        self._sine = np.hstack([wander.sine, rate.sine])
        self._cosine = np.hstack([wander.cosine, rate.cosine])
        angle = np.multiply.outer(step_s * np.arange(most), wander.omega)
        self._sines, self._cosines = np.sin(angle), np.cos(angle)

    def value_and_rate(self, start: float, count: int) -> Floats:
        """(count, 2 axes) from the time start [s] on: value, and its time derivative per second; count <= most."""
        sine, cosine = np.sin(start * self._omega)[:, None], np.cos(start * self._omega)[:, None]
        from_sines = self._sine * cosine - self._cosine * sine
        from_cosines = self._sine * sine + self._cosine * cosine
        return np.asarray(self._sines[:count] @ from_sines + self._cosines[:count] @ from_cosines)


def random_wander(
    rng: np.random.Generator, deviations: Floats, lowest_hz: float, highest_hz: float, terms: int = 9
) -> Wander:
    """A wander with the standard deviations (axes,); amplitudes fall with frequency as a swaying body's do."""
    frequency = np.geomspace(lowest_hz, highest_hz, terms) * rng.uniform(0.9, 1.1, terms)
    weight = frequency**-0.5
    amplitude = deviations * (np.sqrt(2) * weight / np.linalg.norm(weight))[:, None]
    phase = rng.uniform(0, 2 * np.pi, amplitude.shape)
    return Wander(2 * np.pi * frequency, amplitude * np.cos(phase), amplitude * np.sin(phase))
