"""From cuffs to muscles: rmr, assess, optimise, sweep."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from station.exit_code import DONE, LOSSY
from station.verbs.options import Condition, Freedom, Paths, say

CuffsFile = Annotated[Path, typer.Option(help="cuffs.json from `station fit`, or written by hand.")]
BundledOrMotion = Annotated[Path | None, typer.Option(help="Default: the bundled raise of the arm.")]
BundledOrOsim = Annotated[str, typer.Option(help='An .osim file, or "bundled".')]
ExternalLoads = Annotated[Path | None, typer.Option(help="OpenSim's ExternalLoads: .xml, names its data.")]


def rmr(
    output: Annotated[Path, typer.Option(help="Activations, forces, reserves, joint reaction: .csv, .sto, .parquet.")],
    motion: Annotated[
        Path | None,
        typer.Option(help=".mot, .sto, or .csv in radians and metres. Default: the bundled raise of the arm."),
    ] = None,
    model: BundledOrOsim = "bundled",
    external_loads: ExternalLoads = None,
    effort: Annotated[Path | None, typer.Option(help="Weights, and reserves of your own: .toml.")] = None,
    glenoid: Annotated[
        bool,
        typer.Option("--glenoid/--no-glenoid", help="Keep the joint reaction inside the glenoid."),
    ] = True,
    no_no_glenoid: Annotated[bool, typer.Option("--no-no-glenoid", hidden=True)] = False,
    glenoid_aspect: Annotated[float, typer.Option(min=0.1, max=10.0, help="Its width across, over along.")] = 1.0,
    free_coordinates: Annotated[str, typer.Option(help="Accelerations that need not be tracked: a,b")] = "",
    joint: Annotated[str, typer.Option(help="Whose reaction it is.")] = "GlenoHumeral",
    paths: Paths = "opensim",
    cutoff_hz: Annotated[float, typer.Option(min=0.0, help="Low-pass filter of the motion; 0 for none.")] = 3.0,
    start: Annotated[float | None, typer.Option("--from", help="First second that is solved.")] = None,
    end: Annotated[float | None, typer.Option("--to", help="Last second that is solved.")] = None,
    every: Annotated[int, typer.Option(min=1, help="Solve every N-th frame.")] = 1,
    plot: Annotated[Path | None, typer.Option(help="Draw it: one .png, or a folder for its parts.")] = None,
) -> None:
    """Solve the muscle-redundancy problem of a motion: which muscles do the work."""
    from rich.console import Console

    from solver.redundancy.motion import RedundancyOptions
    from station.assessment.compilation import compilation_shown
    from station.assessment.rmr import MotionCut, MuscleInputs, solve_muscles, unsolved_in_words
    from station.assessment.rmr_table import ensure_writable, write_solved
    from station.progress import progress_bars

    ensure_writable(output)
    if plot is not None and plot.suffix not in ("", ".png"):
        raise typer.BadParameter(f"--plot should be a .png or a folder and is {plot.name}")
    free = tuple(name for name in free_coordinates.split(",") if name)
    options = RedundancyOptions(
        glenoid or no_no_glenoid, free, glenoid_aspect=glenoid_aspect, joint=joint, path_mode=paths
    )
    inputs, cut = MuscleInputs(motion, model, external_loads, effort), MotionCut(cutoff_hz or None, start, end, every)
    with progress_bars(Console(stderr=True)) as progress, compilation_shown(progress):
        solved = solve_muscles(inputs, cut, options, progress)
    say(f"filter: {solved.notes['filter']}")
    for sentence in unsolved_in_words(solved.solution):
        say(sentence)
    left_out = write_solved(output, solved)
    if left_out is not None:
        say(left_out)
    print(output)
    if plot is not None:
        from station.report.rmr_figures import draw_solved

        draw_solved(plot, solved)
        print(plot)
    raise typer.Exit(LOSSY if solved.solution.unsolved else DONE)


def assess(
    cuffs: CuffsFile,
    output: Annotated[Path, typer.Option(help="Folder for assessment.json, activations.csv and report.html.")],
    motion: BundledOrMotion = None,
    suit: Annotated[Path | None, typer.Option(help="Default: the bundled exotendon suit.")] = None,
    model: BundledOrOsim = "bundled",
    external_loads: ExternalLoads = None,
    cuff: Annotated[list[str] | None, typer.Option(help="Wear this arm cuff; repeat for more. Default: all.")] = None,
    emg: Annotated[Path | None, typer.Option(help="Measured: a CSV of muscle,reduction_percent,sd.")] = None,
    beside: Annotated[Path | None, typer.Option(help="Another motion, to show beside the assessed one.")] = None,
    draws: Annotated[
        int, typer.Option(min=0, help="Cuffs drawn from their fit's covariance; 0 for no interval.")
    ] = 200,
    paths: Paths = "opensim",
) -> None:
    """What the suit with these cuffs does for the muscles, over its rest length, and how sure that is."""
    from rich.console import Console

    from solver.suit.suit import BUNDLED_SUIT
    from station.assessment.assess import assess_file
    from station.assessment.assessment_inputs import AssessmentInputs, cuff_remarks
    from station.assessment.compilation import compilation_shown
    from station.assessment.findings import findings
    from station.progress import progress_bars
    from station.report.page import write_report
    from station.tables import assessment_table

    inputs = AssessmentInputs(
        cuffs, motion, suit or BUNDLED_SUIT, model, emg, beside, tuple(cuff or ()), paths, external_loads
    )
    with progress_bars(Console(stderr=True)) as progress, compilation_shown(progress):
        assessed = assess_file(inputs, output, draws, progress)
    write_report(output)
    Console(markup=False).print(assessment_table(assessed.assessment))
    for sentence in cuff_remarks(cuffs, assessed.cuffs):
        say(sentence)
    for sentence in findings(assessed.assessment):
        say(sentence)
    is_changed = assessed.cuffs_standing.is_break
    raise typer.Exit(LOSSY if assessed.assessment.unsolved or is_changed else DONE)


def optimise(
    cuffs: CuffsFile,
    output: Annotated[Path, typer.Option(help="Folder for optimum.json.")],
    motion: BundledOrMotion = None,
    suit: Annotated[Path | None, typer.Option(help="Where to start; default: the bundled exotendon suit.")] = None,
    model: BundledOrOsim = "bundled",
    external_loads: ExternalLoads = None,
    cuff: Annotated[str | None, typer.Option(help="The arm cuff; may be left out where there is one only.")] = None,
    condition: Annotated[Condition, typer.Option(help="What the cuffs do.")] = "both",
    free: Annotated[
        list[Freedom] | None, typer.Option(help="Besides the rest length: repeat for more. Points may move by 5 cm.")
    ] = None,
    draws: Annotated[int, typer.Option(min=0, help="Cuffs drawn from their fit's covariance.")] = 50,
) -> None:
    """The rest length, and where asked the stiffness and points of the cord, that save the muscles most."""
    from rich.console import Console

    from fitting.cuffs_file import read_cuffs
    from solver.suit.optimise import SearchOutcome
    from solver.suit.suit import BUNDLED_SUIT
    from station.assessment.assessment_inputs import AssessmentInputs, chosen_cuffs, cuff_remarks
    from station.assessment.compilation import compilation_shown
    from station.assessment.optimum import optimise_file
    from station.progress import progress_bars
    from station.tables import optimum_table

    chosen = (cuff,) if cuff else ()
    inputs = AssessmentInputs(cuffs, motion, suit or BUNDLED_SUIT, model, chosen=chosen, external_loads=external_loads)
    freedoms: Any = tuple(each.value for each in free or ())
    with progress_bars(Console(stderr=True)) as progress, compilation_shown(progress):
        optimised = optimise_file(inputs, output, condition, freedoms, draws, progress)
    Console(markup=False).print(optimum_table(optimised))
    for sentence in cuff_remarks(cuffs, chosen_cuffs(read_cuffs(cuffs), chosen)):
        say(sentence)
    for name in dict.fromkeys(optimised.fitted.at_limit + optimised.robust.at_limit):
        say(f"the search stopped at the end of what {name} may be; a better suit may lie beyond")
    if SearchOutcome.NOT_CONVERGED in (optimised.fitted.outcome, optimised.robust.outcome):
        say("the search did not converge within its limit of tries; free fewer of the suit's parameters")


def sweep(
    plan: Annotated[Path, typer.Argument(help="What is varied, in TOML; docs/sweep.md has an example.")],
    output: Annotated[Path, typer.Option(help="Folder for sweep.parquet; what it holds of the plan is kept.")],
    scheduler: Annotated[str | None, typer.Option(help="A Dask scheduler, tcp://…; default: this machine.")] = None,
    workers: Annotated[int, typer.Option(min=1, help="Processes on this machine, where no scheduler is given.")] = 2,
) -> None:
    """Wear many suits in many cases, resumed where it was ended, into one table."""
    from functools import partial

    from rich.console import Console

    from station.progress import progress_bars
    from station.sweep.cluster import connected, solve_on
    from station.sweep.plan import read_plan
    from station.sweep.run import run_sweep

    read = read_plan(plan)
    with progress_bars(Console(stderr=True)) as progress, connected(scheduler, workers) as client:
        swept = run_sweep(read, output, partial(solve_on, client), progress)
    say(f"{swept.cases} cases, {swept.found_finished} of them finished before")
    if swept.failed:
        say(f"{swept.failed} cases failed; the column error says why")
    if swept.unsolved:
        say(f"{swept.unsolved} cases have frames that stayed unsolved; the column unsolved counts them")
    print(swept.table)
    raise typer.Exit(LOSSY if swept.failed or swept.unsolved else DONE)
