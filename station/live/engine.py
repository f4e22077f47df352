"""The messages of a trial → published values: pipeline, pace, findings and sinks, in live operation and in replay.

If the computer is too slow, first the muscles of some frames are left out, then whole frames. Findings for the operator
last a second, so that they can be read.

A recorded trial is solved as it would have been solved live: same code, same input, same values to the bit.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from queue import SimpleQueue
from typing import Protocol

from documents.message import Message, because
from recordings.reader import Recording, open_recording
from recordings.samples import Event, Samples, Stream
from recordings.topics import EMG, MARKERS
from solver.errors import SolverError
from solver.stream.stream_frame import StreamNotice, StreamOutcome, StreamSuitOutcome
from station.config import LiveSection, parse_config
from station.errors import StationError
from station.live.pipeline import NOT_SOLVED, LivePipeline, PreparedTrial, can_be_solved, prepare_trial
from station.live.published import NAN, LiveDelivery, LiveFinding, LiveSetup, LiveUpdate, LiveValues
from station.live.subscription import serve_views
from station.messages.live_messages import LiveCode
from station.protocol import TrialSpec

IDLE_S = 0.5
"""Seconds without values after which the views get an update without values, with the reason."""
RATE_WINDOW = 50
"""Frames over which the rate of solved frames is counted."""
Publish = Callable[[LiveUpdate], None]
MOST_LATENCY_S = 0.025
"""From the arrival of a frame to the start of its solution; above it the muscles are solved in fewer frames."""
DROP_LATENCY_S = 0.1
"""Above it frames are dropped until the newest one."""
LARGEST_EVERY = 16
SLOW_DOWN_S, SPEED_UP_S = 0.3, 3.0
"""Least time between two changes of pace: the effect of a change must show before the next."""
SHOWN_S = 1.0
LEFT_S = 0.5
"""Without any marker, until the wearer counts as outside the volume."""
LEAST_UNSOLVED = 0.1
"""Of the frames of the last second."""
UNSOLVED = (StreamOutcome.NOT_CONVERGED, StreamOutcome.GAP_OPEN)
UNSOLVED_MUSCLES = (
    StreamSuitOutcome.INFEASIBLE,
    StreamSuitOutcome.NOT_CONVERGED,
    StreamSuitOutcome.NOT_FINITE,
    StreamSuitOutcome.CUFF_NOT_AT_REST,
)


class LiveSink(Protocol):
    """Takes every value: a file, an outlet. May raise OSError or StationError, after which it is given no more."""

    def begin(self, setup: LiveSetup) -> None: ...

    def begin_recording(self, recording: Path) -> None: ...

    def write(self, values: LiveValues, delivery: LiveDelivery) -> None: ...

    def note(self, kind: str, text: str) -> None: ...


class LiveEngine:
    """One trial. now_s is the monotonic clock of the computer; a replay gives a constant one."""

    def __init__(
        self,
        prepared: PreparedTrial,
        *,
        on_setup: Callable[[LiveSetup], Publish | None] = lambda _: None,
        sinks: Sequence[LiveSink] = (),
        now_s: Callable[[], float] = time.perf_counter,
        unix_s: Callable[[], float] = time.time,
    ) -> None:
        self._prepared, self._on_setup, self._sinks = prepared, on_setup, list(sinks)
        self._now_s, self._unix_s = now_s, unix_s
        self.pipeline = LivePipeline(prepared.plan)
        self.pace = Pace()
        self.origin = "unknown"  # measured or simulated, as the devices report
        self.setup: LiveSetup | None = None
        self._publish: Publish | None = None
        self._findings = LiveFindings(0, prepared.findings)
        self._problems: list[Message[LiveCode]] = []
        self._emg_labels: tuple[str, ...] = ()
        self._scenarios = prepared.scenarios
        self.solved = 0
        self.discarded = 0  # frames, while the body was prepared
        self.dropped_before = 0  # frames, on their way here
        self._latency_s = 0.0
        self._published_s = float("-inf")
        self._has_notices = False
        self._recent_s: list[float] = []

    @property
    def dropped(self) -> int:
        return self.pace.dropped + self.discarded + self.dropped_before

    def begin_recording(self, recording: Path | None) -> None:
        """The sync edge: values are those of the frames after it, as a replay of the recording has no others."""
        self.pipeline.restart()
        self._findings, self._has_notices = LiveFindings(self._markers, self._lasting), False
        if recording is not None:
            self._to_sinks(lambda sink: sink.begin_recording(recording))
        for now, planned in zip(self._scenarios, self._prepared.scenarios, strict=True):
            if now != planned:
                self._note_rest_length(now.name, now.rest_length_m)

    def describe(self, stream: Stream) -> None:
        self.pipeline.describe(stream)
        if stream.name == EMG:
            self._emg_labels = stream.labels
        if stream.name == MARKERS and self.setup is None:
            self.setup = self._prepared.setup(stream.labels, stream.rate_hz, self.origin, self._emg_labels)
            self._findings = LiveFindings(self._markers, self._lasting)
            self._publish = self._on_setup(self.setup)
            setup = self.setup
            self._to_sinks(lambda sink: sink.begin(setup))

    def take(self, samples: Samples, arrival_s: float, *, is_newest: bool = True) -> None:
        """A block of samples that arrived at arrival_s; is_newest: no other frames wait."""
        if samples.stream != MARKERS:
            self.pipeline.add_signal(samples)
            return
        frames = list(self.pipeline.read_frames(samples))
        for place, frame in enumerate(frames):
            now_s = self._now_s()
            latency_s = now_s - arrival_s
            if self.pace.drops(now_s, latency_s, is_newest=is_newest and place == len(frames) - 1):
                continue
            solves = self.pace.solves_muscles(now_s, latency_s)
            self._give_out(self.pipeline.push(*frame, solve_muscles=solves), frame[1], arrival_s)
        if self._now_s() - self._published_s > IDLE_S:
            self._offer(None, self._delivery(NAN))

    def set_rest_length(self, scenario: str, rest_length_m: float) -> None:
        """Unknown scenarios and lengths that are none are ignored: they come from a view."""
        try:
            self.pipeline.set_rest_length(scenario, rest_length_m)
        except (KeyError, ValueError, SolverError):
            return
        self._scenarios = tuple(
            replace(one, rest_length_m=rest_length_m) if one.name == scenario else one for one in self._scenarios
        )
        self._note_rest_length(scenario, rest_length_m)

    def finish(self) -> None:
        """Give out the frames whose lag has not elapsed."""
        self._give_out(self.pipeline.finish(), None, self._now_s())

    def _note_rest_length(self, scenario: str, rest_length_m: float) -> None:
        self._to_sinks(lambda sink: sink.note("rest_length", f"{scenario}: {rest_length_m:.4f} m"))

    @property
    def _markers(self) -> int:
        return len(self.setup.markers) if self.setup else 0

    @property
    def _lasting(self) -> list[Message[LiveCode]]:
        solver = self.pipeline.solver
        notices = notice_messages(self._prepared.plan.body.name, solver.notices) if solver else []
        return [*self._prepared.findings, *notices]

    def _give_out(self, ready: Sequence[LiveValues], newest_ns: int | None, arrival_s: float) -> None:
        if ready and not self._has_notices:
            self._has_notices, self._findings = True, LiveFindings(self._markers, self._lasting)
        for values in ready:
            self._findings.add(values)
            self.solved += 1
            self._recent_s = [*self._recent_s[-RATE_WINDOW:], values.time_s]
            lag_s = 0.0 if newest_ns is None else self.pipeline.seconds(newest_ns) - values.time_s
            self._latency_s = self._now_s() - arrival_s
            delivery = self._delivery(lag_s + self._latency_s)
            self._to_sinks(lambda sink, one=values, how=delivery: sink.write(one, how))  # type: ignore[misc]
            if self.pace.every == 1 or not _lacks_muscles(values):
                self._offer(values, delivery)

    def _delivery(self, age_s: float) -> LiveDelivery:
        span_s = self._recent_s[-1] - self._recent_s[0] if len(self._recent_s) > 1 else NAN
        return LiveDelivery(
            published_s=self._unix_s(),
            age_s=age_s,
            latency_s=self._latency_s,
            solved_frames=self.solved,
            dropped_frames=self.dropped,
            every=self.pipeline.every * self.pace.every,
            solved_hz=(len(self._recent_s) - 1) / span_s / self.pace.every if span_s else NAN,
        )

    def _offer(self, values: LiveValues | None, delivery: LiveDelivery) -> None:
        self._published_s = self._now_s()
        if self._publish is not None:
            self._publish(LiveUpdate(values, delivery, self._shown(delivery), self._scenarios))

    def _shown(self, delivery: LiveDelivery) -> tuple[LiveFinding, ...]:
        messages = [*self._problems]
        if self.pipeline.refusal is not None:
            messages.append(self.pipeline.refusal)
        rate_hz = self.setup.frame_rate_hz if self.setup else NAN
        if self.pipeline.every > 1:
            figures = {"rate_hz": rate_hz, "every": float(self.pipeline.every)}
            messages.append(Message(LiveCode.DECIMATED, {**figures, "solved_hz": rate_hz / self.pipeline.every}))
        if self.pace.every > 1 or self.pace.has_dropped_lately(self._now_s()):
            figures = {"every": float(delivery.every), "solved_hz": delivery.solved_hz, "dropped": float(self.dropped)}
            messages.append(Message(LiveCode.OVERLOADED, figures))
        return (*self._findings.shown(), *live_findings(messages))

    def _to_sinks(self, act: Callable[[LiveSink], None]) -> None:
        """A sink that fails is left out from then on; the other sinks get the values."""
        for sink in tuple(self._sinks):
            try:
                act(sink)
            except OSError as error:
                self._sinks.remove(sink)
                self._problems.append(Message(LiveCode.NO_FILE, because(error)))
            except StationError as error:
                self._sinks.remove(sink)
                self._problems.append(Message(LiveCode.NO_OUTLET, because(error)))


def _lacks_muscles(values: LiveValues) -> bool:
    """Whether the muscles of this frame were left out; a view keeps those of an earlier one."""
    return math.isfinite(values.coordinates[0]) and any(one.outcome == NOT_SOLVED for one in values.scenarios)


class Pace:
    """Muscles are solved in one of every `every` frames. All times are seconds of one clock, which the caller reads."""

    def __init__(self) -> None:
        self.every = 1
        self.dropped = 0
        self._frames = 0
        self._changed_s = self._dropped_s = float("-inf")
        self._late_s = float("-inf")

    def drops(self, now_s: float, latency_s: float, *, is_newest: bool) -> bool:
        """Whether to drop a frame that has waited so long."""
        if latency_s <= DROP_LATENCY_S or is_newest:
            return False
        self.dropped, self._dropped_s = self.dropped + 1, now_s
        return True

    def has_dropped_lately(self, now_s: float) -> bool:
        return now_s - self._dropped_s < SPEED_UP_S

    def solves_muscles(self, now_s: float, latency_s: float) -> bool:
        """Whether to solve the muscles of the next frame."""
        if latency_s > MOST_LATENCY_S:
            self._late_s = now_s
            if now_s - self._changed_s >= SLOW_DOWN_S and self.every < LARGEST_EVERY:
                self.every, self._changed_s = 2 * self.every, now_s
        elif self.every > 1 and now_s - max(self._changed_s, self._late_s) >= SPEED_UP_S:
            self.every, self._changed_s = self.every // 2, now_s
        self._frames += 1
        return self._frames % self.every == 0


class LiveFindings:
    """Findings on the values of the last second, in the cameras' time."""

    def __init__(self, markers: int, lasting: Iterable[Message[LiveCode]] = ()) -> None:
        """lasting: findings on body and suit, which hold for the whole trial."""
        self._markers, self._lasting = markers, tuple(lasting)
        self._last: dict[LiveCode, tuple[float, Message[LiveCode]]] = {}
        self._frames: list[tuple[float, tuple[str, ...]]] = []
        self._seen_s: float | None = None
        self._now_s = 0.0

    def add(self, values: LiveValues) -> None:
        now = self._now_s = values.time_s
        if len(values.hidden) < self._markers or self._seen_s is None:
            self._seen_s = now
        if values.exchanged:
            pairs = ", ".join(" and ".join(pair) for pair in values.exchanged)
            self._note(Message(LiveCode.MARKERS_EXCHANGED, {"markers": pairs}))
        if values.left_out:
            self._note(Message(LiveCode.MARKERS_LEFT_OUT, {"markers": ", ".join(values.left_out)}))
        if values.lost:
            self._note(Message(LiveCode.NOT_HELD, {"coordinates": ", ".join(values.lost)}))
        failures = [values.outcome] if values.outcome in UNSOLVED else []
        failures += sorted({one.outcome for one in values.scenarios if one.outcome in UNSOLVED_MUSCLES})
        self._frames = [frame for frame in self._frames if frame[0] > now - SHOWN_S]
        self._frames.append((now, tuple(failures)))

    def shown(self) -> tuple[LiveFinding, ...]:
        """The findings that hold now."""
        away_s = 0.0 if self._seen_s is None else self._now_s - self._seen_s
        if away_s >= LEFT_S:
            left = Message(LiveCode.WEARER_LEFT, {"seconds": away_s})
            return live_findings([*self._lasting, left])
        current = [message for time_s, message in self._last.values() if time_s > self._now_s - SHOWN_S]
        return live_findings([*self._lasting, *current, *self._unsolved()])

    def _note(self, message: Message[LiveCode]) -> None:
        self._last[message.code] = self._now_s, message

    def _unsolved(self) -> list[Message[LiveCode]]:
        counts = Counter(failure for _, failures in self._frames for failure in failures)
        return [
            Message(LiveCode.UNSOLVED, {"frames": float(count), "of": float(len(self._frames)), "outcome": outcome})
            for outcome, count in counts.items()
            if count >= LEAST_UNSOLVED * len(self._frames)
        ]


