"""The verb validate: predicted beside measured joint force."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from station.exit_code import DONE, FAILED, LOSSY
from station.verbs.options import ensure_writable, print_message


def validate(
    context: typer.Context,
    folder: Annotated[Path, typer.Argument(help="Lifts with a measured joint force; docs/validation.md lists files.")],
    output: Annotated[Path | None, typer.Option(help="Table of the results: .csv.")] = None,
    plot: Annotated[Path | None, typer.Option(help="Figure of measured and predicted force: .svg or .png.")] = None,
) -> None:
    """Compare the predicted joint force with that measured in a prosthesis, and with published solutions.

    Exit code 1 if a published variant is beyond its limits, or a lift is refused; 3 if a frame has no
    solution or a file was cut.
    """
    from station.assessment.compilation import compilation_beside, compilation_shown

    compilation = compilation_beside(context)
    from rich.console import Console

    from station.progress import progress_bars
    from station.validation.lifts import validate_folder, verdicts
    from station.validation.validation_table import validation_table, write_validation

    if output is not None and output.suffix != ".csv":
        raise typer.BadParameter(f"--output should end in .csv and is {output.name}")
    if plot is not None and plot.suffix not in (".svg", ".png"):
        raise typer.BadParameter(f"--plot should end in .svg or .png and is {plot.name}")
    ensure_writable((output, plot))
    with progress_bars(Console(stderr=True)) as progress, compilation_shown(progress, compilation):
        solved, refused = validate_folder(folder, progress)
    Console(markup=False).print(validation_table(solved))
    for lift in refused:
        print_message(str(lift.message))
    for lift_name, findings in {found.lift: found.findings for found in solved}.items():
        for finding in findings:
            print_message(f"{lift_name}: {finding}")
    for verdict in verdicts(solved):
        print_message(str(verdict))
    if output is not None:
        write_validation(output, solved)
        print(output)
    if plot is not None:
        from station.validation.force_figure import draw_forces

        draw_forces(plot, solved)
        print(plot)
    if refused or any(found.is_within_limits is False for found in solved):
        raise typer.Exit(FAILED)
    raise typer.Exit(DONE if all(found.is_complete for found in solved) else LOSSY)
