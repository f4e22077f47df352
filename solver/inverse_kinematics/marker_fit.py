"""Markers before and after a solution: their fit, the laboratory's frame, and frames without a posture.

How well markers fit a model: as given, in the mirror, and how far the body is tilted.

From a laboratory's frame to the model's ground: y up, and the person facing as the model does. Only the turn about the
vertical is free, so that gravity keeps its direction.

Frames without a posture: short gaps are interpolated, and a motion ends at a long one.

Markers whose labels are exchanged for a while, from their trajectories alone: each appears where the other was about to
be. Places are extrapolated from the last two frames, and over a gap they stay where they were last seen.

Errors of markers and of targets of coordinates, which grow as the arm is raised: with the distance d of a posture from
the hanging arm, where d² is the sum, over the bodies with markers, of (2 sin φ/2)², φ the angle between two
orientations in the trunk.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from documents.interval import counted
from solver.errors import MotionError, SolverCode
from solver.inverse_kinematics.solve import (
    InverseKinematics,
    PostureOutcome,
    TrackingTasks,
    assemble,
    solve_inverse_kinematics,
)
from solver.model import GROUND, Array, Marker, Model, ModelError
from solver.motion import Motion
from solver.multibody.postures import points_in_ground, postures

FRAMES = 7
"""Frames that are looked at, evenly spread; each is solved from the default posture."""
MIRROR = np.array([1.0, 1.0, -1.0])
Vertical = Literal["x", "y", "z"]

TO_Y_UP: Final = {
    "x": np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
    "y": np.eye(3),
    "z": np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
}
"""Cyclic exchanges of axes by the laboratory's vertical one: (3, 3), laboratory vectors into vectors with y up."""
LONGEST_GAP = 0.25
"""Seconds; the published motions are filtered at 3 Hz, whose period is longer."""
SHORTEST_MOTION = 1.0
"""Seconds, below which the filter's ends reach into each other."""


@dataclass(frozen=True)
class MarkerFit:
    """Medians over some frames of a trial.

    size                spread of the markers over that of the model's in its default posture
    as_given, mirrored  RMS distance of the markers from those of the model [m], and of their mirror image
    tilt                angle [rad] between the upward direction in the body that the ground carries, and that in the
                        default posture
    """

    size: float
    as_given: float
    mirrored: float
    tilt: float


def fit_markers(model: Model, observed: Array, tasks: TrackingTasks) -> MarkerFit:
    """Fit some frames of a trial. observed (frames, markers, 3) [m] with at least one frame that shows a marker.

    Raises ModelError where shapes do not fit, or the model cannot be assembled.
    """
    seen = np.flatnonzero(np.isfinite(observed).all(axis=2).sum(axis=1))
    some = observed[seen[np.unique(np.linspace(0, len(seen) - 1, FRAMES).astype(int))]]
    size = float(np.median([_size(model, frame, tasks) for frame in some]))
    given, coordinates = _residual(model, some, tasks)
    mirrored, _ = _residual(model, MIRROR * some, tasks)
    upright = _upwards(model, assemble(model)[None])[0]
    cosine = _upwards(model, coordinates) @ upright
    return MarkerFit(size, given, mirrored, float(np.median(np.arccos(np.clip(cosine, -1.0, 1.0)))))


def _size(model: Model, frame: Array, tasks: TrackingTasks) -> float:
    """Of one frame (markers, 3): RMS distance from the mean, over that of the same markers of the model."""
    posture = model.default_coordinates[None]
    state = postures(model, posture, np.zeros_like(posture))
    places = np.array([points_in_ground(state, marker.body, marker.location)[0] for marker in tasks.markers])
    is_seen = np.isfinite(frame).all(axis=1)
    return float(
        np.std(frame[is_seen] - frame[is_seen].mean(axis=0)) / np.std(places[is_seen] - places[is_seen].mean(axis=0))
    )


def _residual(model: Model, observed: Array, tasks: TrackingTasks) -> tuple[float, Array]:
    """Median of the frames' RMS residuals [m], and their coordinates. Coordinate tasks would depend on the frame."""
    markers = TrackingTasks(tasks.markers, tasks.weights)
    solved = [solve_inverse_kinematics(model, frame[None], markers) for frame in observed]
    squares = [float(np.nanmean(solution.residuals**2)) for solution in solved]
    return float(np.sqrt(np.median(squares))), np.concatenate([solution.coordinates for solution in solved])


def _upwards(model: Model, coordinates: Array) -> Array:
    """(frames, 3) direction against gravity in the first body that the ground carries."""
    body = next(joint.child for joint in model.joints if joint.parent == GROUND)
    state = postures(model, coordinates, np.zeros_like(coordinates))
    up = -model.gravity / np.linalg.norm(model.gravity)
    return np.asarray(up @ state.rotation_to_ground[:, body])


