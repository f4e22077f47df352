"""The stream solver: markers in, posture, muscles and joint force out, frame by frame with a fixed lag.

    solver = StreamSolver(model, tasks, {"slack": StreamScenario(), "worn": StreamScenario(0.71)}, suit=suit)
    for time_s, positions in source:                      # (markers, 3) [m] in ground, in the order of tasks.markers
        for frame in solver.push(time_s, positions):      # usually one: the frame of lag_s ago
            print(frame.time_s, frame.outcome, frame.suits["worn"].effort)
    rest = solver.finish()

- A frame is given out as soon as a frame has been pushed that is at least lag_s later. Every pushed frame is given out
  once, in order; one whose time is refused is given out at once.
- Results depend on the pushed frames, times, rest lengths and skips only, to the bit: never on a clock.
- push(..., solve_muscles=False) leaves `suits` of the frames that this call gives out empty and takes about a tenth of
  the time; kinematics still use every frame. After skipped frames activations may change by as much as the time allows.
- set_rest_length acts from the next frame that is given out; the activations of the frame before do not limit it.
- A scenario that is None is the body without the suit; StreamScenario() is the suit with a slack cord.
- Exceptions are for a wrong call only (shapes, names); a bad frame is an outcome.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from solver.errors import SolverCode
from solver.inverse_kinematics.marker_fit import MarkerTracks, PostureErrors, exchanged_pairs, posture_errors
from solver.inverse_kinematics.solve import NOISE_GAIN, NOISE_STEP, NOISE_WEIGHTS, PostureOutcome, TrackingTasks
from solver.model import Array, Model, ModelError
from solver.personalisation.anthropometry import marker_errors
from solver.redundancy.effort import RedundancyOptions
from solver.stream.frame_muscles import FrameMuscles, StreamScenario
from solver.stream.lag_window import FramePosture, LagWindow, PostureTracker
from solver.stream.stream_frame import StreamFrame, StreamNotice, StreamOutcome, StreamSuitFrame
from solver.suit.suit import Suit

DEFAULT_LAG = 0.15
LARGEST_LAG = 0.5
"""s"""
SOFT_TISSUE_HZ = 2.0
"""Soft tissue moves at the frequencies of the movement (Leardini, Chiari, Della Croce and Cappozzo (2005), Gait Posture
21:212–225), which are assumed to be below 2 Hz: too slowly for the smoother to remove any of it."""
_SOFT_TISSUE_RATES = np.array([[(2 * np.pi * SOFT_TISSUE_HZ) ** k / np.sqrt(2 * k + 1)] for k in range(3)])
"""Standard deviation of the derivatives (3, 1) of a process of size 1 whose spectrum is flat up to SOFT_TISSUE_HZ."""

TRACK_MEMORY = 0.25
"""s; a marker that was hidden for longer has a new track, with the label that it comes with."""
JUMP = 0.05
"""m; no marker on a body leaves its extrapolated place by more between frames at 50 Hz or faster."""
LONGEST_EXTRAPOLATION = 0.05
"""s; over a longer gap a jump cannot be distinguished from motion."""
BACK_WITHIN = 0.03
"""m; a marker that was left out is used again when it is not farther from the model than before by more."""
NOISE_ORDER = len(NOISE_WEIGHTS) - 1
NOISE_MEMORY = 10.0
"""s; after which an observation has 1/e of its weight."""
ASSUMED_NOISE, ASSUMED_NOISE_FRAMES = 5e-4, 5
"""m; the noise that is assumed before markers are seen, and how many frames outweigh it."""
LEAST_NOISE = 5e-5
"""m; no camera system is taken to be better."""
LARGEST_NOISE_RATIO = 25.0
"""Mean sizes of a difference; a larger one is a jump."""
UNEVEN_INTERVAL = 0.2
"""Part of an interval by which the frames of a difference may be off an even grid."""


class StreamSolver:
    """Solves markers frame by frame; see the module's docstring.

    model      with or without a glenoid; notices lists missing parts
    tasks      markers and weights that the posture tracks, as for solve_inverse_kinematics
    scenarios  name → suit that is worn; None is the body without the suit
    suit       cord and masses of all scenarios
    lag_s      how far behind the markers results are [s], 0 to 0.5
    soft_tissue_m  standard deviation along each axis [m] of a marker's place on its body, one for all or (markers,); 0
               for markers on bone; None: that of errors
    errors     of a measured wearer (WearerMotion.errors); None: 4 to 10 mm of where a marker is put, and the skin that
               slides over the bone as the arm is raised (solver/personalisation/anthropometry.py)
    """

    def __init__(
        self,
        model: Model,
        tasks: TrackingTasks,
        scenarios: Mapping[str, StreamScenario | None],
        *,
        suit: Suit | None = None,
        options: RedundancyOptions | None = None,
        lag_s: float = DEFAULT_LAG,
        soft_tissue_m: ArrayLike | None = None,
        errors: PostureErrors | None = None,
    ) -> None:
        if not 0 <= lag_s <= LARGEST_LAG:
            raise ModelError(f"the lag should lie between 0 and {LARGEST_LAG:g} s and is {lag_s:g} s; choose another")
        self.model, self.tasks, self.lag_s = model, tasks, float(lag_s)
        self._names = tuple(marker.name for marker in tasks.markers)
        self._labels = MarkerLabels(len(self._names))
        self._noise = RunningMarkerNoise(len(self._names))
        self._tracker = PostureTracker(model, tasks, _errors(model, tasks, soft_tissue_m, errors))
        self._soft_tissue_variance = np.full(len(model.coordinates), np.nan)
        self._window = LagWindow(len(model.coordinates))
        self._muscles = FrameMuscles(model, scenarios, suit, options or RedundancyOptions())
        self._pending: list[_Pending] = []

    @property
    def notices(self) -> frozenset[StreamNotice]:
        """Results that the model cannot give, for the whole stream."""
        return self._muscles.notices

    @property
    def marker_noise_m(self) -> Array:
        """(markers,) standard deviation along an axis, as measured so far."""
        return self._noise.standard_deviation

    def set_rest_length(self, scenario: str, rest_length_m: float) -> None:
        """Change the rest length of a scenario from the next frame on. Raises SuitError for one without a suit."""
        self._muscles.set_rest_length(scenario, rest_length_m)

    def push(self, time_s: float, positions: ArrayLike, *, solve_muscles: bool = True) -> list[StreamFrame]:
        """Take a frame, positions (markers, 3) [m] in ground with NaN where hidden; return the frames that are ready.

        Raises ModelError for another shape.
        """
        observed = np.array(positions, dtype=np.float64)
        if observed.shape != (len(self._names), 3):
            raise ModelError(
                f"a frame should have positions of shape ({len(self._names)}, 3) and has {observed.shape}",
                SolverCode.WRONG_SHAPE,
            )
        if not (np.isfinite(time_s) and time_s > self._window.last_time):
            return [self._refused(time_s, np.asarray(np.isfinite(observed).all(axis=1)))]
        self._pending.append(self._track(float(time_s), observed))
        ready = []
        while self._window.is_ready(self.lag_s):
            ready.append(self._give_out(solve_muscles=solve_muscles))
        return ready

    def finish(self, *, solve_muscles: bool = True) -> list[StreamFrame]:
        """The frames whose lag has not elapsed, from the frames so far."""
        return [self._give_out(solve_muscles=solve_muscles) for _ in range(len(self._pending))]

    def _track(self, time: float, observed: Array) -> _Pending:
        observed[~np.isfinite(observed).all(axis=1)] = np.nan
        labelled = self._labels.take(time, observed)
        self._noise.add(time, labelled.positions)
        is_start = self._window.is_lost(time)
        noise = self._noise.standard_deviation
        posture = self._tracker.solve(time, labelled.positions, noise, is_start=is_start)
        lost = self._window.add(time, posture, float(np.sqrt(np.mean(noise**2))))
        if posture.outcome is PostureOutcome.SOLVED:
            self._labels.compare(posture.points)
        return _Pending(time, np.isnan(observed[:, 0]), labelled, posture, lost)

    def _give_out(self, *, solve_muscles: bool) -> StreamFrame:
        pending = self._pending.pop(0)
        smoothed = self._window.pop()
        suits: Mapping[str, StreamSuitFrame] = {}
        if smoothed is not None and solve_muscles:
            suits = self._muscles.solve(pending.time, smoothed.state, self._window.interval)
        nothing = np.full((3, len(self.model.coordinates)), np.nan)
        state, deviations = (smoothed.state, smoothed.standard_deviations) if smoothed else (nothing, nothing)
        if pending.posture.outcome is PostureOutcome.SOLVED:
            self._soft_tissue_variance = np.diagonal(pending.posture.soft_tissue_covariance)
        return StreamFrame(
            time_s=pending.time,
            outcome=_outcome(pending, has_state=smoothed is not None),
            coordinates=state[0],
            speeds=state[1],
            accelerations=state[2],
            standard_deviations=np.hypot(deviations, np.sqrt(self._soft_tissue_variance) * _SOFT_TISSUE_RATES),
            covariance=pending.posture.covariance + pending.posture.soft_tissue_covariance,
            marker_rms_m=_rms(pending.labelled.positions - pending.posture.points),
            hidden=self._named(pending.is_hidden),
            left_out=self._named(pending.labelled.is_left_out),
            exchanged=tuple((self._names[one], self._names[other]) for one, other in pending.labelled.exchanged),
            lost=tuple(np.array(self.model.coordinate_names)[pending.lost].tolist()),
            suits=suits,
        )

    def _named(self, is_meant: NDArray[np.bool_]) -> tuple[str, ...]:
        return tuple(name for name, meant in zip(self._names, is_meant, strict=True) if meant)

    def _refused(self, time: float, is_seen: NDArray[np.bool_]) -> StreamFrame:
        nothing = np.full((3, len(self.model.coordinates)), np.nan)
        return StreamFrame(
            time_s=time,
            outcome=StreamOutcome.TIME_NOT_LATER,
            coordinates=nothing[0],
            speeds=nothing[1],
            accelerations=nothing[2],
            standard_deviations=nothing,
            covariance=np.full((nothing.shape[1], nothing.shape[1]), np.nan),
            marker_rms_m=np.nan,
            hidden=self._named(~is_seen),
            left_out=(),
            exchanged=(),
            lost=(),
            suits={},
        )


@dataclass(frozen=True, eq=False)
class _Pending:
    """A frame whose lag has not elapsed. is_hidden (markers,), lost (coordinates,)."""

    time: float
    is_hidden: NDArray[np.bool_]
    labelled: LabelledFrame
    posture: FramePosture
    lost: NDArray[np.bool_]


def _errors(
    model: Model, tasks: TrackingTasks, soft_tissue_m: ArrayLike | None, errors: PostureErrors | None
) -> PostureErrors:
    """Raises ModelError for a negative or infinite size."""
    if soft_tissue_m is None:
        of_skin = marker_errors(model, tasks.markers)
        return errors or posture_errors(model, tasks.markers, of_skin.placement, of_skin.slide)
    stated = np.asarray(soft_tissue_m, dtype=np.float64)
    if stated.shape not in ((), (len(tasks.markers),)) or not (np.isfinite(stated) & (stated >= 0)).all():
        raise ModelError(
            f"soft_tissue_m should be one finite distance that is not negative, or one for each of the "
            f"{len(tasks.markers)} markers [m], and is {soft_tissue_m}",
            SolverCode.WRONG_NOISE,
        )
    everywhere = np.broadcast_to(stated, (len(tasks.markers),))
    return posture_errors(model, tasks.markers, everywhere, np.zeros(len(everywhere)))


_WITHOUT_POSTURE = {
    PostureOutcome.NO_MARKERS: StreamOutcome.NO_MARKERS,
    PostureOutcome.NOT_CONVERGED: StreamOutcome.NOT_CONVERGED,
    PostureOutcome.GAP_OPEN: StreamOutcome.GAP_OPEN,
}


def _outcome(pending: _Pending, *, has_state: bool) -> StreamOutcome:
    if pending.posture.outcome is not PostureOutcome.SOLVED:
        return StreamOutcome.INTERPOLATED if has_state else _WITHOUT_POSTURE[pending.posture.outcome]
    if pending.lost.any():
        return StreamOutcome.COORDINATES_LOST
    if pending.labelled.exchanged:
        return StreamOutcome.MARKERS_EXCHANGED
    return StreamOutcome.MARKER_LEFT_OUT if pending.labelled.is_left_out.any() else StreamOutcome.SOLVED


def _rms(residuals: Array) -> float:
    squares = (residuals[np.isfinite(residuals).all(axis=1)] ** 2).sum(axis=1)
    return float(np.sqrt(squares.mean())) if len(squares) else np.nan


@dataclass(frozen=True, eq=False)
class LabelledFrame:
    """positions (markers, 3) [m] with labels as they were before an exchange, NaN for hidden ones and those left out.

    exchanged (pairs of markers);  is_left_out (markers,)
    """

    positions: Array
    exchanged: tuple[tuple[int, int], ...]
    is_left_out: NDArray[np.bool_]


class MarkerLabels:
    """Labels of the markers: an exchange is corrected, and a marker that jumps is left out."""

    def __init__(self, markers: int) -> None:
        self._count = markers
        self._tracks = MarkerTracks(markers)
        self._frame = -1
        self._seen_at = np.full(markers, -np.inf)
        self._is_left_out = np.zeros(markers, dtype=np.bool_)
        self._usual = np.full(markers, np.inf)
        self._given = np.full((markers, 3), np.nan)

    def take(self, time: float, positions: Array) -> LabelledFrame:
        """The frame at time [s] with the labels put right."""
        self._frame += 1
        self._forget(time)
        expected = self._tracks.expected(self._frame)
        for pair in exchanged_pairs(positions[self._tracks.labels], expected):
            self._tracks.exchange(*pair)
        labels = self._tracks.labels
        places = positions[labels]
        is_seen = np.asarray(np.isfinite(places).all(axis=1))
        pairs = tuple((i, int(labels[i])) for i in range(self._count) if labels[i] > i)
        has_jumped = self._has_jumped(time, places, expected)
        self._given = places
        if 2 * has_jumped.sum() > is_seen.sum():  # not this body, or not its labels
            return LabelledFrame(np.full_like(places, np.nan), pairs, is_seen)
        self._is_left_out |= has_jumped
        for marker in np.flatnonzero(has_jumped).tolist():
            self._tracks.forget(marker)  # a jump is no speed
        self._tracks.add(self._frame, places)
        self._seen_at[is_seen] = time
        kept = np.where(self._is_left_out[:, None] | ~is_seen[:, None], np.nan, places)
        return LabelledFrame(kept, pairs, self._is_left_out & is_seen)

    def compare(self, points: Array) -> None:
        """Judge the markers that are left out by the model's points (markers, 3) [m] in this frame's posture."""
        with np.errstate(invalid="ignore"):
            away = np.linalg.norm(self._given - points, axis=1)
            self._is_left_out &= ~(away < self._usual + BACK_WITHIN)
        used = np.isfinite(away) & ~self._is_left_out
        self._usual[used] = away[used]

    def _forget(self, time: float) -> None:
        """Forget tracks of markers that were hidden for long; an exchange ends with the track of one of its markers."""
        is_old = time - self._seen_at > TRACK_MEMORY
        self._is_left_out &= ~is_old
        labels = self._tracks.labels
        for marker in np.flatnonzero(is_old).tolist():
            while (other := int(labels[marker])) != marker:  # all labels that were exchanged with it, in turn
                labels[marker], labels[other] = labels[other], other
                self._tracks.forget(other)
            self._tracks.forget(marker)

    def _has_jumped(self, time: float, places: Array, expected: Array) -> NDArray[np.bool_]:
        """(markers,) only of those that were seen so recently that motion is no explanation."""
        with np.errstate(invalid="ignore"):
            is_far = np.linalg.norm(places - expected, axis=1) > JUMP
        is_recent = (time - self._seen_at < LONGEST_EXTRAPOLATION) & self._tracks.is_extrapolated(self._frame)
        return np.asarray(is_far & is_recent)


class RunningMarkerNoise:
    """Standard deviation of the white noise of each marker, from the frames so far: from their sixth differences, as in
    solve.py, because it is measured while they move.
    """

    def __init__(self, markers: int) -> None:
        self._frames: deque[tuple[float, Array]] = deque()
        self._sum = np.full(markers, ASSUMED_NOISE_FRAMES * ASSUMED_NOISE**2)
        self._count = np.full(markers, float(ASSUMED_NOISE_FRAMES))

    @property
    def standard_deviation(self) -> Array:
        """(markers,) along each axis [m]."""
        deviation: Array = np.sqrt(self._sum / self._count)
        return np.maximum(deviation, LEAST_NOISE)

    def add(self, time: float, positions: Array) -> None:
        """Take a frame, positions (markers, 3) [m] with NaN where hidden; frames off an even grid do not count."""
        self._frames.append((time, positions))
        interval = self._interval()
        step = max(1, round(NOISE_STEP / interval)) if interval else 1
        while len(self._frames) > NOISE_ORDER * step + 1:
            self._frames.popleft()
        if len(self._frames) <= NOISE_ORDER * step:
            return
        chosen = [self._frames[k * step] for k in range(NOISE_ORDER + 1)]
        times = np.array([moment for moment, _ in chosen])
        grid = times[-1] - step * interval * np.arange(NOISE_ORDER, -1, -1)
        if np.abs(times - grid).max() > UNEVEN_INTERVAL * interval:
            return
        difference = np.tensordot(NOISE_WEIGHTS / NOISE_GAIN, np.array([places for _, places in chosen]), 1)
        square = (difference**2).mean(axis=1)
        with np.errstate(invalid="ignore"):
            counts = square <= LARGEST_NOISE_RATIO**2 * self._sum / self._count  # False for NaN
        kept = np.exp(-interval / NOISE_MEMORY)
        self._sum[counts] = kept * self._sum[counts] + square[counts]
        self._count[counts] = kept * self._count[counts] + 1.0

    def _interval(self) -> float:
        """Shortest of the last intervals [s]; 0 before there are any."""
        times = [time for time, _ in list(self._frames)[-5:]]
        return min((later - before for before, later in pairwise(times)), default=0.0)
