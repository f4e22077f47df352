"""Verbs on cuffs and suits: fit, assess, optimise, sweep."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from station.defaults import CUTOFF_HZ, LEAST_DRAWS
from station.exit_code import DONE, FAILED, LOSSY
from station.verbs.options import (
    BundledOrMotion,
    BundledOrOsim,
    Condition,
    CutoffHz,
    EffortFile,
    ExternalLoads,
    Format,
    Freedom,
    Paths,
    Tendons,
    given_options,
    print_message,
)

if TYPE_CHECKING:
    from fitting.cuffs.cuff_fit import SessionFit
    from station.assessment.people_run import PeopleOptions

Method = Literal["default", "paper"]


def fit(
    session: Annotated[Path, typer.Argument(help="Session folder.")],
    output: Annotated[Path | None, typer.Option(help="Default: cuffs.json in the session folder.")] = None,
    format: Annotated[Format, typer.Option(help="Table for people or JSON for programs.")] = "table",  # noqa: A002
    method: Annotated[
        Method,
        typer.Option(
            help='"paper": print the result of the published equations for the same trials, without cuffs.json.'
        ),
    ] = "default",
) -> None:
    """Fit stiffness, damping and migration of every cuff in a session, with their uncertainty."""
    from rich.console import Console

    from fitting.cuffs.cuffs_file import cuffs_json
    from station.checksums import JOURNAL_FILE, changed_files
    from station.fit import fit_session_folder
    from station.progress import progress_bars
    from station.tables import print_cuffs

    cuffs = output or session / "cuffs.json"
    with progress_bars(Console(stderr=True)) as progress:
        fitted = fit_session_folder(session, cuffs if method == "default" else None, progress)
    for file, damage in fitted.damage.items():
        print_message(f"{file} is damaged: {'; '.join(damage)}")
    if method == "paper":
        _compare_with_paper(fitted, output, format)
    elif format == "json":
        print(cuffs_json(fitted), end="")
    else:
        print_cuffs(fitted, Console(markup=False))  # "[mm]" is a unit
    if not fitted.pulls:
        print_message("no trial could be used; the reasons are listed above and in cuffs.json")
        raise typer.Exit(LOSSY if fitted.damage else FAILED)
    broken = [session / file for file, standing in fitted.recordings.items() if standing.is_break]
    changed = changed_files([*broken, session / JOURNAL_FILE])
    for message in changed:
        print_message(str(message))
    is_whole = not changed and all(curves.pull.trial.is_whole for curves in fitted.pulls.values())
    raise typer.Exit(DONE if is_whole and not fitted.damage else LOSSY)


def _compare_with_paper(fitted: SessionFit, output: Path | None, format: Format) -> None:  # noqa: A002
    """Print the results of the published method, and write them to the output file if there is one."""
    import json

    from rich.console import Console

    from fitting.cuffs.published_method import published_fits, published_json
    from station.checksums import write_whole
    from station.tables import published_table

    fits = published_fits(fitted)
    text = json.dumps({"method": "paper", "cuffs": published_json(fits)}, indent=2) + "\n"
    if output is not None:
        write_whole(output, text)
    if format == "json":
        print(text, end="")
    else:
        Console(markup=False).print(published_table(fits, fitted))


CuffsFile = Annotated[Path, typer.Option(help="cuffs.json of `station fit`, or written by hand.")]
Budget = Annotated[Path | None, typer.Option(help="Sources of uncertainty (.toml). Default: the bundled budget.")]
Sources = Annotated[
    Literal["all", "cuffs"],
    typer.Option(
        help="Sources of the intervals: all of the budget, or the fit of the cuffs alone, without a decision."
    ),
]


def _power_of_two(blocks: int | None) -> int | None:
    if blocks is not None and blocks & (blocks - 1):
        raise typer.BadParameter(f"expected a power of two, as 128, and got {blocks}")
    return blocks


def _enough_draws(draws: int | None) -> int | None:
    """Refuse fewer draws than a 95 % interval needs; 0 are for none."""
    if draws is not None and 0 < draws < LEAST_DRAWS:
        raise typer.BadParameter(f"{draws} give no 95 % interval, expected at least {LEAST_DRAWS}, or 0 for none")
    return draws


Indices = Annotated[
    int | None,
    typer.Option(
        min=8,
        callback=_power_of_two,
        help="Sobol indices of the sources, from 7 times as many people; a power of two, as 128.",
    ),
]
People = Annotated[
    int | None,
    typer.Option(
        min=0,
        callback=_enough_draws,
        help=f"People drawn for intervals and decision, {LEAST_DRAWS} or more, or 0 for none. Default: of the budget.",
    ),
]
Draws = Annotated[
    int,
    typer.Option(
        min=0,
        callback=_enough_draws,
        help=f"Number of draws from the covariance of the cuffs, {LEAST_DRAWS} or more; 0 for no robust suit.",
    ),
]
Workers = Annotated[
    int | None, typer.Option(min=1, help="Number of processes for the people. Default: this one, with all cores.")
]
Donnings = Annotated[
    list[Path] | None,
    typer.Option(help="Session folder with more donnings of cuffs, for their spread; may be repeated."),
]
Subject = Annotated[
    Path | None, typer.Option(help="Session folder with the wearer's pose and motion trials and subject.toml.")
]


def assess(
    context: typer.Context,
    cuffs: CuffsFile,
    output: Annotated[Path, typer.Option(help="Output folder for assessment.json, activations.csv and report.html.")],
    motion: BundledOrMotion = None,
    suit: Annotated[Path | None, typer.Option(help="Default: the bundled exotendon suit.")] = None,
    model: BundledOrOsim = "bundled",
    external_loads: ExternalLoads = None,
    effort: EffortFile = None,
    cutoff_hz: CutoffHz = CUTOFF_HZ,
    cuff: Annotated[list[str] | None, typer.Option(help="Assess this cuff; may be repeated. Default: all.")] = None,
    emg: Annotated[Path | None, typer.Option(help="Measured EMG: a CSV of muscle,reduction_percent,sd.")] = None,
    beside: Annotated[Path | None, typer.Option(help="Another motion for comparison.")] = None,
    subject: Subject = None,
    people: People = None,
    sources: Sources = "all",
    budget: Budget = None,
    indices: Indices = None,
    donnings: Donnings = None,
    scheduler: Annotated[str | None, typer.Option(help="A Dask scheduler for the people, tcp://…")] = None,
    workers: Workers = None,
    paths: Paths = "opensim",
    tendons: Tendons = "rigid",
) -> None:
    """Assess the effect of the suit with these cuffs on muscle effort, over its rest length, with intervals."""
    from station.assessment.compilation import compilation_shown, compile_in_background

    compilation = compile_in_background(context)
    from rich.console import Console

    from solver.suit.suit import BUNDLED_SUIT
    from station.assessment.assess import assess_file, sentences_on
    from station.assessment.assessment_inputs import AssessmentInputs
    from station.assessment.people_run import PeopleOptions, people_run
    from station.progress import progress_bars
    from station.report.page import write_report
    from station.tables import assessment_table

    if subject is not None and (motion, external_loads, beside) != (None, None, None):
        raise typer.BadParameter("--subject brings its own motion; leave out --motion, --external-loads and --beside")
    if subject is not None and given_options(context, ("cutoff_hz",)):
        raise typer.BadParameter(f"--subject has a filter of its own, at {CUTOFF_HZ:g} Hz; leave out --cutoff-hz")
    chosen = tuple(cuff or ())
    files = (cuffs, motion, suit or BUNDLED_SUIT, model, emg, beside, chosen, paths, external_loads, subject, effort)
    drawn = PeopleOptions(people, sources, budget, indices, scheduler, workers, tuple(donnings or ()))
    if tendons == "elastic":
        _ensure_undrawn(drawn)
        drawn = PeopleOptions(people=0)
    inputs = AssessmentInputs(*files, cutoff_hz or None, tendons)
    with (
        progress_bars(Console(stderr=True)) as progress,
        compilation_shown(progress, compilation),
        people_run(output, drawn) as run,
    ):
        assessed = assess_file(inputs, output, run, progress)
    write_report(output)
    Console(markup=False).print(assessment_table(assessed.assessment))
    for sentence in sentences_on(assessed, cuffs):
        print_message(sentence)
    raise typer.Exit(LOSSY if assessed.assessment.unsolved or assessed.is_changed else DONE)


def _ensure_undrawn(options: PeopleOptions) -> None:
    """Refuse drawn people with elastic tendons."""
    if options.people or options.budget or options.index_blocks or options.donnings:
        raise typer.BadParameter(
            "--tendons elastic draws no people, because people are solved in some of the frames and fibre velocities "
            "are differences of frames; leave out --people, --budget, --indices and --donnings"
        )


def optimise(
    context: typer.Context,
    cuffs: CuffsFile,
    output: Annotated[Path, typer.Option(help="Output folder for optimum.json.")],
    motion: BundledOrMotion = None,
    suit: Annotated[Path | None, typer.Option(help="Initial suit; default: the bundled exotendon suit.")] = None,
    model: BundledOrOsim = "bundled",
    external_loads: ExternalLoads = None,
    effort: EffortFile = None,
    cutoff_hz: CutoffHz = CUTOFF_HZ,
    cuff: Annotated[str | None, typer.Option(help="The cuff; optional if there is only one.")] = None,
    condition: Annotated[Condition, typer.Option(help="Effects of the cuffs.")] = "both",
    free: Annotated[
        list[Freedom] | None,
        typer.Option(help="Further parameters besides the rest length; may be repeated. Points move by up to 5 cm."),
    ] = None,
    draws: Draws = 50,
) -> None:
    """Find the rest length, and on request the stiffness and points of the cord, with the least muscle effort."""
    from station.assessment.compilation import compilation_shown, compile_in_background

    compilation = compile_in_background(context)
    from rich.console import Console

    from solver.suit.optimise import SearchOutcome
    from solver.suit.suit import BUNDLED_SUIT
    from station.assessment.assessment_inputs import AssessmentInputs
    from station.assessment.optimum import optimise_file
    from station.progress import progress_bars
    from station.tables import optimum_table

    chosen = (cuff,) if cuff else ()
    inputs = AssessmentInputs(cuffs, motion, suit or BUNDLED_SUIT, model, chosen=chosen, external_loads=external_loads)
    inputs = replace(inputs, effort=effort, cutoff_hz=cutoff_hz or None)
    freedoms: Any = tuple(freedom.value for freedom in free or ())
    with progress_bars(Console(stderr=True)) as progress, compilation_shown(progress, compilation):
        found = optimise_file(inputs, output, condition, freedoms, draws, progress)
    Console(markup=False).print(optimum_table(found))
    for sentence in found.remarks:
        print_message(sentence)
    for name in dict.fromkeys(found.optimum.at_limit + found.robust_optimum.at_limit):
        print_message(f"the search stopped at the limit of {name}; a better suit may exist beyond it")
    if SearchOutcome.NOT_CONVERGED in (found.optimum.outcome, found.robust_optimum.outcome):
        print_message("the search did not converge within its limit of iterations; free fewer parameters of the suit")


def sweep(
    plan: Annotated[Path, typer.Argument(help="The plan of the sweep (.toml); docs/sweep.md has an example.")],
    output: Annotated[Path, typer.Option(help="Output folder for sweep.parquet; finished cases in it are kept.")],
    scheduler: Annotated[str | None, typer.Option(help="A Dask scheduler, tcp://…; default: this computer.")] = None,
    workers: Annotated[int, typer.Option(min=1, help="Number of processes on this computer, without --scheduler.")] = 2,
) -> None:
    """Assess many suits, models, motions and cuffs in one table; an interrupted sweep is continued."""
    from functools import partial

    from rich.console import Console

    from station.dask_cluster import connected
    from station.progress import progress_bars
    from station.sweep.dataset import run_sweep, solve_on
    from station.sweep.sweep_plan import read_plan

    read = read_plan(plan)
    with progress_bars(Console(stderr=True)) as progress, connected(scheduler, workers) as client:
        swept = run_sweep(read, output, partial(solve_on, client), progress)
    print_message(f"{swept.cases} cases, {swept.found_finished} of them from an earlier run")
    if swept.failed:
        print_message(f"{swept.failed} cases failed; the column error has the reasons, the first: {swept.first_error}")
    if swept.unsolved:
        print_message(f"{swept.unsolved} cases have frames without a solution; the column unsolved counts them")
    for finding in swept.findings:
        print_message(str(finding))
    print(swept.table)
    raise typer.Exit(LOSSY if swept.failed or swept.unsolved else DONE)