def rotation_laboratory_to_ground(
    model: Model, markers: Sequence[Marker], observed: Array, vertical: Vertical = "z"
) -> Array:
    """(3, 3) that turns laboratory vectors into vectors in the model's ground.

    observed (frames, markers, 3) [m] in the laboratory, NaN where a marker is hidden. The turn about the vertical is
    that in which the markers' mean places lie nearest to those of the model in its default posture (least squares).
    Raises ModelError where fewer than three of the markers are ever seen.
    """
    is_seen = np.isfinite(observed).all(axis=(2,)).any(axis=0)
    if is_seen.sum() < 3:
        raise ModelError(
            f"expected at least 3 of the markers {', '.join(marker.name for marker in markers)} and found "
            f"{int(is_seen.sum())}; label them",
            SolverCode.TOO_FEW_MARKERS,
        )
    posture = assemble(model)[None]
    state = postures(model, posture, np.zeros_like(posture))
    expected = np.array([points_in_ground(state, marker.body, marker.location)[0] for marker in markers])[is_seen]
    upright = np.nanmean(observed[:, is_seen], axis=0) @ TO_Y_UP[vertical].T
    expected, upright = expected - expected.mean(axis=0), upright - upright.mean(axis=0)
    along = (upright * expected)[:, [0, 2]].sum()
    across = (upright[:, 2] * expected[:, 0] - upright[:, 0] * expected[:, 2]).sum()
    angle = np.arctan2(across, along)
    cosine, sine = np.cos(angle), np.sin(angle)
    about_vertical = np.array([[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]])
    return np.asarray(about_vertical @ TO_Y_UP[vertical])


@dataclass(frozen=True, eq=False)
class WholeMotion:
    """motion has a posture in every frame; start is its first frame in the trial.

    interpolated is the number of frames that were interpolated, left_out that of frames before and after the motion.
    """

    motion: Motion
    start: int
    interpolated: int
    left_out: int


def longest_whole_motion(model: Model, time: Array, solution: InverseKinematics) -> WholeMotion:
    """The longest part of a trial whose gaps last at most LONGEST_GAP; these are interpolated (PCHIP).

    time (frames,) [s], evenly spaced. Raises MotionError where that part is shorter than SHORTEST_MOTION.
    """
    interval = float(time[-1] - time[0]) / (len(time) - 1)
    solved = np.flatnonzero([outcome == PostureOutcome.SOLVED for outcome in solution.outcomes])
    breaks = np.flatnonzero(np.diff(solved) > math.floor(LONGEST_GAP / interval) + 1)
    parts = np.split(solved, breaks + 1)
    longest = max(parts, key=lambda part: part[-1] - part[0] if len(part) else -1)
    if len(longest) < 2 or (longest[-1] - longest[0]) * interval < SHORTEST_MOTION:
        raise MotionError(
            f"the markers should determine the posture for at least {SHORTEST_MOTION:g} s without a gap of more than "
            f"{LONGEST_GAP:g} s, and do in {len(solved)} of {counted(len(time), 'frame')}; record the trial again",
            SolverCode.NOT_COVERED,
        )
    start, end = int(longest[0]), int(longest[-1]) + 1
    whole = scipy.interpolate.PchipInterpolator(time[longest], solution.coordinates[longest])(time[start:end])
    motion = Motion(model.coordinate_names, time[start:end], whole)
    return WholeMotion(motion, start, end - start - len(longest), len(time) - (end - start))


NEAR, FAR = 0.35, 0.65
"""Parts of the distance between two markers: an exchanged marker is nearer to the other's place than NEAR, and farther
from its own than FAR."""
LEAST_DISTANCE = 0.02
"""m; markers that are closer together cannot be distinguished by position."""
LONGEST_EXTRAPOLATION = 3
"""Frames."""


@dataclass(frozen=True)
class Exchange:
    """Indices of two markers whose labels are exchanged in the frames from start to stop, stop excluded."""

    markers: tuple[int, int]
    start: int
    stop: int


def find_exchanges(observed: Array) -> tuple[Exchange, ...]:
    """Exchanges in a trial, observed (frames, markers, 3) [m], NaN where hidden.

    Labels are taken to be right in the longer part of the trial: one that stays exchanged to the end for more than
    half of the frames was exchanged before.
    """
    frames, count = observed.shape[:2]
    tracks = MarkerTracks(count)
    begun: dict[tuple[int, int], int] = {}
    found = []
    for frame in range(frames):
        seen = observed[frame, tracks.labels]
        for pair in exchanged_pairs(seen, tracks.expected(frame)):
            labels = tuple(sorted(int(tracks.labels[marker]) for marker in pair))
            tracks.exchange(*pair)
            start = begun.pop((labels[0], labels[1]), None)
            if start is None:
                begun[labels[0], labels[1]] = frame
            else:
                found.append(Exchange((labels[0], labels[1]), start, frame))
        tracks.add(frame, observed[frame, tracks.labels])
    for markers, start in begun.items():
        found.append(Exchange(markers, start, frames) if start > frames / 2 else Exchange(markers, 0, start))
    return tuple(sorted(found, key=lambda exchange: exchange.start))


