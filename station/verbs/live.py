"""Verb `live`: watch the live values of a running trial, or solve a recorded one as if it were live."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from station.exit_code import DONE, LOSSY
from station.verbs.options import FormatOption, Rerun, Rrd, print_message

if TYPE_CHECKING:
    from station.child import Child
    from station.config import LiveSection
    from station.live.engine import LiveSink
    from station.viewer.live_scene import LiveScene


def live(
    source: Annotated[Path, typer.Argument(help="Folder of a session whose trial is running, or a recording.")],
    config: Annotated[
        Path | None, typer.Option(help="Take [live] from this configuration, not from the recording's.")
    ] = None,
    speed: Annotated[
        float | None,
        typer.Option(min=0.1, help="Replay at this multiple of real time, for views; default: as fast as possible."),
    ] = None,
    output: Annotated[Path | None, typer.Option(help="Write the live result of the recording to this folder.")] = None,
    page: Annotated[bool, typer.Option("--page", help="Serve the live page on this computer, until Ctrl-C.")] = False,
    port: Annotated[int, typer.Option(help="Port of the live page.")] = 8422,
    rrd: Rrd = None,
    rerun: Rerun = False,
    format: FormatOption = "table",  # noqa: A002
) -> None:
    """Muscle effort, joint force and cord force while the wearer moves: of a running trial, or of a recording.

    A trial is solved live while it is recorded with [live] enabled = true.
    """
    with ExitStack() as stack:
        if page and source.is_dir():
            from station.console.live_server import serve_live

            serve_live(source, port=port)
            return
        scenes = _scenes(stack, rrd, rerun=rerun)
        if source.is_dir():
            _watch(source, scenes)
            return
        served = _serve_page(stack, source.parent, port) if page else None
        code = _replay(source, config, (speed or 1.0) if page else speed, output, scenes, as_json=format == "json")
        if served is not None:
            served.process.wait()
        raise typer.Exit(code)


def _serve_page(stack: ExitStack, folder: Path, port: int) -> Child:
    """In a process of its own, which does not slow the replay."""
    from station.child import Child

    child = Child("station.console.live_server", str(folder), str(port), stdout=None)
    stack.callback(child.ensure_ended)
    return child


def _scenes(stack: ExitStack, rrd: Path | None, *, rerun: bool) -> list[LiveScene]:
    if rrd is None and not rerun:
        return []
    from station.viewer.live_scene import LiveScene
    from station.viewer.viewer import start_viewer

    sinks: list[Path | str] = [] if rrd is None else [rrd]
    return [stack.enter_context(LiveScene(sink)) for sink in [*sinks, *([start_viewer()] if rerun else [])]]


def _watch(folder: Path, scenes: Sequence[LiveScene]) -> None:
    from rich.console import Console

    from station.live.subscription import LiveSubscription, LiveUnreachable, find_address
    from station.live.terminal_view import watch
    from station.messages.live_messages import LiveCode
    from station.messages.message import Message

    address = find_address(folder)
    if address is None:
        raise LiveUnreachable(Message(LiveCode.UNREACHABLE))
    with LiveSubscription(address) as subscription:
        if scenes:
            from station.viewer.live_scene import show_live

            show_live(subscription, scenes)
        else:
            watch(subscription, Console(stderr=True))


def _replay(
    path: Path,
    config: Path | None,
    speed: float | None,
    output: Path | None,
    scenes: Sequence[LiveScene],
    *,
    as_json: bool,
) -> int:
    from station.live.replay import prepare_replay, replay_and_publish
    from station.live.result_file import ResultFile
    from station.live.terminal_view import LiveSummary
    from station.messages.live_messages import LiveCode
    from station.messages.message import Message

    recording, prepared = prepare_replay(path, _settings(config))
    for finding in prepared.findings:
        print_message(str(finding))
    summary = LiveSummary()
    file = ResultFile(prepared.settings, output)
    sinks: list[LiveSink] = [summary, *scenes] if output is None else [summary, *scenes, file]
    replay_and_publish(recording, prepared, path.parent, sinks=sinks, speed=speed)
    if file.path is not None:
        print_message(str(Message(LiveCode.WRITTEN, {"path": str(file.path)})))
        file.close("replay", has_ended=True)
    if as_json:
        print(json.dumps(summary.to_plain(), indent=2))
    else:
        print("\n".join(summary.lines()))
    sys.stdout.flush()
    return DONE if summary.is_whole else LOSSY


def _settings(config: Path | None) -> LiveSection | None:
    from station.config import load_config

    return None if config is None else load_config(config).live
