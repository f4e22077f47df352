"""From markers to bodies and postures: scale, ik."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from station.exit_code import DONE, LOSSY
from station.verbs.options import End, Start, ensure_not_read, ensure_writable, given_options, print_message

if TYPE_CHECKING:
    from station.kinematics.person import PersonInputs
    from station.kinematics.scale import ScaleInputs

Prefix = Annotated[str, typer.Option(help='Prefix of the person\'s labels as QTM writes it, such as "Anna_".')]
MarkerSet = Annotated[
    str, typer.Option(help="Marker set of the model: isb, thoracoscapular, qualisys_sports, or a file.toml.")
]
HeldMass = Annotated[float | None, typer.Option(min=0.0, help="Load in the hand in all trials [kg]; without --setup.")]
WriteSetup = Annotated[Path | None, typer.Option(help="Also write the task as OpenSim's set-up file (.xml).")]
VerticalOption = Annotated[
    Literal["x", "y", "z"], typer.Option(help="Upward axis of the file; OpenSim's files have y, QTM's usually z.")
]


def scale(
    context: typer.Context,
    output: Annotated[Path, typer.Option(help="The scaled model: .osim.")],
    setup: Annotated[
        Path | None, typer.Option(help="OpenSim's ScaleTool (.xml): measurements, manual factors, mass.")
    ] = None,
    model: Annotated[str | None, typer.Option(help='The generic model: .osim or "bundled".')] = None,
    markers: Annotated[
        list[Path] | None,
        typer.Option(help="A .trc, .c3d or .tsv file; without --setup all trials of the person, --markers for each."),
    ] = None,
    prefix: Prefix = "",
    marker_set: MarkerSet = "",
    write_setup: WriteSetup = None,
    vertical: VerticalOption = "y",
    body_mass: Annotated[float | None, typer.Option(min=0.0, help="The person's mass [kg]; without --setup.")] = None,
    held_mass: HeldMass = None,
    keep_tendons: Annotated[
        bool, typer.Option("--keep-tendons", help="Leave tendon slack lengths as scaling makes them; without --setup.")
    ] = False,
    joined_points: Annotated[
        bool,
        typer.Option(
            "--scale-joined-points/--keep-joined-points",
            help="Scale points that constraints join or forces act at, and contact spheres; OpenSim keeps them.",
        ),
    ] = True,
) -> None:
    """Scale a model to a person, by OpenSim's set-up, or without one from all trials. Prints the paths of the files.

    From trials, sizes, marker positions and postures are estimated together, with standard errors. The set-up for
    `station ik` (-ik.xml) and the estimate (-body.json) are written to the same folder.
    """
    from station.kinematics.scale import ScaleInputs

    files = tuple(markers or ())
    if output.suffix != ".osim":
        raise typer.BadParameter(f"--output should end in .osim and is {output.name}")
    ensure_writable((output, write_setup))
    ensure_not_read((output, write_setup), (model, setup, *files))
    if setup is None:
        if model is None or not files or body_mass is None:
            raise typer.BadParameter("without --setup, --model, --markers and --body-mass are needed")
        unused = {"write_setup": "--write-setup", "joined_points": "--scale-joined-points and --keep-joined-points"}
        for name in given_options(context, unused):
            raise typer.BadParameter(f"{unused[name]} need --setup; leave them out, or give OpenSim's set-up")
        from station.kinematics.person import PersonInputs

        inputs = PersonInputs(model, files, body_mass, held_mass, keep_tendons, prefix, vertical, marker_set)
        _scale_from_trials(output, inputs)
        return
    if len(files) > 1 or body_mass is not None or held_mass is not None or keep_tendons or vertical != "y":
        raise typer.BadParameter(
            "--setup takes one --markers, and neither --body-mass, --held-mass, --keep-tendons nor --vertical"
        )
    markers_file = files[0] if files else None
    _scale_by_setup(output, write_setup, ScaleInputs(setup, model, markers_file, joined_points, prefix, marker_set))


def _scale_by_setup(output: Path, write_setup: Path | None, inputs: ScaleInputs) -> None:
    from station.kinematics.scale import scale_body, summary, write_body, write_scale_setup

    body = scale_body(inputs)
    ensure_not_read((output, write_setup), body.setup.files)
    for line in (*body.notes, *summary(body)):
        print_message(line)
    write_body(output, body)
    if write_setup is not None:
        write_scale_setup(write_setup, body, output)
    print(output)


def _scale_from_trials(output: Path, inputs: PersonInputs) -> None:
    from rich.console import Console

    from station.kinematics.person import measure_person, result_files, summary, write_person
    from station.progress import progress_bars

    ensure_writable(result_files(output))
    ensure_not_read(result_files(output), inputs.markers)
    with progress_bars(Console(stderr=True)) as progress:
        person = measure_person(inputs, progress)
    for line in (*person.notes, *summary(person)):
        print_message(line)
    for path in write_person(output, person, inputs):
        print(path)
    raise typer.Exit(DONE if person.is_whole else LOSSY)


def ik(
    output: Annotated[Path, typer.Option(help="Coordinates over time: .mot, .sto or .csv, in radians and metres.")],
    setup: Annotated[Path | None, typer.Option(help="OpenSim's InverseKinematicsTool (.xml), for its tasks.")] = None,
    model: Annotated[str | None, typer.Option(help="An .osim file; default: the set-up's.")] = None,
    markers: Annotated[Path | None, typer.Option(help="A .trc, .c3d or .tsv file; default: the set-up's.")] = None,
    start: Start = None,
    end: End = None,
    noise_mm: Annotated[
        float | None, typer.Option(min=0.0, help="Standard deviation of a marker along each axis; default: estimated.")
    ] = None,
    prefix: Prefix = "",
    vertical: VerticalOption = "y",
    marker_set: MarkerSet = "",
    write_setup: WriteSetup = None,
    smooth: Annotated[
        bool, typer.Option("--smooth", help="Smooth the whole trial; also writes speeds and accelerations.")
    ] = False,
) -> None:
    """Solve inverse kinematics: coordinates of the model from recorded markers. Prints the path of the file.

    Also writes *_ik_frames.csv (outcome, residuals, standard deviations of every frame) and *_ik.json.
    """
    from station.kinematics.ik import IkInputs, result_files, solve_postures, summary, write_ik_setup, write_postures

    if output.suffix not in (".mot", ".sto", ".csv"):
        raise typer.BadParameter(f"--output should end in .mot, .sto or .csv and is {output.name}")
    outputs = [*result_files(output, is_smoothed=smooth), write_setup]
    ensure_writable(outputs)
    ensure_not_read(outputs, (markers, model, setup))
    noise = None if noise_mm is None else 1e-3 * noise_mm
    solved = solve_postures(IkInputs(model, markers, setup, start, end, noise, prefix, vertical, marker_set, smooth))
    ensure_not_read(outputs, solved.setup.files)
    for note in (*solved.notes, *summary(solved)):
        print_message(note)
    write_postures(output, solved)
    if write_setup is not None:
        write_ik_setup(write_setup, solved, output)
    print(output)
    raise typer.Exit(DONE if solved.is_whole else LOSSY)
