"""Many sessions: plan, catalogue, study."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from documents.interval import counted
from station.exit_code import DONE, LOSSY
from station.verbs.options import ConfigPath, FormatOption, print_message

if TYPE_CHECKING:
    import pandas as pd

TableFormat = Literal["table", "csv", "json"]


def plan(
    plan: Annotated[
        Path, typer.Argument(help="What is expected, to be detected and to be chosen (.toml); docs/study.md.")
    ],
    output: Annotated[Path, typer.Option(help="Folder for plan.json and station.toml with the protocol.")],
    config: ConfigPath = Path("station.toml"),
) -> None:
    """Compute how many volunteers, donnings and repeats a comparison of two cuffs needs, and the time."""
    from rich.console import Console

    from station.checksums import write_whole
    from station.study.designs import (
        CONFIG_FILE,
        DesignOutcome,
        design_table,
        find_designs,
        planned_config,
        read_study_plan,
        write_plan,
    )

    read = read_study_plan(plan)
    designs = find_designs(read)
    configured = planned_config(config, read, designs[0])
    path = write_plan(output, read, designs)
    write_whole(output / CONFIG_FILE, configured)
    Console(markup=False).print(design_table(read, designs))
    print(f"{path}\n{output / CONFIG_FILE}")
    if designs[0].outcome is DesignOutcome.NOT_REACHED:
        print_message(
            f"no design reaches a power of {read.detect.power:g} with "
            f"{counted(read.choices.most_volunteers, 'volunteer')}"
        )
        raise typer.Exit(LOSSY)


def catalogue(
    folder: Annotated[Path, typer.Argument(help="Folder that holds sessions.")],
    output: Annotated[Path | None, typer.Option(help="Default: catalogue.duckdb in the folder.")] = None,
    subject: Annotated[str | None, typer.Option(help="List the sessions of this subject.")] = None,
    operator: Annotated[str | None, typer.Option(help="… of this operator.")] = None,
    cuff: Annotated[str | None, typer.Option(help="… this cuff only.")] = None,
    origin: Annotated[
        Literal["measured", "simulated", "unknown"] | None, typer.Option(help="… of this origin.")
    ] = None,
    since: Annotated[
        datetime | None, typer.Option(formats=["%Y-%m-%d"], help="… begun on this day (UTC) or later.")
    ] = None,
    before: Annotated[
        datetime | None, typer.Option(formats=["%Y-%m-%d"], help="… begun before this day (UTC).")
    ] = None,
    sql: Annotated[str | None, typer.Option(help="Print the result of this query instead; docs/catalogue.md.")] = None,
    participants: Annotated[Path | None, typer.Option(help="Write participants.tsv of BIDS.")] = None,
    rebuild: Annotated[bool, typer.Option("--rebuild", help="Read every session again.")] = False,
    format: Annotated[TableFormat, typer.Option(help="Table for people, CSV or JSON for programs.")] = "table",  # noqa: A002
) -> None:
    """Index the sessions of a folder in a DuckDB file, and list or query them."""
    from rich.console import Console

    from documents.message import Message
    from station.catalogue.index import CATALOGUE_FILE, update_catalogue, write_participants
    from station.catalogue.query import SessionFilter, known_participants, list_cuffs, run_sql
    from station.messages.study_messages import CatalogueCode
    from station.progress import progress_bars

    if since is not None and before is not None and since >= before:
        raise typer.BadParameter(f"no day is from {since:%Y-%m-%d} on and before {before:%Y-%m-%d}; exchange them")
    path = output or folder / CATALOGUE_FILE
    chosen = SessionFilter(subject, operator, cuff, origin, since, before)
    with progress_bars(Console(stderr=True)) as progress:
        indexed = update_catalogue(folder, path, progress, is_rebuilt=rebuild)
    for name, reason in indexed.unreadable.items():
        print_message(str(Message(CatalogueCode.UNREADABLE, {"session": name, "reason": reason})))
    print_message(f"{path}: {counted(indexed.sessions, 'session')}, {indexed.read} read, {indexed.removed} removed")
    if participants is not None:
        write_participants(participants, *known_participants(path))
    _print_rows(run_sql(path, sql) if sql is not None else list_cuffs(path, chosen), format)
    raise typer.Exit(LOSSY if indexed.unreadable else DONE)


def study(
    folders: Annotated[list[Path], typer.Argument(help="Session folders, or folders that hold them.")],
    output: Annotated[Path, typer.Option(help="Folder for study.json, normative.json and study.html.")],
    format: FormatOption = "table",  # noqa: A002
) -> None:
    """Variance components, reliability and comparison of cuffs over volunteers; table for later sessions."""
    from rich.console import Console

    from station.progress import progress_bars
    from station.study.sessions import read_sessions
    from station.study.study_document import make_study, write_normative, write_study
    from station.study.study_page import print_study, write_study_page

    with progress_bars(Console(stderr=True)) as progress:
        document = make_study(read_sessions(folders, progress), progress)
    written = write_study(output, document)
    paths = [written, write_normative(written, document), write_study_page(output, document)]
    for entry in document.left_out:
        print_message(str(entry))
    if format == "json":
        print(document.model_dump_json(indent=1))
    else:
        print_study(document, Console(markup=False))
        print("\n".join(map(str, paths)))
    raise typer.Exit(LOSSY if document.left_out else DONE)


def _print_rows(rows: pd.DataFrame, format: TableFormat) -> None:  # noqa: A002
    """To stdout; the table with four significant digits, CSV and JSON with all."""
    if format == "csv":
        print(rows.to_csv(index=False), end="")
    elif format == "json":
        print(rows.to_json(orient="records", indent=1, date_format="iso", default_handler=str))
    elif rows.empty:
        print_message("no rows: no session has what was asked for")
    else:
        known = rows.astype(object).where(rows.notna(), "-")
        print(known.to_string(index=False, float_format="{:.4g}".format))
