"""Verbs at the bench: simulate, check, record, live."""

from __future__ import annotations

import json
import os
import signal
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

from station.end_signals import end_signals
from station.exit_code import DONE, FAILED, LOSSY
from station.verbs.options import (
    ConfigPath,
    Donning,
    Format,
    FormatOption,
    Repeat,
    Rerun,
    Rrd,
    Seed,
    Speed,
    Test,
    Worn,
    print_message,
    print_result,
)

if TYPE_CHECKING:
    from station.bench.live import LiveView
    from station.bench.trial_recorder import TrialRecorder, TrialResult
    from station.child import Child
    from station.clock import Clock
    from station.config import LiveSection, StationConfig
    from station.live.engine import LiveSink
    from station.protocol import TrialSpec
    from station.viewer.scene import LiveScene

PLAN = "Whole session (without --test)"


def simulate(
    config: ConfigPath = Path("station.toml"),
    speed: Speed = 1.0,
    seed: Seed = 1,
    cuff: Annotated[str | None, typer.Option(help="Simulate this cuff's tests in turn; default: the plan.")] = None,
    test: Annotated[Test | None, typer.Option(help="Simulate this test; default: the cuff tests of the plan.")] = None,
    condition: Worn = None,
    faults: Annotated[Path | None, typer.Option(help="A plan of faults and their times (.toml).")] = None,
) -> None:
    """Serve simulated devices at the addresses of the configuration, for any client, until Ctrl-C.

    Commands on standard input: `hang 2` hangs 2 kg on the load cell, `ni unplug for_s=2` injects a fault.
    """
    from station.bench.simulation import serve_until_stopped
    from station.config import load_config
    from station.protocol import TrialSpec

    trial = None if test is None and cuff is None else TrialSpec(cuff, test or "static", 1, condition=condition)
    serve_until_stopped(load_config(config), speed, seed, trial, in_turn=test is None, fault_plan=faults)


def check(
    config: ConfigPath = Path("station.toml"),
    session: Annotated[Path, typer.Option(help="Session folder, to check its free disk space.")] = Path(),
    known_mass: Annotated[
        float | None,
        typer.Option(min=0, help="Check the load cell with this mass [kg], 0 for none; stored in the session folder."),
    ] = None,
    format: FormatOption = "table",  # noqa: A002
) -> None:
    """Check the bench: devices, sample rates, force at rest, calibration, sync line, marker labels, disk."""
    from station.bench.check import check_bench
    from station.config import load_config

    if known_mass is not None:
        from station.bench.check import check_known_mass

        raise typer.Exit(check_known_mass(load_config(config), session, known_mass, as_json=format == "json"))
    raise typer.Exit(check_bench(load_config(config), session, as_json=format == "json"))


def record(
    config: ConfigPath,
    session: Annotated[Path, typer.Option(help="Session folder; created if it does not exist.")],
    test: Annotated[Test | None, typer.Option(help="Record one trial of this test; default: the whole plan.")] = None,
    cuff: Annotated[str | None, typer.Option(help="Name of the cuff in the configuration.")] = None,
    condition: Worn = None,
    repeat: Repeat = 1,
    duration: Annotated[
        float | None, typer.Option(min=0.1, help="Seconds after the sync edge; default: whole capture, pose 5 s.")
    ] = None,
    donning: Donning = "1",
    speed: Annotated[float | None, typer.Option(min=0.1, help="Largest simulated speed; 1 is real time.")] = None,
    rrd: Rrd = None,
    rerun: Rerun = False,
    format: FormatOption = "table",  # noqa: A002
    subject: Annotated[str | None, typer.Option(help="Code of the subject, such as P01.", rich_help_panel=PLAN)] = None,
    operator: Annotated[str, typer.Option(help="Name of the operator.", rich_help_panel=PLAN)] = "",
    cuffs: Annotated[
        str, typer.Option(help="Cuffs in their order, such as hand,waist; default: all.", rich_help_panel=PLAN)
    ] = "",
    repeats: Annotated[int | None, typer.Option(min=1, help="Repeats of each test.", rich_help_panel=PLAN)] = None,
    simulated: Annotated[
        bool, typer.Option("--simulated", help="Practise on simulated devices.", rich_help_panel=PLAN)
    ] = False,
    seed: Annotated[int, typer.Option(help="Seed of the simulated devices.", rich_help_panel=PLAN)] = 1,
    headless: Annotated[
        bool,
        typer.Option(
            "--headless", help="Events as JSON lines, commands as lines; also by --format json.", rich_help_panel=PLAN
        ),
    ] = False,
) -> None:
    """Record one trial, or without --test the whole session with a verdict after each trial.

    Press Ctrl-C once to stop cleanly, twice to stop at once. Prints the paths of the files.
    """
    from station.config import load_config
    from station.protocol import TrialSpec

    settings = load_config(config)
    if test is None:
        if (cuff, condition, duration, rrd, rerun, repeat, donning) != (None, None, None, None, False, 1, "1"):
            raise typer.BadParameter("--cuff, --condition, --repeat, --duration, --donning, --rrd, --rerun need --test")
        from station.terminal.run import plan_session, practice_folder, run_session

        session, headless = practice_folder(session) if simulated else session, headless or format == "json"
        names = tuple(name.strip() for name in cuffs.split(",") if name.strip())
        setup = plan_session(settings, session, _subject(session, subject), operator, names, repeats)
        raise typer.Exit(
            run_session(settings, session, setup, is_headless=headless, is_simulated=simulated, speed=speed, seed=seed)
        )
    if subject or operator or cuffs or repeats or simulated or headless:
        raise typer.BadParameter(
            "--subject, --operator, --cuffs, --repeats, --simulated and --headless are for a session; leave out --test"
        )
    spec = TrialSpec(cuff, test, repeat, donning, condition=condition)
    _check_spec(spec)
    _record_trial(settings, session, spec, duration, speed, rrd, rerun, format)


