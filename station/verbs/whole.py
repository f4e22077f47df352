"""The whole way: demo, and the report of all that a folder holds."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from station.verbs.options import Seed, Speed


def demo(
    output: Annotated[Path | None, typer.Option(help="Folder for the session; default: demo, or demo-2, …")] = None,
    speed: Speed = 30.0,
    seed: Seed = 1,
) -> None:
    """Record a whole session from simulated devices, fit it, assess it, report it."""
    from station.demo import run_demo

    raise typer.Exit(run_demo(output, speed, seed))


def report(
    folder: Annotated[Path, typer.Argument(help="A folder with recordings, cuffs.json or assessment.json.")],
) -> None:
    """Write report.html, one self-contained page, of all that a folder holds. Prints its path."""
    from station.report import write_report

    print(write_report(folder))
