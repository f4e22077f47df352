"""From recordings to cuffs: fit."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from station.exit_code import DONE, LOSSY
from station.verbs.options import Format


def fit(
    session: Annotated[Path, typer.Argument(help="Folder of a recorded session.")],
    output: Annotated[Path | None, typer.Option(help="Default: cuffs.json in the session's folder.")] = None,
    format: Annotated[Format, typer.Option(help="What to print.")] = "table",  # noqa: A002
) -> None:
    """Stiffness, damping and migration of every cuff in a session, with their uncertainty."""
    from rich.console import Console

    from station.fit import fit_session_folder
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
