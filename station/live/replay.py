"""Solve a recorded trial as it would have been solved live: same code, same input, same values to the bit."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from queue import SimpleQueue

from recordings.manifest import Manifest
from recordings.reader import Recording, open_recording
from recordings.samples import Event, Samples, Stream
from recordings.topics import MARKERS
from station.config import LiveSection, parse_config
from station.errors import StationError
from station.live.engine import LiveEngine, LiveSink, Publish
from station.live.plan import PreparedTrial, can_be_solved, prepare_trial
from station.live.published import LiveSetup
from station.live.server import serve_views
from station.messages.live_messages import LiveCode
from station.messages.message import Message
from station.protocol import TrialSpec


class LiveRefused(StationError):
    """The recording cannot be solved live."""


def prepare_replay(path: Path, settings: LiveSection | None = None) -> tuple[Recording, PreparedTrial]:
    """The recording and what is solved, by its own configuration or other settings of [live].

    Raises LiveRefused for a trial without markers on a body.
    """
    recording = open_recording(path)
    manifest = recording.manifest
    spec = spec_of(manifest)
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


def spec_of(manifest: Manifest) -> TrialSpec:
    cuff = manifest.cuff.name if manifest.cuff else None
    return TrialSpec(cuff, manifest.test, manifest.repeat, manifest.donning, condition=manifest.condition)
