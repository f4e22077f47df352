"""The live process of a trial, started by the recorder's LiveTap.

The first message is the request (LiveRequest); then come those of the recording (tap.py). Views connect to the address
in the session's folder. The process ends with the recorder; nothing that happens here reaches it. Compiled functions
and the solver's memory are loaded before the first frame.
"""

from __future__ import annotations

import os
import sys
import threading
from collections import deque
from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from documents.message import Message
from recordings.samples import Samples, Stream
from recordings.topics import MARKERS
from solver.inverse_kinematics.solve import assemble
from solver.multibody.postures import points_in_ground, postures
from solver.stream.stream_solver import StreamSolver
from station.child import ProcessLink
from station.live.engine import LiveEngine, LiveSink, Publish
from station.live.outlet import LslOutlet, ResultFile
from station.live.pipeline import LivePlan, PreparedTrial, prepare_trial
from station.live.published import LiveSetup
from station.live.subscription import serve_views
from station.live.tap import REQUEST, FedMessage, decode
from station.messages.live_messages import LiveCode

NICENESS = 5
"""The recorder has priority."""
FRAMES, INTERVAL_S = 40, 0.01


def main(recorder: ProcessLink) -> None:
    if hasattr(os, "nice"):
        os.nice(NICENESS)
    first = recorder.receive_bytes()
    if first is None:
        return
    request, inbox = REQUEST.validate_json(first), FedMessages()
    threading.Thread(target=inbox.fill, args=(iter(recorder.receive_bytes, None),), name="feed", daemon=True).start()
    config, folder = request.config, request.folder
    prepared = prepare_trial(config, folder, request.spec, request.before_utc_ns)
    warm_up(prepared.plan)
    with ExitStack() as stack:
        file = ResultFile(config.live)
        sinks: list[LiveSink] = [file] if config.live.writes_file else []
        if config.live.outlet:
            sinks.append(LslOutlet(config.live.outlet_name, config.live.outlet))
        engine = make_engine(stack, prepared, folder, inbox, sinks)
        engine.discarded = inbox.open()
        has_ended = run(engine, inbox)
        path = file.path
        file.close("the trial has ended" if has_ended else "the recorder has ended", has_ended=has_ended)
    if path is not None and path.exists():
        print(Message(LiveCode.WRITTEN, {"path": str(path)}), file=sys.stderr, flush=True)


@dataclass
class FedMessages:
    """Messages that have arrived. Until open(), samples are discarded and frames among them counted."""

    _messages: deque[FedMessage] = field(default_factory=deque)
    _has_more: threading.Condition = field(default_factory=threading.Condition)
    _is_open: bool = False
    _is_over: bool = False
    _discarded: int = 0
    waiting: int = 0
    """Blocks of frames among the messages."""

    def fill(self, messages: Iterable[bytes]) -> None:
        try:
            for message in messages:
                self.put(decode(message))
        finally:
            with self._has_more:
                self._is_over = True
                self._has_more.notify()

    def put(self, message: FedMessage) -> None:
        samples = message.content if isinstance(message.content, Samples) else None
        frames = len(samples.device_time_ns) if samples is not None and samples.stream == MARKERS else 0
        with self._has_more:
            if samples is not None and not self._is_open:
                self._discarded += frames
                return
            self.waiting += frames > 0
            self._messages.append(message)
            self._has_more.notify()

    def open(self) -> int:
        """Keep samples from now on; returns the number of frames that were discarded."""
        with self._has_more:
            self._is_open = True
            return self._discarded

    def get(self) -> FedMessage | None:
        """The next message, once there is one; None at the end."""
        with self._has_more:
            self._has_more.wait_for(lambda: self._messages or self._is_over)
            if not self._messages:
                return None
            message = self._messages.popleft()
            self.waiting -= isinstance(message.content, Samples) and message.content.stream == MARKERS
            return message


def make_engine(
    stack: ExitStack, prepared: PreparedTrial, folder: Path, inbox: FedMessages, sinks: Sequence[LiveSink]
) -> LiveEngine:
    """An engine whose values go to views that connect; the address is announced once the markers are known."""

    def serve(setup: LiveSetup) -> Publish:
        def take_command(command: dict[str, Any]) -> None:
            inbox.put(FedMessage({"rest_length": command}, 0.0))

        return serve_views(stack, setup, folder, take_command)

    return LiveEngine(prepared, on_setup=serve, sinks=sinks)


def run(engine: LiveEngine, inbox: FedMessages) -> bool:
    """Handle messages until the end; returns whether the recorder has ended the trial before its own end."""
    has_ended = False
    while (message := inbox.get()) is not None:
        match message.content:
            case Stream() as stream:
                engine.describe(stream)
            case Samples() as samples:
                engine.take(samples, message.arrival_s, is_newest=inbox.waiting == 0)
            case {"rest_length": {"scenario": str(name), "rest_length_m": float(length)}}:
                engine.set_rest_length(name, length)
            case {"origin": str(origin)}:
                engine.origin = origin
            case {"begins": True, "recording": str(path)}:
                engine.begin_recording(Path(path))
            case {"ends": True}:
                has_ended = True
            case {"dropped": int(count)}:
                engine.dropped_before = count
    engine.finish()
    return has_ended


def warm_up(plan: LivePlan) -> None:
    """Solve some frames of the model at rest with a solver that is thrown away."""
    model, tasks = plan.body.model, plan.body.tasks
    if not tasks.markers:
        return
    posture = assemble(model)[None]
    state = postures(model, posture, np.zeros_like(posture))
    places = np.array([points_in_ground(state, marker.body, marker.location)[0] for marker in tasks.markers])
    solver = StreamSolver(model, tasks, plan.scenarios, suit=plan.body.suit, lag_s=plan.lag_s)
    for frame in range(FRAMES):
        solver.push(frame * INTERVAL_S, places)
    solver.finish()