def _check_spec(spec: TrialSpec) -> None:
    from station.protocol import BODY_TESTS, CUFF_TESTS

    if (spec.cuff is not None) != (spec.test in CUFF_TESTS):
        raise typer.BadParameter("a static or dynamic test needs --cuff; a bounce, pose or motion takes none")
    is_missing = spec.test == "motion" and spec.condition is None
    if is_missing or (spec.test not in BODY_TESTS and spec.condition is not None):
        raise typer.BadParameter("a motion needs --condition, a pose may have one, other tests take none")


def _subject(session: Path, subject: str | None) -> str | None:
    """The subject code; a terminal prompts for that of a new session."""
    from station.checksums import JOURNAL_FILE
    from station.terminal.commands import is_interactive

    if subject is not None or (session / JOURNAL_FILE).exists() or not is_interactive():
        return subject
    return str(typer.prompt("Code of the subject, such as P01", err=True))


def _record_trial(
    config: StationConfig,
    session: Path,
    spec: TrialSpec,
    duration: float | None,
    speed: float | None,
    rrd: Path | None,
    rerun: bool,
    format: Format,  # noqa: A002
) -> NoReturn:
    from contextlib import ExitStack

    from station.bench.bench_clock import BenchClock
    from station.bench.session_folder import check_folder
    from station.bench.simulation import clock_port, is_served_by_simulator
    from station.bench.trial_recorder import TrialRecorder, View
    from station.clock import RealClock
    from station.live.tap import live_views

    with ExitStack() as stack:
        clock: Clock = RealClock()
        if speed is not None or is_served_by_simulator(config):
            clock = stack.enter_context(BenchClock(clock_port(config), speed))
        views: list[View] = [stack.enter_context(_live_view(config, clock, spec))]
        if rrd is not None or rerun:
            from station.viewer.viewer import open_rerun

            rope = config.cuffs[spec.cuff].rope_markers if spec.cuff in config.cuffs else ()
            views += open_rerun(stack, rrd, rope, has_viewer=rerun)
        views += [stack.enter_context(tap) for tap in live_views(config, session, spec, clock)]
        recorder = TrialRecorder(config, clock, views, check_folder=check_folder)
        _stop_on_signals(recorder)
        result = recorder.record(session, spec, duration)
    print_result(result, format)
    code = _exit_code(result)
    if recorder.abandoned:
        _exit_at_once(code, recorder.abandoned)
    raise typer.Exit(code)


def _exit_code(result: TrialResult) -> int:
    """Of the trial: a recording that the operator stopped is accepted, and lacks the end of its capture."""
    from station.messages.bench_messages import TrialCode

    if result.path is None:
        return FAILED
    is_stopped = any(message.code is TrialCode.OPERATOR_STOP for message in result.messages)
    return LOSSY if is_stopped or result.lost_samples or not result.accepted else DONE


def _live_view(config: StationConfig, clock: Clock, spec: TrialSpec) -> LiveView:
    from station.bench.live import LiveView

    site = config.cuff_site(spec.cuff) if spec.cuff in config.cuffs else None
    return LiveView(clock, spec.title, load_cell=config.calibration(), cuff=site)


def _stop_on_signals(recorder: TrialRecorder) -> None:
    for number in end_signals():
        signal.signal(number, lambda *_: recorder.stop())


def _exit_at_once(code: int, abandoned: list[str]) -> NoReturn:
    """The thread of a frozen device would block the exit of the interpreter; all files are closed by now."""
    print_message(f"device did not close: {', '.join(abandoned)}; check its cable and power")
    sys.stdout.flush()
    os._exit(code)


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
            from station.console.server import serve_live

            serve_live(source, port)
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

    child = Child("station.console.server", str(folder), str(port), stdout=None)
    stack.callback(child.ensure_ended)
    return child


def _scenes(stack: ExitStack, rrd: Path | None, *, rerun: bool) -> list[LiveScene]:
    if rrd is None and not rerun:
        return []
    from station.viewer.scene import LiveScene
    from station.viewer.viewer import start_viewer

    sinks: list[Path | str] = [] if rrd is None else [rrd]
    return [stack.enter_context(LiveScene(sink)) for sink in [*sinks, *([start_viewer()] if rerun else [])]]


def _watch(folder: Path, scenes: Sequence[LiveScene]) -> None:
    from rich.console import Console

    from documents.message import Message
    from station.live.subscription import LiveSubscription, LiveUnreachable, find_address
    from station.live.terminal_view import watch
    from station.messages.live_messages import LiveCode

    address = find_address(folder)
    if address is None:
        raise LiveUnreachable(Message(LiveCode.UNREACHABLE))
    with LiveSubscription(address) as subscription:
        if scenes:
            from station.viewer.scene import show_live

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
    from documents.message import Message
    from station.live.engine import prepare_replay, replay_and_publish
    from station.live.outlet import ResultFile
    from station.live.terminal_view import LiveSummary
    from station.messages.live_messages import LiveCode

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