class MarkerTracks:
    """Markers whatever their labels: the label (markers,) that each now has, and its last two places."""

    def __init__(self, count: int) -> None:
        self.labels = np.arange(count)
        self._last, self._before = np.full((2, count, 3), np.nan)
        self._frame = np.zeros(count, dtype=np.int64)

    def expected(self, frame: int) -> Array:
        """(markers, 3), NaN before a marker was seen."""
        steps = np.where(self.is_extrapolated(frame), frame - self._frame, 0)[:, None]
        return np.asarray(self._last + steps * np.nan_to_num(self._last - self._before))

    def is_extrapolated(self, frame: int) -> NDArray[np.bool_]:
        """(markers,) whether the last two places are known and recent."""
        return np.asarray((frame - self._frame <= LONGEST_EXTRAPOLATION) & np.isfinite(self._before[:, 0]))

    def exchange(self, one: int, other: int) -> None:
        self.labels[[one, other]] = self.labels[[other, one]]

    def forget(self, marker: int) -> None:
        """Take the next place of a marker as its first."""
        self._last[marker] = self._before[marker] = np.nan

    def add(self, frame: int, places: Array) -> None:
        is_seen = np.isfinite(places).all(axis=1)
        follows = is_seen & (self._frame == frame - 1) & np.isfinite(self._last[:, 0])
        self._before[is_seen] = np.where(follows[is_seen, None], self._last[is_seen], np.nan)
        self._last[is_seen] = places[is_seen]
        self._frame[is_seen] = frame


def exchanged_pairs(seen: Array, expected: Array) -> list[tuple[int, int]]:
    """Pairs of markers that appear in each other's places; seen and expected (markers, 3)."""
    with np.errstate(invalid="ignore"):
        away = np.linalg.norm(seen[:, None] - expected[None], axis=2)
        apart = np.linalg.norm(expected[:, None] - expected[None], axis=2)
        own = np.diagonal(away)
        is_exchanged = (away < NEAR * apart) & (NEAR * apart > away.T) & (apart > LEAST_DISTANCE)
        is_exchanged &= (own[:, None] > FAR * apart) & (own[None] > FAR * apart)
    pairs = np.argwhere(np.triu(is_exchanged, 1))
    return [(int(one), int(other)) for one, other in pairs]


RAISED = np.radians(110.0)
"""d between the hanging arm and one raised by 115 degrees, where the scapula has turned by 50. Errors are published for
raises of 100 to 150 degrees."""


@dataclass(frozen=True, eq=False)
class PostureErrors:
    """Standard deviations of markers and of the targets of coordinates, √(at_rest² + (raised d / RAISED)²) with d from
    the model's default posture.

    markers (2, markers) at_rest and raised, along each axis [m];  targets (2, coordinates) alike [rad]
    trunk, bodies  whose orientations make d;  resting (features,) theirs in that posture
    """

    markers: Array
    targets: Array
    trunk: int
    bodies: tuple[int, ...]
    resting: Array

    def for_markers(self, chosen: Sequence[int]) -> PostureErrors:
        """Of some of the markers, by their places."""
        return replace(self, markers=self.markers[:, list(chosen)])

    def at(self, rotations: Array) -> tuple[Array, Array]:
        """Of markers (markers,) and targets (coordinates,), from rotations (bodies, 3, 3) to ground of a posture."""
        apart = orientations_in_trunk(rotations[None], self.trunk, self.bodies)[0] - self.resting
        part = float(np.linalg.norm(apart)) / RAISED
        return np.hypot(self.markers[0], part * self.markers[1]), np.hypot(self.targets[0], part * self.targets[1])


def posture_errors(
    model: Model, markers: Sequence[Marker], placed: Array, slide: Array, targets: Array | None = None
) -> PostureErrors:
    """placed, slide (markers,) [m]: of where a marker was put, and of the skin that slides when the arm is raised;
    targets (2, coordinates) [rad], 0 by default.
    """
    trunk, bodies = trunk_and_bodies(model, markers)
    default = model.default_coordinates[None]
    rotations = postures(model, default, np.zeros_like(default)).rotation_to_ground
    none = np.zeros((2, len(model.coordinates)))
    return PostureErrors(
        np.array([placed, slide]),
        none if targets is None else targets,
        trunk,
        bodies,
        orientations_in_trunk(rotations, trunk, bodies)[0],
    )


def trunk_and_bodies(model: Model, markers: Sequence[Marker]) -> tuple[int, tuple[int, ...]]:
    """The body that is jointed to ground, and the others with markers."""
    trunk = next(joint.child for joint in model.joints if joint.parent == GROUND)
    return trunk, tuple(sorted({marker.body for marker in markers} - {trunk, GROUND}))


def orientations_in_trunk(rotations: Array, trunk: int, bodies: tuple[int, ...]) -> Array:
    """(frames, features) of bodies in the trunk, from rotations (frames, bodies, 3, 3) to ground."""
    turned = np.swapaxes(rotations[:, [trunk]], 2, 3) @ rotations[:, list(bodies)]
    return np.asarray(turned.reshape(len(rotations), -1) / np.sqrt(2.0))
