"""From markers to bodies and postures: scale, ik."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from station.exit_code import DONE, LOSSY
from station.verbs.options import say


def scale(
    setup: Annotated[Path, typer.Option(help="OpenSim's ScaleTool (.xml): measurements, manual factors, mass.")],
    output: Annotated[Path, typer.Option(help="The scaled model: .osim.")],
    model: Annotated[str | None, typer.Option(help='The generic model: .osim or "bundled".')] = None,
    markers: Annotated[Path | None, typer.Option(help="A .trc file; default: the set-up's.")] = None,
    joined_points: Annotated[
        bool,
        typer.Option(
            "--scale-joined-points/--keep-joined-points",
            help="Stretch the points that a constraint joins, too; OpenSim keeps them.",
        ),
    ] = True,
) -> None:
    """Scale a model to a person by distances between markers. Prints the file's path."""
    from station.kinematics.scale import ScaleInputs, scale_body, summary, write_body

    body = scale_body(ScaleInputs(setup, model, markers, joined_points))
    for line in (*body.notes, *summary(body)):
        say(line)
    write_body(output, body)
    print(output)


def ik(
    output: Annotated[Path, typer.Option(help="Coordinates over time: .mot, .sto or .csv, in radians and metres.")],
    setup: Annotated[Path | None, typer.Option(help="OpenSim's InverseKinematicsTool (.xml), for its tasks.")] = None,
    model: Annotated[str | None, typer.Option(help="An .osim file; default: the set-up's.")] = None,
    markers: Annotated[Path | None, typer.Option(help="A .trc file; default: the set-up's.")] = None,
    start: Annotated[float | None, typer.Option("--from", help="First second that is solved.")] = None,
    end: Annotated[float | None, typer.Option("--to", help="Last second that is solved.")] = None,
    noise_mm: Annotated[
        float | None, typer.Option(min=0.0, help="Standard deviation of a marker along each axis; default: as found.")
    ] = None,
) -> None:
    """Inverse kinematics: the postures whose model markers lie nearest to the recorded ones. Prints the file's path."""
    from station.kinematics.ik import IkInputs, solve_postures, summary, write_postures

    if output.suffix not in (".mot", ".sto", ".csv"):
        raise typer.BadParameter(f"--output should end in .mot, .sto or .csv and is {output.name}")
    span = -math.inf if start is None else start, math.inf if end is None else end
    noise = None if noise_mm is None else 1e-3 * noise_mm
    solved = solve_postures(IkInputs(model, markers, setup, *span, noise))
    for note in (*solved.notes, *summary(solved)):
        say(note)
    write_postures(output, solved)
    print(output)
    raise typer.Exit(DONE if solved.is_whole else LOSSY)