def notice_messages(model: str, notices: Iterable[StreamNotice]) -> list[Message[LiveCode]]:
    codes = {StreamNotice.NO_GLENOID_CONE: LiveCode.NO_GLENOID, StreamNotice.NO_GLENOHUMERAL_JOINT: LiveCode.NO_JOINT}
    return [Message(codes[notice], {"model": model}) for notice in sorted(notices)]


def live_findings(messages: Iterable[Message[LiveCode]]) -> tuple[LiveFinding, ...]:
    return tuple(LiveFinding(message.code.value, str(message)) for message in messages)


class LiveRefused(StationError):
    """The recording cannot be solved live."""


def prepare_replay(path: Path, settings: LiveSection | None = None) -> tuple[Recording, PreparedTrial]:
    """The recording and what is solved, by its own configuration or other settings of [live].

    Raises LiveRefused for a trial without markers on a body.
    """
    recording = open_recording(path)
    manifest = recording.manifest
    spec = TrialSpec.of_recording(manifest)
    if not can_be_solved(spec):
        raise LiveRefused(Message(LiveCode.NO_BODY, {"path": str(path), "test": spec.test}))
    config = parse_config(manifest.effective_config, str(path))
    if settings is not None:
        config = config.model_copy(update={"live": settings})
    return recording, prepare_trial(config, path.parent, spec, manifest.start_utc_ns)


