"""The verbs, in the order of the data: simulate, check, record, info, recover, fit, rmr, assess, optimise, report; demo
does all.

Exit codes: 0 done; 1 failed; 2 wrong usage; 3 done, but recorded data was lost or a frame stayed unsolved.
stdout carries data, stderr talk.
"""

from __future__ import annotations

import os
import signal
import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, Literal, NoReturn

import typer

from station.exit_code import DONE, FAILED, LOSSY

ROOMS = ("station", "drivers", "recordings", "fitting", "solver")

app = typer.Typer(
    help="From the cuff on the bench to the muscles under the suit, left to right: simulate, check, record, info, "
    "recover, fit, rmr, assess, optimise, report. `demo` walks the whole way on simulated devices.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

ConfigPath = Annotated[Path, typer.Option("--config", help="The station's configuration.")]
Speed = Annotated[float, typer.Option(min=0.1, help="How much faster than the wall station time runs.")]
Test = Literal["static", "dynamic"]
Format = Literal["table", "json"]
Condition = Literal["rigid", "shift", "visco_elastic", "both"]
Seed = Annotated[int, typer.Option(help="Seed of every random choice of the simulated world.")]


class Freedom(StrEnum):
    """An enumeration, as typer takes no list of literals."""

    stiffness = "stiffness"
    waist = "waist"
    shoulder = "shoulder"
    arm = "arm"


def main() -> NoReturn:
    """Runs the verb. An exception born in our house is a sentence for the user; any other is a bug and shows itself."""
    try:
        app()
    except Exception as error:
        if type(error).__module__.split(".")[0] not in ROOMS and not isinstance(error, OSError):
            raise
        _say(f"station: {_one_line(error)}")
        sys.exit(getattr(error, "exit_code", FAILED))
    sys.exit(DONE)


@app.command()
def demo(
    output: Annotated[Path | None, typer.Option(help="Folder for the session; default: demo, or demo-2, …")] = None,
    speed: Speed = 30.0,
    seed: Seed = 1,
) -> None:
    """Record a whole session from simulated devices, fit it, assess it, report it."""
    from station.demo import run_demo

    raise typer.Exit(run_demo(output, speed, seed))


@app.command()
def simulate(
    config: ConfigPath = Path("station.toml"),
    speed: Speed = 1.0,
    seed: Seed = 1,
    cuff: Annotated[str | None, typer.Option(help="Play trials of this cuff; default: the plan, in order.")] = None,
    test: Annotated[Test | None, typer.Option(help="Play this test; default: the plan, in order.")] = None,
    faults: Annotated[Path | None, typer.Option(help="A plan of what goes wrong, and when (.toml).")] = None,
) -> None:
    """Serve the simulated devices at the configuration's addresses, for any client, until Ctrl-C."""
    from station.config import load_config
    from station.simulation import serve_until_stopped

    serve_until_stopped(load_config(config), speed, seed, cuff=cuff, test=test, fault_plan=faults)


@app.command()
def check(
    config: ConfigPath = Path("station.toml"),
    session: Annotated[Path, typer.Option(help="Folder of the session, for the room on its disk.")] = Path(),
) -> None:
    """Show what answers: devices, rates, the level of the sync line, labels, disk."""
    from station.check import check_bench
    from station.config import load_config

    raise typer.Exit(check_bench(load_config(config), session))


@app.command()
def record(
    config: ConfigPath,
    session: Annotated[Path, typer.Option(help="Folder of the session; made if it is not there.")],
    cuff: Annotated[str, typer.Option(help="The cuff under test, as the configuration names it.")],
    test: Annotated[Test, typer.Option(help="Which of the two tests.")],
    repeat: Annotated[int, typer.Option(min=1, help="Which repeat of this test on this donning.")],
    duration: Annotated[
        float | None, typer.Option(min=0.1, help="Seconds after the edge; without it, until the capture ends.")
    ] = None,
    donning: Annotated[str, typer.Option(help="Which donning of the cuff; repeats of one are pooled.")] = "1",
    speed: Annotated[float, typer.Option(min=0.1, help="Speed of the simulated world that is recorded.")] = 1.0,
    rrd: Annotated[Path | None, typer.Option(help="Also write what the live view sees, for Rerun's viewer.")] = None,
) -> None:
    """Record one trial. Ctrl-C once stops cleanly, twice at once. Prints the file's path."""
    from contextlib import ExitStack

    from station.clock import RealClock
    from station.config import load_config
    from station.daemon import Daemon, View
    from station.live import LiveView
    from station.protocol import TrialSpec

    clock = RealClock(speed)
    spec = TrialSpec(cuff, test, repeat, donning)
    with ExitStack() as stack:
        views: list[View] = [stack.enter_context(LiveView(clock, f"{cuff} {test} {repeat}"))]
        if rrd is not None:
            from station.rerun_log import RerunLog

            views.append(stack.enter_context(RerunLog(rrd)))
        daemon = Daemon(load_config(config), clock, views)
        _stop_on_signals(daemon)
        try:
            result = daemon.record(session, spec, duration)
        finally:
            left_behind = daemon.left_behind
    _say(result.sentence)
    if result.path is not None:
        print(result.path)
    code = DONE if result.accepted and not result.lost_samples else LOSSY if result.path else FAILED
    if left_behind:
        _leave(code, left_behind)
    raise typer.Exit(code)


@app.command()
def info(
    file: Annotated[Path, typer.Argument(help="A recording.")],
    format: Annotated[Format, typer.Option(help="A table for people or JSON for programs.")] = "table",  # noqa: A002
) -> None:
    """Show what is in a recording, whole or cut."""
    from station.info import show_contents

    raise typer.Exit(show_contents(file, as_json=format == "json"))


@app.command()
def recover(
    file: Annotated[Path, typer.Argument(help="A recording that was cut.")],
    output: Annotated[Path | None, typer.Option(help="Where to; default: FILE.recovered.mcap beside it.")] = None,
) -> None:
    """Make a whole file of what a killed recording left. Never touches the original."""
    from station.info import recover_recording

    raise typer.Exit(recover_recording(file, output))


@app.command()
def fit(
    session: Annotated[Path, typer.Argument(help="Folder of a recorded session.")],
    output: Annotated[Path | None, typer.Option(help="Default: cuffs.json in the session's folder.")] = None,
    format: Annotated[Format, typer.Option(help="What to print.")] = "table",  # noqa: A002
) -> None:
    """Stiffness, damping and migration of every cuff in a session, with their uncertainty."""
    from rich.console import Console

    from station.pipeline import fit_session_folder
    from station.progress import progress_bars
    from station.tables import print_cuffs

    with progress_bars(Console(stderr=True)) as progress:
        fitted = fit_session_folder(session, output or session / "cuffs.json", progress)
    if format == "json":
        print(fitted.to_json(), end="")
    else:
        print_cuffs(fitted, Console())
    is_whole = all(curves.trial.is_whole for curves in fitted.curves.values())
    raise typer.Exit(DONE if is_whole else LOSSY)


@app.command()
def rmr(
    motion: Annotated[Path, typer.Option(help="Coordinates over time: .mot, .sto, or .csv in radians and metres.")],
    output: Annotated[Path, typer.Option(help="Activations: time and one column per muscle; .csv or .sto.")],
    model: Annotated[str, typer.Option(help='An .osim file, or "bundled".')] = "bundled",
    no_glenoid: Annotated[bool, typer.Option(help="Without keeping the joint reaction inside the glenoid.")] = False,
    free_coordinates: Annotated[str, typer.Option(help="Accelerations that need not be tracked: a,b")] = "",
    cutoff_hz: Annotated[float, typer.Option(min=0.01, help="Low-pass filter of the motion.")] = 3.0,
    start: Annotated[float | None, typer.Option("--from", help="First second that is solved.")] = None,
    end: Annotated[float | None, typer.Option("--to", help="Last second that is solved.")] = None,
    every: Annotated[int, typer.Option(min=1, help="Solve every N-th frame.")] = 1,
) -> None:
    """Solve the muscle-redundancy problem of a motion: which muscles do the work."""
    from rich.console import Console

    from solver.redundancy import RedundancyOptions
    from station.pipeline import MotionCut, solve_muscles
    from station.progress import progress_bars

    free = tuple(name for name in free_coordinates.split(",") if name)
    options = RedundancyOptions(has_glenoid_cone=not no_glenoid, free_coordinates=free)
    with progress_bars(Console(stderr=True)) as progress:
        solution = solve_muscles(model, motion, output, MotionCut(cutoff_hz, start, end, every), options, progress)
    _say(f"Butterworth low-pass at {cutoff_hz:g} Hz, order 4, forwards and backwards")
    for outcome in sorted({each.value for each in solution.outcomes if each.name != "SOLVED"}):
        frames = sum(each.value == outcome for each in solution.outcomes)
        _say(f"{frames} of {len(solution.outcomes)} frames: {outcome}")
    print(output)
    raise typer.Exit(LOSSY if solution.unsolved else DONE)


@app.command()
def assess(
    cuffs: Annotated[Path, typer.Option(help="cuffs.json from `station fit`, or written by hand.")],
    output: Annotated[Path, typer.Option(help="Folder for assessment.json, activations.csv and report.html.")],
    motion: Annotated[Path | None, typer.Option(help="Default: the bundled raise of the arm.")] = None,
    suit: Annotated[Path | None, typer.Option(help="Default: the bundled exotendon suit.")] = None,
    model: Annotated[str, typer.Option(help='An .osim file, or "bundled".')] = "bundled",
    cuff: Annotated[list[str] | None, typer.Option(help="Wear this arm cuff; repeat for more. Default: all.")] = None,
    emg: Annotated[Path | None, typer.Option(help="Measured: a CSV of muscle,reduction_percent,sd.")] = None,
    beside: Annotated[Path | None, typer.Option(help="Another motion, to show beside the assessed one.")] = None,
    draws: Annotated[
        int, typer.Option(min=0, help="Cuffs drawn from their fit's covariance; 0 for no interval.")
    ] = 200,
) -> None:
    """What the suit with these cuffs does for the muscles, over its rest length, and how sure that is."""
    from rich.console import Console

    from solver.suit import BUNDLED_SUIT
    from station.assessment_inputs import AssessmentInputs
    from station.findings import findings
    from station.pipeline import assess_file
    from station.progress import progress_bars
    from station.report import write_report
    from station.tables import assessment_table

    inputs = AssessmentInputs(cuffs, motion, suit or BUNDLED_SUIT, model, emg, beside, tuple(cuff or ()))
    with progress_bars(Console(stderr=True)) as progress:
        assessed = assess_file(inputs, output, draws, progress)
    write_report(output)
    Console().print(assessment_table(assessed.assessment))
    for sentence in findings(assessed.assessment):
        _say(sentence)
    raise typer.Exit(LOSSY if assessed.assessment.unsolved else DONE)


@app.command()
def optimise(
    cuffs: Annotated[Path, typer.Option(help="cuffs.json from `station fit`, or written by hand.")],
    output: Annotated[Path, typer.Option(help="Folder for optimum.json.")],
    motion: Annotated[Path | None, typer.Option(help="Default: the bundled raise of the arm.")] = None,
    suit: Annotated[Path | None, typer.Option(help="Where to start; default: the bundled exotendon suit.")] = None,
    model: Annotated[str, typer.Option(help='An .osim file, or "bundled".')] = "bundled",
    cuff: Annotated[str | None, typer.Option(help="The arm cuff; may be left out where there is one only.")] = None,
    condition: Annotated[Condition, typer.Option(help="What the cuffs do.")] = "both",
    free: Annotated[
        list[Freedom] | None, typer.Option(help="Besides the rest length: repeat for more. Points may move by 5 cm.")
    ] = None,
    draws: Annotated[int, typer.Option(min=0, help="Cuffs drawn from their fit's covariance.")] = 50,
) -> None:
    """The rest length, and where asked the stiffness and points of the cord, that save the muscles most."""
    from rich.console import Console

    from solver.suit import BUNDLED_SUIT
    from station.assessment_inputs import AssessmentInputs
    from station.optimum import optimise_file
    from station.progress import progress_bars
    from station.tables import optimum_table

    inputs = AssessmentInputs(cuffs, motion, suit or BUNDLED_SUIT, model, chosen=(cuff,) if cuff else ())
    freedoms: Any = tuple(each.value for each in free or ())
    with progress_bars(Console(stderr=True)) as progress:
        optimised = optimise_file(inputs, output, condition, freedoms, draws, progress)
    Console().print(optimum_table(optimised))
    for name in dict.fromkeys(optimised.fitted.at_limit + optimised.robust.at_limit):
        _say(f"the search stopped at the end of what {name} may be; a better suit may lie beyond")


@app.command()
def report(
    folder: Annotated[Path, typer.Argument(help="A folder with recordings, cuffs.json or assessment.json.")],
) -> None:
    """Write report.html, one self-contained page, of all that a folder holds. Prints its path."""
    from station.report import write_report

    print(write_report(folder))


def _stop_on_signals(daemon: Any) -> None:
    def stop(_signal: int, _frame: Any) -> None:
        daemon.stop()

    signal.signal(signal.SIGINT, stop)
    signal.signal(signal.SIGTERM, stop)


def _leave(code: int, left_behind: list[str]) -> NoReturn:
    """A frozen device's thread would hold the interpreter's own way out; everything of ours is closed by now."""
    _say(f"left behind, still frozen: {', '.join(left_behind)}")
    sys.stdout.flush()
    os._exit(code)


def _say(words: str) -> None:
    print(words, file=sys.stderr, flush=True)


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__
