"""Verb on cuffs: fit."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from station.exit_code import DONE, FAILED, LOSSY
from station.verbs.options import Format, print_message

if TYPE_CHECKING:
    from fitting.cuffs.cuff_fit import SessionFit

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
    from station.checksums import changed_files
    from station.fit import fit_session_folder
    from station.journal_lines import JOURNAL_FILE
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

    from fitting.cuffs.published_method import plain_published, published_fits
    from station.tables import published_table
    from station.whole_file import write_whole

    fits = published_fits(fitted)
    text = json.dumps({"method": "paper", "cuffs": plain_published(fits)}, indent=2) + "\n"
    if output is not None:
        write_whole(output, text)
    if format == "json":
        print(text, end="")
    else:
        Console(markup=False).print(published_table(fits, fitted))
