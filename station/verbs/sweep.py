"""Verb on many assessments: sweep."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from station.exit_code import DONE, LOSSY
from station.verbs.options import print_message


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
    from station.sweep.dataset import run_sweep
    from station.sweep.solving import solve_on
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
