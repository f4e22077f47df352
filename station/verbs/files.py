"""With one file: info, recover."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from station.verbs.options import Format


def info(
    file: Annotated[Path, typer.Argument(help="A recording.")],
    format: Annotated[Format, typer.Option(help="A table for people or JSON for programs.")] = "table",  # noqa: A002
) -> None:
    """Show what is in a recording, whole or cut."""
    from station.info import show_contents

    raise typer.Exit(show_contents(file, as_json=format == "json"))


def recover(
    file: Annotated[Path, typer.Argument(help="A recording that was cut.")],
    output: Annotated[Path | None, typer.Option(help="Where to; default: FILE.recovered.mcap beside it.")] = None,
) -> None:
    """Make a whole file of what a killed recording left. Never touches the original."""
    from station.info import recover_recording

    raise typer.Exit(recover_recording(file, output))
