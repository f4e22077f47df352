"""At the bench: simulate, check, record."""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer

from station.end_signals import end_signals
from station.exit_code import DONE, FAILED, LOSSY
from station.verbs.options import ConfigPath, Format, FormatOption, Rerun, Rrd, Seed, Speed, Test, print_result, say

if TYPE_CHECKING:
    from station.bench.live import LiveView
    from station.clock import Clock
    from station.config import StationConfig
    from station.protocol import TrialSpec

PLAN = "The whole session, without --test"


def simulate(
    config: ConfigPath = Path("station.toml"),
    speed: Speed = 1.0,
    seed: Seed = 1,
    cuff: Annotated[str | None, typer.Option(help="Play this cuff's tests in turn; default: the plan.")] = None,
    test: Annotated[Test | None, typer.Option(help="Play this test; default: the plan, without its bounce.")] = None,
    faults: Annotated[Path | None, typer.Option(help="A plan of what goes wrong, and when (.toml).")] = None,
) -> None:
    """Serve the simulated devices at the configuration's addresses, for any client, until Ctrl-C.

    While they run, the line `hang 2` hangs 2 kg on the load cell, and `ni unplug for_s=2` lets that fault happen now.
    """
    from station.bench.simulation import serve_until_stopped
    from station.config import load_config

    serve_until_stopped(load_config(config), speed, seed, cuff=cuff, test=test, fault_plan=faults)


def check(
    config: ConfigPath = Path("station.toml"),
    session: Annotated[Path, typer.Option(help="Folder of the session, for the room on its disk.")] = Path(),
    known_mass: Annotated[
        float | None,
        typer.Option(min=0, help="Instead: kg hung on the load cell, 0 for none; kept in the session's folder."),
    ] = None,
    format: FormatOption = "table",  # noqa: A002
) -> None:
    """Show what answers: devices, rates, force at rest and calibration, the level of the sync line, labels, disk."""
    from station.bench.check import check_bench
    from station.config import load_config

    if known_mass is not None:
        from station.bench.known_mass import check_known_mass

        raise typer.Exit(check_known_mass(load_config(config), session, known_mass, as_json=format == "json"))
    raise typer.Exit(check_bench(load_config(config), session, as_json=format == "json"))


def record(
    config: ConfigPath,
    session: Annotated[Path, typer.Option(help="Folder of the session; made if it is not there.")],
    test: Annotated[
        Test | None,
        typer.Option(help="One trial of this test, a bounce without a cuff; default: the whole plan, trial by trial."),
    ] = None,
    cuff: Annotated[str | None, typer.Option(help="The cuff under test, as the configuration names it.")] = None,
    repeat: Annotated[int, typer.Option(min=1, help="Which repeat of this test on this donning.")] = 1,
    duration: Annotated[
        float | None, typer.Option(min=0.1, help="Seconds after the edge; without it, until the capture ends.")
    ] = None,
    donning: Annotated[str, typer.Option(help="Which donning of the cuff; repeats of one are pooled.")] = "1",
    speed: Annotated[
        float | None,
        typer.Option(min=0.1, help="Pace of the simulated devices: world seconds per wall second, at most."),
    ] = None,
    rrd: Rrd = None,
    rerun: Rerun = False,
    format: FormatOption = "table",  # noqa: A002
    subject: Annotated[str | None, typer.Option(help="Who is measured, a code like P01.", rich_help_panel=PLAN)] = None,
    operator: Annotated[str, typer.Option(help="Who measures.", rich_help_panel=PLAN)] = "",
    cuffs: Annotated[
        str, typer.Option(help="In this order, like hand,waist; default: all.", rich_help_panel=PLAN)
    ] = "",
    repeats: Annotated[int | None, typer.Option(min=1, help="Of each test.", rich_help_panel=PLAN)] = None,
    simulated: Annotated[
        bool, typer.Option("--simulated", help="On simulated devices, to practise.", rich_help_panel=PLAN)
    ] = False,
    seed: Annotated[int, typer.Option(help="Of the simulated devices.", rich_help_panel=PLAN)] = 1,
    headless: Annotated[
        bool, typer.Option("--headless", help="Events as lines of JSON, commands as lines.", rich_help_panel=PLAN)
    ] = False,
) -> None:
    """Record one trial, or without --test the whole session, trial after trial, each with its verdict.

    Ctrl-C once stops cleanly, twice at once. Prints the files' paths.
    """
    from station.config import load_config
    from station.protocol import TrialSpec

    settings = load_config(config)
    if test is None:
        if (cuff, duration, rrd, rerun, repeat, donning) != (None, None, None, False, 1, "1"):
            raise typer.BadParameter("--cuff, --repeat, --duration, --donning, --rrd and --rerun are for one --test")
        from station.terminal.run import planned, practice_folder, run_session

        session = practice_folder(session) if simulated else session
        names = tuple(name.strip() for name in cuffs.split(",") if name.strip())
        setup = planned(settings, session, _subject(session, subject), operator, names, repeats)
        raise typer.Exit(
            run_session(settings, session, setup, is_headless=headless, is_simulated=simulated, speed=speed, seed=seed)
        )
    if subject or operator or cuffs or repeats or simulated or headless:
        raise typer.BadParameter(
            "--subject, --operator, --cuffs, --repeats, --simulated and --headless are without --test"
        )
    if (cuff is None) != (test == "bounce"):
        raise typer.BadParameter("a static or dynamic test needs --cuff, and a bounce has none")
    _record_trial(settings, session, TrialSpec(cuff, test, repeat, donning), duration, speed, rrd, rerun, format)


