"""Samples in, live values out: the same in live operation and in replay, to the bit, as no clock is read here.

Signals of the DAQ and of the EMG amplifier are taken at the times of camera frames, by the arrival of both at the
station. The effort is summed per arm cycle, and gives the best rest length of the motion so far.

Configuration and session determine what is solved in a trial.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from documents.message import Figures, Message, because
from fitting.trial.analog_signals import VOLTS
from fitting.wearer.wearer_trial import CycleDetector, elevation_from_markers
from recordings.manifest import BodyMarkers, EmgAmplifier, LoadCell
from recordings.samples import Samples, Stream
from recordings.topics import EMG, FORCE, MARKERS
from solver.inverse_kinematics.marker_fit import rotation_laboratory_to_ground
from solver.stream.frame_muscles import StreamScenario
from solver.stream.stream_frame import StreamFrame, StreamSuitFrame
from solver.stream.stream_solver import StreamSolver
from solver.suit.scenarios import find_minimum
from solver.suit.suit import suit_toml
from station.clock import ArrivalClock
from station.config import LiveSection, StationConfig
from station.errors import StationError
from station.kinematics.marker_checks import LEAST_SEEN, ensure_markers_fit
from station.live.body import UNUSABLE, LiveBody, live_body, live_scenarios
from station.live.published import (
    NAN,
    LiveBest,
    LiveRecent,
    LiveScenario,
    LiveScenarioValues,
    LiveSetup,
    LiveSubject,
    LiveValues,
)
from station.messages.live_messages import LiveCode
from station.protocol import BODY_TESTS, TrialSpec

Array = NDArray[np.float64]

LEAST_MARKERS = 3
MM = 1e-3
RATE_TOLERANCE = 0.01
"""Cameras that send 1 % more than the highest rate are not decimated."""
RETRY_S = 0.5
"""Camera seconds until markers that did not fit the body are compared with it again."""


@dataclass(frozen=True, eq=False)
class LivePlan:
    """Body and scenarios that are solved. cell is the load cell in the cord; markers are those of the configuration."""

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
        self.rest_lengths = {name: scenario.rest_length for name, scenario in self.plan.scenarios.items()}
        self.restart()

    @property
    def solver(self) -> StreamSolver | None:
        """None before the first frame whose markers fit the body."""
        return self._solver

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
        self.rest_lengths[scenario] = rest_length_m
        self._cycles.restart()
        self._recent = self._best = None

    def add_signal(self, samples: Samples) -> None:
        """Take a block of force or EMG; other streams are ignored."""
        if samples.stream == FORCE and self.plan.cell is not None:
            self._force.add(samples)
        elif samples.stream == EMG:
            self._emg.add(samples)

    def read_frames(self, samples: Samples) -> Iterator[tuple[int, int, float, Array]]:
        """(number, device time [ns], host time [s], places (labels, 3) [mm]) of the frames of a block to be solved."""
        if samples.values.shape[1] != len(self._labels):
            return
        times = 1e-9 * self._clock.update(samples) if len(samples.device_time_ns) else np.zeros(0)
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
        tasks, columns, errors = self.plan.body.tasks_for(self._labels)
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
            self.refusal = Message(LiveCode.NO_FIT, because(error))
            self._retry_ns = device_ns + int(1e9 * RETRY_S)
            return False
        self.refusal, self._columns, self._rotation, self._first_ns = None, columns, rotation, device_ns
        suit, lag_s = self.plan.body.suit, self.plan.lag_s
        self._solver = StreamSolver(model, tasks, self.plan.scenarios, suit=suit, lag_s=lag_s, errors=errors)
        for name, length in self.rest_lengths.items():
            if length != self.plan.scenarios[name].rest_length:
                self._solver.set_rest_length(name, length)
        return True

    def _elevation(self, places: Array) -> float:
        """Elevation of the arm [rad]; NaN without markers for it."""
        markers = self.plan.markers
        angle = elevation_from_markers(places[None], self._labels, markers.arm, markers.trunk) if markers else None
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
            name: self.rest_lengths[name]
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


KEPT_S = 1.0
RMS_WINDOW_S = 0.1


class AlignedSignal:
    """The last KEPT_S seconds of a signal."""

    def __init__(self) -> None:
        self._clock = ArrivalClock()
        self._times = np.zeros(0)
        self._values = np.zeros((0, 0))

    def add(self, samples: Samples) -> None:
        if not len(samples.device_time_ns):
            return
        times, values = 1e-9 * self._clock.update(samples), samples.values.astype(np.float64)
        if values.shape[1] != self._values.shape[1]:
            self._times, self._values = np.zeros(0), np.zeros((0, values.shape[1]))
        times = np.concatenate([self._times, times])
        kept = times > times[-1] - KEPT_S
        self._times, self._values = times[kept], np.concatenate([self._values, values])[kept]

    def at(self, host_s: float) -> Array | None:
        """(channels,) interpolated; None where no samples have arrived for this time."""
        if not len(self._times) or not self._times[0] <= host_s <= self._times[-1]:
            return None
        return np.array([np.interp(host_s, self._times, column) for column in self._values.T])

    def rms_until(self, host_s: float) -> Array | None:
        """(channels,) RMS about the mean of the RMS_WINDOW_S before this time; None where they have not arrived."""
        if not len(self._times) or not self._times[0] <= host_s <= self._times[-1]:
            return None
        window = self._values[(self._times > host_s - RMS_WINDOW_S) & (self._times <= host_s)]
        return np.asarray(window.std(axis=0)) if len(window) > 1 else None


RECENT_CYCLES = 3
LEAST_RAISE = 0.5
"""Of the highest raise so far; lower ones are attempts, as in find_cycles."""
LONGEST_CYCLE_S = 60.0
LEAST_LENGTHS = 3
SLACK = "slack"


class CycleEffort:
    """Mean effort of every scenario from one peak of the arm to the next; efforts are over that of the slack suit."""

    def __init__(self, scenarios: Sequence[str]) -> None:
        self._names = tuple(scenarios)
        self._detector = CycleDetector()
        self._frames: deque[tuple[float, Array]] = deque()
        self._turns = 0
        self.cycles: list[Array] = []

    def add(self, time_s: float, elevation: float, effort: Mapping[str, float]) -> bool:
        """Take a frame; returns whether a cycle has ended. Efforts are NaN where a scenario has no solution."""
        self._frames.append((time_s, np.array([effort.get(name, np.nan) for name in self._names])))
        while self._frames[0][0] < time_s - LONGEST_CYCLE_S:
            self._frames.popleft()
        self._detector.update([time_s], [elevation])
        turns = self._detector.turns
        if len(turns) == self._turns:
            return False
        self._turns = len(turns)
        return len(turns) > 1 and self._end_cycle(turns[-2], turns[-1])

    def restart(self) -> None:
        """Forget the cycles: they were with another rest length."""
        self.cycles.clear()
        self._frames.clear()

    def recent(self) -> LiveRecent | None:
        """Of the last cycles; None before the first has ended."""
        if not self.cycles:
            return None
        recent = self.cycles[-RECENT_CYCLES:]
        mean = np.mean(recent, axis=0)
        return LiveRecent(len(recent), {name: float(value) for name, value in zip(self._names, mean, strict=True)})

    def best(self, rest_lengths: Mapping[str, float]) -> LiveBest | None:
        """Over these scenarios, which differ in their rest length only; None for fewer than three or no cycle."""
        by_length = {length: name for name, length in rest_lengths.items()}
        lengths = np.array(sorted(by_length))
        names = [by_length[length] for length in lengths.tolist()]
        if len(lengths) < LEAST_LENGTHS or not self.cycles:
            return None
        costs = np.array(self.cycles)[:, [self._names.index(name) for name in names]]
        pooled = find_minimum(lengths, costs.mean(axis=0))
        if pooled.edge:
            end = -1 if pooled.edge > 0 else 0
            return LiveBest(float(lengths[end]), NAN, float(costs.mean(axis=0)[end]), len(costs), pooled.edge)
        minima = [_lowest(lengths, cost) for cost in costs]
        spread = float(np.std(minima, ddof=1)) if len(minima) > 1 else NAN
        return LiveBest(pooled.rest_length, spread, pooled.cost, len(costs))

    def _end_cycle(self, before: tuple[float, ...], last: tuple[float, ...]) -> bool:
        """Keep the mean of the cycle between two peaks, if every scenario has a solution in it."""
        raises = [peak - valley for _, valley, _, peak in self._detector.turns]
        if min(raises[-2:]) < LEAST_RAISE * max(raises):
            return False
        inside = [effort for time_s, effort in self._frames if before[2] <= time_s < last[2]]
        if not inside:
            return False
        solved = np.array([effort for effort in inside if np.isfinite(effort).all()])
        if len(solved) < 0.5 * len(inside):
            return False
        mean = solved.mean(axis=0)
        self.cycles.append(mean / mean[self._names.index(SLACK)])
        return True


def _lowest(lengths: Array, cost: Array) -> float:
    """Best rest length of one cycle [m]; at the edge the one that was tried there."""
    found = find_minimum(lengths, cost)
    return float(lengths[np.argmin(cost)]) if found.edge else found.rest_length


@dataclass(frozen=True, eq=False)
class PreparedTrial:
    """A plan with the names of its scenarios, and what an operator must know of it."""

    trial: str
    plan: LivePlan
    settings: LiveSection
    scenarios: tuple[LiveScenario, ...]
    findings: tuple[Message[LiveCode], ...]

    def setup(self, labels: tuple[str, ...], rate_hz: float, origin: str, emg: tuple[str, ...] = ()) -> LiveSetup:
        """For these markers of the cameras."""
        body = self.plan.body
        tasks, *_ = body.tasks_for(labels)
        return LiveSetup(
            trial=self.trial,
            subject=LiveSubject(body.name, is_scaled=body.is_scaled, model_osim=body.osim_text),
            coordinates=body.model.coordinate_names,
            muscles=body.model.muscle_names,
            markers=tuple(marker.name for marker in tasks.markers),
            scenarios=self.scenarios,
            lag_s=self.plan.lag_s,
            frame_rate_hz=rate_hz,
            emg_channels=emg,
            has_glenoid=body.has_glenoid,
            has_cord_cell=self.plan.cell is not None,
            origin=origin,
            suit_toml=suit_toml(body.suit),
        )


def can_be_solved(spec: TrialSpec) -> bool:
    """Whether the trial has markers on the wearer's body."""
    return spec.test in BODY_TESTS