def replay_live(
    recording: Recording,
    prepared: PreparedTrial,
    *,
    on_setup: Callable[[LiveSetup], Publish | None] = lambda _: None,
    sinks: Sequence[LiveSink] = (),
    speed: float | None = None,
    commands: Callable[[LiveEngine], None] = lambda _: None,
) -> LiveEngine:
    """Solve all frames after the sync edge, speed times as fast as they arrived, None as fast as possible.

    commands is called before every block, to apply what views ask for.
    """
    engine = LiveEngine(prepared, on_setup=on_setup, sinks=sinks, now_s=lambda: 0.0)
    engine.origin = recording.manifest.origin.value
    begun_s, first_ns = time.perf_counter(), None
    for stream in sorted(recording.streams, key=lambda stream: stream.name == MARKERS):  # the set-up needs all
        engine.describe(stream)
    for item in recording.items():
        if isinstance(item, Stream):
            engine.describe(item)
        elif isinstance(item, Event) and item.kind == "sync_edge" and item.source == "station":
            engine.begin_recording(recording.path)
        elif isinstance(item, Samples):
            first_ns = item.host_time_ns if first_ns is None else first_ns
            if speed is not None:
                due_s = begun_s + 1e-9 * (item.host_time_ns - first_ns) / speed
                time.sleep(max(0.0, due_s - time.perf_counter()))
            commands(engine)
            engine.take(item, 0.0)
    engine.finish()
    return engine


def replay_and_publish(
    recording: Recording,
    prepared: PreparedTrial,
    folder: Path,
    *,
    sinks: Sequence[LiveSink] = (),
    speed: float | None = None,
) -> LiveEngine:
    """The same for views that connect to the address in this folder, as in live operation."""
    commands: SimpleQueue[dict[str, object]] = SimpleQueue()

    def apply_commands(engine: LiveEngine) -> None:
        while not commands.empty():
            match commands.get():
                case {"scenario": str(name), "rest_length_m": float(length)}:
                    engine.set_rest_length(name, length)

    with ExitStack() as stack:

        def serve(setup: LiveSetup) -> Publish:
            return serve_views(stack, setup, folder, commands.put)

        return replay_live(recording, prepared, on_setup=serve, sinks=sinks, speed=speed, commands=apply_commands)