def _subject(session: Path, subject: str | None) -> str | None:
    """Asks a person at a terminal for the subject of a new session."""
    from station.journal import JOURNAL_FILE
    from station.terminal.keyboard import is_interactive

    if subject is not None or (session / JOURNAL_FILE).exists() or not is_interactive():
        return subject
    return str(typer.prompt("Subject, a code like P01", err=True))


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
    from station.bench.session_folder import why_not_here
    from station.bench.simulation import clock_port, serves_simulated
    from station.bench.trial_recorder import TrialRecorder, View
    from station.clock import RealClock

    with ExitStack() as stack:
        clock: Clock = RealClock()
        if speed is not None or serves_simulated(config):
            clock = stack.enter_context(BenchClock(clock_port(config), speed))
        views: list[View] = [stack.enter_context(_live_view(config, clock, spec))]
        if rrd is not None or rerun:
            from station.viewer.log import open_rerun

            rope = config.cuffs[spec.cuff].rope_markers if spec.cuff in config.cuffs else ()
            views += open_rerun(stack, rrd, rope, has_viewer=rerun)
        daemon = TrialRecorder(config, clock, views, why_not_here=why_not_here)
        _stop_on_signals(daemon)
        try:
            result = daemon.record(session, spec, duration)
        finally:
            left_behind = daemon.left_behind
    print_result(result, format)
    code = DONE if result.accepted and not result.lost_samples else LOSSY if result.path else FAILED
    if left_behind:
        _leave(code, left_behind)
    raise typer.Exit(code)


def _live_view(config: StationConfig, clock: Clock, spec: TrialSpec) -> LiveView:
    from station.bench.live import LiveView

    title = f"{spec.cuff or 'load cell'} {spec.test} {spec.repeat}"
    site = config.cuff_site(spec.cuff) if spec.cuff in config.cuffs else None
    return LiveView(clock, title, load_cell=config.calibration(), cuff=site)


def _stop_on_signals(daemon: Any) -> None:
    def stop(_signal: int, _frame: Any) -> None:
        daemon.stop()

    for number in end_signals():
        signal.signal(number, stop)


def _leave(code: int, left_behind: list[str]) -> NoReturn:
    """A frozen device's thread would hold the interpreter's own way out; everything of ours is closed by now."""
    say(f"left behind, still frozen: {', '.join(left_behind)}")
    sys.stdout.flush()
    os._exit(code)