def prepare_trial(config: StationConfig, folder: Path, spec: TrialSpec, before_utc_ns: int) -> PreparedTrial:
    """Raises SolverError for a model or a suit of [live] that cannot be read."""
    settings = config.live
    body = live_body(folder, settings, before_utc_ns)
    findings = list(body.findings)
    scenarios, described = _scenarios(folder, config, body, findings)
    subject = config.subject(spec)
    markers = subject if isinstance(subject, BodyMarkers) else None
    plan = LivePlan(
        body=body,
        scenarios=scenarios,
        lag_s=settings.lag_s,
        highest_rate_hz=float(settings.highest_rate_hz),
        markers=markers,
        cell=config.calibration() if markers is not None and markers.is_cord_measured else None,
        emg=config.emg.amplifier() if config.emg is not None else None,
    )
    return PreparedTrial(spec.title, plan, settings, described, tuple(findings))


def _scenarios(
    folder: Path, config: StationConfig, body: LiveBody, findings: list[Message[LiveCode]]
) -> tuple[dict[str, StreamScenario], tuple[LiveScenario, ...]]:
    try:
        return live_scenarios(folder, config.live, body)
    except UNUSABLE as error:
        findings.append(Message(LiveCode.NO_CUFFS, because(error)))
        return live_scenarios(None, config.live.without_cuffs(), body)
