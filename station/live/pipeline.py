"""Samples in, live values out: the same in live operation and in replay, to the bit, as no clock is read here."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fitting.trial.analog_signals import VOLTS
from fitting.wearer.arm_cycles import elevation_of
from recordings.manifest import BodyMarkers, EmgAmplifier, LoadCell
from recordings.samples import Samples, Stream
from recordings.topics import EMG, FORCE, MARKERS
from solver.inverse_kinematics.marker_fit import rotation_laboratory_to_ground
from solver.stream.frame_muscles import StreamScenario
from solver.stream.stream_frame import StreamFrame, StreamSuitFrame
from solver.stream.stream_solver import StreamSolver
from station.errors import StationError
from station.kinematics.marker_checks import LEAST_SEEN, ensure_markers_fit
from station.live.aligned_signal import AlignedSignal, ArrivalClock
from station.live.body import LiveBody
from station.live.cycle_effort import CycleEffort
from station.live.published import (
    NAN,
    LiveBest,
    LiveRecent,
    LiveScenarioValues,
    LiveValues,
)
from station.messages.live_codes import LiveCode
from station.messages.message import Figures, Message

Array = NDArray[np.float64]

LEAST_MARKERS = 3
MM = 1e-3
RATE_TOLERANCE = 0.01
"""Cameras that send 1 % more than the highest rate are not decimated."""
RETRY_S = 0.5
"""Camera seconds until markers that did not fit the body are compared with it again."""


@dataclass(frozen=True, eq=False)
class LivePlan:
    """What is solved. cell is the load cell in the cord, None elsewhere; markers are those of the configuration."""

    body: LiveBody
    scenarios: Mapping[str, StreamScenario]
    lag_s: float
    highest_rate_hz: float
    markers: BodyMarkers | None = None
    cell: LoadCell | None = None
    emg: EmgAmplifier | None = None


class _Pushed(NamedTuple):
    """A frame that the solver has and has not given out."""

    time_s: float
    number: int
    host_s: float
    elevation: float


@dataclass
class LivePipeline:
    """One trial. every is the decimation of the cameras' frames; refusal says why there are no values, if so."""

    plan: LivePlan
    every: int = 1
    refusal: Message[LiveCode] | None = None
    _labels: tuple[str, ...] = ()
    _rate_hz: float = 0.0
    _emg_scale: Array = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        self._force, self._emg = AlignedSignal(), AlignedSignal()
        self._columns: list[int] = []
        self._rest_lengths = {name: scenario.rest_length for name, scenario in self.plan.scenarios.items()}
        self.restart()

    @property
    def solver(self) -> StreamSolver | None:
        """None before the first frame whose markers fit the body."""
        return self._solver

    @property
    def rest_lengths(self) -> Mapping[str, float]:
        return self._rest_lengths

    def seconds(self, device_ns: int) -> float:
        """Time from the first frame [s]."""
        return NAN if self._first_ns is None else 1e-9 * (device_ns - self._first_ns)

    def restart(self) -> None:
        """Forget all frames, and keep the rest lengths: the trial's recording begins, or another capture."""
        self._solver: StreamSolver | None = None
        self._rotation = np.eye(3)
        self._clock = ArrivalClock()
        self._pushed: deque[_Pushed] = deque()
        self._first_ns: int | None = None
        self._last_ns = -1
        self._retry_ns = -1
        self._cycles = CycleEffort(tuple(self.plan.scenarios))
        self._recent: LiveRecent | None = None
        self._best: LiveBest | None = None

    def describe(self, stream: Stream) -> None:
        """Take the labels and the rate of a stream; other labels of markers restart the solver."""
        if stream.name == MARKERS and (stream.labels, stream.rate_hz) != (self._labels, self._rate_hz):
            self._labels, self._rate_hz = stream.labels, stream.rate_hz
            self.every = max(1, math.ceil(stream.rate_hz / self.plan.highest_rate_hz - RATE_TOLERANCE))
            self.restart()
        elif stream.name == EMG:
            gains = self.plan.emg.gains if self.plan.emg else {}
            volts = VOLTS.get(stream.unit, NAN)
            self._emg_scale = np.array([1e6 * volts / gains.get(label, 1.0) for label in stream.labels])

    def set_rest_length(self, scenario: str, rest_length_m: float) -> None:
        """From the next frame on. Raises KeyError or ValueError for what has no cord, or no such length."""
        if not 0.0 < rest_length_m < float("inf") or self.plan.scenarios[scenario].rest_length == float("inf"):
            raise ValueError(scenario)
        if self._solver is not None:
            self._solver.set_rest_length(scenario, rest_length_m)
        self._rest_lengths[scenario] = rest_length_m
        self._cycles.restart()
        self._recent = self._best = None

    def add_signal(self, samples: Samples) -> None:
        """Take a block of force or EMG; other streams are ignored."""
        if samples.stream == FORCE and self.plan.cell is not None:
            self._force.add(samples)
        elif samples.stream == EMG:
            self._emg.add(samples)

    def frames_of(self, samples: Samples) -> Iterator[tuple[int, int, float, Array]]:
        """(number, device time [ns], host time [s], places (labels, 3) [mm]) of the frames of a block to be solved."""
        if samples.values.shape[1] != len(self._labels):
            return
        times = self._clock.times(samples) if len(samples.device_time_ns) else np.zeros(0)
        for k, number in enumerate(samples.sample_numbers.tolist()):
            if number % self.every == 0:
                yield number, int(samples.device_time_ns[k]), float(times[k]), samples.values[k, :, :3].astype(float)

    def push(
        self, number: int, device_ns: int, host_s: float, places: Array, *, solve_muscles: bool = True
    ) -> list[LiveValues]:
        """Take one frame; returns the values that are ready, usually those of the frame of lag_s ago."""
        if device_ns < self._last_ns:
            self.restart()  # another capture: its clock begins again
        if device_ns == self._last_ns:
            return []
        self._last_ns = device_ns
        if self._solver is None and not self._begin(device_ns, places):
            return []
        assert self._solver is not None  # noqa: S101  (_begin)
        observed = MM * places[self._columns] @ self._rotation.T
        time_s = self.seconds(device_ns)
        self._pushed.append(_Pushed(time_s, number, host_s, self._elevation(places)))
        return [self._values(frame) for frame in self._solver.push(time_s, observed, solve_muscles=solve_muscles)]

    def finish(self) -> list[LiveValues]:
        """The frames whose lag has not elapsed."""
        return [] if self._solver is None else [self._values(frame) for frame in self._solver.finish()]

    def _begin(self, device_ns: int, places: Array) -> bool:
        """Make the solver from the first frame whose markers fit the body."""
        tasks, columns = self.plan.body.tasks_for(self._labels)
        if len(columns) < LEAST_MARKERS:
            labels, body = ", ".join(self._labels), self.plan.body.name
            figures: Figures = {"labels": labels, "body": body, "known": float(len(columns))}
            self.refusal = Message(LiveCode.UNKNOWN_MARKERS, figures)
            return False
        seen = MM * places[columns][None]
        if np.isfinite(seen).all(axis=2).mean() < LEAST_SEEN or device_ns < self._retry_ns:
            self.refusal = self.refusal or Message(LiveCode.WAITING)
            return False
        model, vertical = self.plan.body.model, self.plan.body.vertical
        rotation = np.eye(3) if vertical == "y" else rotation_laboratory_to_ground(model, tasks.markers, seen, vertical)
        names = [marker.name for marker in tasks.markers]
        try:
            ensure_markers_fit(model, "the first frame", names, tasks, seen @ rotation.T)
        except StationError as error:
            self.refusal = Message(LiveCode.NO_FIT, {"reason": str(error)})
            self._retry_ns = device_ns + int(1e9 * RETRY_S)
            return False
        self.refusal, self._columns, self._rotation, self._first_ns = None, columns, rotation, device_ns
        self._solver = StreamSolver(model, tasks, self.plan.scenarios, suit=self.plan.body.suit, lag_s=self.plan.lag_s)
        for name, length in self._rest_lengths.items():
            if length != self.plan.scenarios[name].rest_length:
                self._solver.set_rest_length(name, length)
        return True

    def _elevation(self, places: Array) -> float:
        """Elevation of the arm [rad]; NaN without markers for it."""
        markers = self.plan.markers
        angle = elevation_of(places[None], self._labels, markers.arm, markers.trunk) if markers else None
        return NAN if angle is None else float(angle[0])

    def _values(self, frame: StreamFrame) -> LiveValues:
        pushed = self._pushed.popleft()
        effort = {name: suit.effort for name, suit in frame.suits.items() if suit.is_solved}
        if self._cycles.add(pushed.time_s, pushed.elevation, effort):
            self._recent, self._best = self._cycles.recent(), self._cycles.best(self._compared_lengths())
        force, emg = self._force.at(pushed.host_s), self._emg.rms_until(pushed.host_s)
        cell = self.plan.cell
        return LiveValues(
            time_s=frame.time_s,
            frame=pushed.number,
            outcome=frame.outcome,
            coordinates=_plain(frame.coordinates),
            speeds=_plain(frame.speeds),
            accelerations=_plain(frame.accelerations),
            scenarios=tuple(_scenario(frame.suits.get(name), self.plan.body) for name in self.plan.scenarios),
            hidden=frame.hidden,
            left_out=frame.left_out,
            exchanged=frame.exchanged,
            lost=frame.lost,
            cord_force_measured_n=(
                NAN if force is None or cell is None else cell.polarity * cell.newtons_per_unit * float(force[0])
            ),
            emg_rms_uv=() if emg is None else _plain(emg * self._emg_scale),
            recent=self._recent,
            best=self._best,
            host_time_s=pushed.host_s,
        )

    def _compared_lengths(self) -> dict[str, float]:
        """The scenarios that differ from the worn one in their rest length only."""
        worn = self.plan.scenarios.get("worn", self.plan.scenarios["rigid"])
        return {
            name: self._rest_lengths[name]
            for name, scenario in self.plan.scenarios.items()
            if scenario.rest_length != float("inf")
            and (scenario.condition, scenario.waist, scenario.arm) == (worn.condition, worn.waist, worn.arm)
        }


NOT_SOLVED = "not_solved"
"""Outcome of the muscles of a frame that was left out of them, because the computer is too slow."""


def _scenario(suit: StreamSuitFrame | None, body: LiveBody) -> LiveScenarioValues:
    if suit is None:
        nothing = (NAN,) * len(body.model.muscles)
        return LiveScenarioValues(NOT_SOLVED, NAN, NAN, nothing, NAN, (NAN,) * 3)
    return LiveScenarioValues(
        outcome=suit.outcome,
        effort=suit.effort,
        reserve_effort=suit.reserve_effort,
        activations=_plain(suit.activations),
        cord_force_n=suit.cord_force_n,
        joint_force_n=_plain(suit.glenohumeral_force_n),
    )


def _plain(values: Array | Sequence[float]) -> tuple[float, ...]:
    return tuple(np.asarray(values).tolist())
