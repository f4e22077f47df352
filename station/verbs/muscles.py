"""Verbs on muscles and joints in a given motion: id, rmr, validate, emg."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from station.defaults import CUTOFF_HZ, OPENSIM_CUTOFF_HZ
from station.exit_code import DONE, FAILED, LOSSY
from station.verbs.options import (
    Axes,
    BundledOrOsim,
    CutoffHz,
    EffortFile,
    End,
    ExternalLoads,
    IgnoreForces,
    MotionCutoff,
    Paths,
    Side,
    Start,
    Tendons,
    ensure_effective,
    ensure_not_read,
    ensure_writable,
    names_in,
    print_message,
    print_motion_notes,
)

if TYPE_CHECKING:
    from station.assessment.rmr import SolvedMotion
    from station.emg.emg_json import EmgDocument

BundledOrTable = Annotated[
    Path | None, typer.Option(help=".mot, .sto, or .csv in radians and metres. Default: the bundled arm raise.")
]
EffortExponent = Annotated[
    int, typer.Option(min=2, max=3, help="Effort: sum of squares (2) or of cubes (3) of the activations.")
]
LeaveOut = Annotated[
    list[str] | None, typer.Option(help="Leave out this spring, ligament or contact of the model; may be repeated.")
]
Glenoid = Annotated[
    bool, typer.Option("--glenoid/--no-glenoid", help="Keep the reaction of a shoulder inside its glenoid.")
]
GlenoidAspect = Annotated[
    float, typer.Option(min=0.1, max=10.0, help="Width ratio of the glenoid, across to along the edge.")
]
Joints = Annotated[str, typer.Option(help="Joints whose reactions are wanted besides the glenoid's: a,b")]
Actuators = Annotated[
    list[Path] | None,
    typer.Option(help="OpenSim file of a ForceSet (.xml) that is added to the model, as residuals; may be repeated."),
]
StaticOptimisation = Annotated[
    bool,
    typer.Option(
        "--static-optimisation",
        help="As OpenSim's: no activation dynamics, no passive muscle forces, no glenoid, all weights 1.",
    ),
]


def rmr(
    context: typer.Context,
    output: Annotated[Path, typer.Option(help="Activations, forces, reserves, joint reaction: .csv, .sto, .parquet.")],
    motion: BundledOrTable = None,
    model: BundledOrOsim = "bundled",
    ignore_forces: IgnoreForces = False,
    leave_out: LeaveOut = None,
    external_loads: ExternalLoads = None,
    actuators: Actuators = None,
    effort: EffortFile = None,
    static_optimisation: StaticOptimisation = False,
    exponent: EffortExponent = 2,
    glenoid: Glenoid = True,
    glenoid_aspect: GlenoidAspect = 1.0,
    free_coordinates: Annotated[str, typer.Option(help="Coordinates without tracked acceleration: a,b")] = "",
    joint: Joints = "",
    reaction_on: Annotated[Side, typer.Option(help="Body that the joints' reactions act on.")] = "child",
    reaction_in: Annotated[Axes, typer.Option(help="Body in whose axes they are given.")] = "ground",
    paths: Paths = "opensim",
    tendons: Tendons = "rigid",
    cutoff_hz: MotionCutoff = None,
    start: Start = None,
    end: End = None,
    every: Annotated[int, typer.Option(min=1, help="Solve every N-th frame.")] = 1,
    plot: Annotated[Path | None, typer.Option(help="Figures: one .png, or a folder.")] = None,
) -> None:
    """Solve the muscle-redundancy problem of a motion: activations, muscle forces and joint reaction."""
    from station.assessment.compilation import compilation_shown, compile_in_background

    compilation = compile_in_background(context)
    from rich.console import Console

    from solver.multibody.dynamics import ReactionRequest
    from solver.redundancy.effort import RedundancyOptions
    from solver.redundancy.effort import static_optimisation as as_static_optimisation
    from station.assessment.given_motion import MotionCut, MuscleInputs
    from station.assessment.rmr import solve_muscles
    from station.progress import progress_bars

    beside = {"--every": every > 1, "--static-optimisation": static_optimisation} if tendons == "elastic" else {}
    _ensure_outputs(output, plot)
    _ensure_compatible(actuators, model, beside)
    joints = names_in(joint)
    asked = ensure_effective(context, joints, has_glenoid_cone=glenoid, static_optimisation=static_optimisation)
    free, wanted = names_in(free_coordinates), ReactionRequest(joints, reaction_on, reaction_in)
    options = RedundancyOptions(glenoid, free, glenoid_aspect=glenoid_aspect, reactions=wanted)
    options = replace(options, path_mode=paths, exponent=3 if exponent == 3 else 2, tendons=tendons)
    added, left_out = tuple(actuators or ()), tuple(leave_out or ())
    inputs = MuscleInputs(motion, model, external_loads, effort, ignore_forces, left_out, added)
    ensure_not_read([output], inputs.files())
    usual = OPENSIM_CUTOFF_HZ if static_optimisation else CUTOFF_HZ
    cut = MotionCut((usual if cutoff_hz is None else cutoff_hz) or None, start, end, every)
    if static_optimisation:
        options, cut = as_static_optimisation(options), replace(cut, derivatives="splines")
    with progress_bars(Console(stderr=True)) as progress, compilation_shown(progress, compilation):
        solved = solve_muscles(inputs, cut, options, progress, asked)
    _write(output, plot, solved)
    raise typer.Exit(LOSSY if solved.solution.unsolved else DONE)


def _ensure_outputs(output: Path, plot: Path | None) -> None:
    """Refuse outputs that cannot be written, before anything is computed."""
    from station.assessment.rmr import ensure_table_format

    ensure_table_format(output)
    ensure_writable([output])
    if plot is not None and plot.suffix not in ("", ".png"):
        raise typer.BadParameter(f"--plot should be a .png or a folder and is {plot.name}")


def _ensure_compatible(actuators: list[Path] | None, model: str, elastic_with: Mapping[str, bool]) -> None:
    """Refuse options that do not go together; elastic_with: those given beside --tendons elastic."""
    if actuators and model == "bundled":
        raise typer.BadParameter("--actuators needs an .osim file as --model")
    if elastic_with.get("--every"):
        raise typer.BadParameter(
            "--tendons elastic needs every frame, because fibre velocities are differences of frames; leave out --every"
        )
    if elastic_with.get("--static-optimisation"):
        raise typer.BadParameter(
            "--tendons elastic needs passive muscle forces and activation dynamics, which --static-optimisation does "
            "not have; leave out one of them"
        )


def _write(output: Path, plot: Path | None, solved: SolvedMotion) -> None:
    """The conditions of the solution, the table, and the figures if they are asked for."""
    from station.assessment.rmr import write_solved

    _print_conditions(solved)
    left_out = write_solved(output, solved)
    if left_out is not None:
        print_message(left_out)
    print(output)
    if plot is not None:
        from station.report.rmr_figures import draw_solved

        draw_solved(plot, solved)
        print(plot)


def _print_conditions(solved: SolvedMotion) -> None:
    """The notes, forces left out, slack muscles, large reserves, and frames and muscles that did not converge."""
    from station.assessment.assessment_json import describe_unconverged, describe_unsolved

    print_motion_notes(solved.notes)
    if solved.solution.fibers is not None:
        print_message(f"tendons: {solved.notes['tendons']}")
    for sentence in (
        *(f"{found} [{found.code}]" for found in solved.findings),
        *describe_unsolved(solved.solution),
        *describe_unconverged(solved.solution),
    ):
        print_message(sentence)


def id_(
    output: Annotated[Path, typer.Option(help="Generalised forces, columns named as in OpenSim: .csv or .sto.")],
    motion: Annotated[Path, typer.Option(help=".mot, .sto, or .csv in radians and metres.")],
    model: BundledOrOsim = "bundled",
    ignore_forces: IgnoreForces = False,
    external_loads: ExternalLoads = None,
    cutoff_hz: CutoffHz = OPENSIM_CUTOFF_HZ,
    start: Start = None,
    end: End = None,
) -> None:
    """Inverse dynamics: the generalised forces that produce a motion under external loads, as OpenSim's tool."""
    from station.assessment.given_motion import MotionCut, MuscleInputs, solve_inverse_dynamics, write_inverse_dynamics

    if output.suffix not in (".csv", ".sto"):
        raise typer.BadParameter(f"--output should end in .csv or .sto and is {output.name}")
    inputs = MuscleInputs(motion, model, external_loads, ignore_forces=ignore_forces)
    ensure_writable([output])
    ensure_not_read([output], inputs.files())
    found = solve_inverse_dynamics(inputs, MotionCut(cutoff_hz or None, start, end, derivatives="splines"))
    print_motion_notes(found.notes)
    if "left_out" in found.notes:
        print_message(f"Left out of the model: {found.notes['left_out']}. The results do not include their loads.")
    write_inverse_dynamics(output, found)
    print(output)


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
    from station.assessment.compilation import compilation_shown, compile_in_background

    compilation = compile_in_background(context)
    from rich.console import Console

    from station.progress import progress_bars
    from station.validation.lifts import validate_folder, validation_table, verdicts, write_validation

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
        from station.validation.lifts import draw_forces

        draw_forces(plot, solved)
        print(plot)
    if refused or any(found.is_within_limits is False for found in solved):
        raise typer.Exit(FAILED)
    raise typer.Exit(DONE if all(found.is_complete for found in solved) else LOSSY)


def emg(
    trials: Annotated[
        list[Path], typer.Argument(help="EMG of the repeats of a condition: .exp, .csv, .tsv, .txt, .c3d, .mcap.")
    ],
    output: Annotated[Path, typer.Option(help="Folder for the envelopes, emg.json and emg_change.csv.")],
    activations: Annotated[
        list[Path] | None,
        typer.Option(help="Activations of the model, one file per trial in order: .sto or .csv of `station rmr`."),
    ] = None,
    reference: Annotated[
        list[Path] | None,
        typer.Option(help="EMG of the reference condition, such as without the suit; may be repeated."),
    ] = None,
    reference_activations: Annotated[
        list[Path] | None, typer.Option(help="Activations of the model, one file per reference.")
    ] = None,
    mvc: Annotated[
        list[Path] | None, typer.Option(help="EMG of maximum voluntary contractions; may be repeated.")
    ] = None,
    setup: Annotated[
        Path | None, typer.Option(help="Filters, and the muscles of every channel: .toml. Default: docs/emg.md.")
    ] = None,
    to: Annotated[Literal["sto", "csv"], typer.Option(help="Format of the envelopes.")] = "sto",
) -> None:
    """Compute EMG envelopes, normalised to a known MVC, and compare shape and change with the model's activations."""
    from station.emg.comparison import ConditionFiles, compare_emg
    from station.emg.emg_json import result_files, write_change, write_emg, write_envelopes
    from station.folders import ensure_folder

    condition = ConditionFiles(tuple(trials), tuple(activations or ()))
    compared_with = ConditionFiles(tuple(reference or ()), tuple(reference_activations or ()))
    files = {
        "emg": condition.emg,
        "activations": activations or (),
        "reference": compared_with.emg,
        "reference_activations": reference_activations or (),
        "mvc": mvc or (),
        "setup": [setup] if setup else (),
    }
    ensure_folder(output)
    ensure_not_read(result_files(output, (*condition.emg, *compared_with.emg), to), chain.from_iterable(files.values()))
    compared = compare_emg(condition, compared_with, mvc or (), setup)
    document = write_emg(output, compared, files)
    written = [*write_envelopes(output, compared, to), write_change(output, compared)]
    _print_results(document)
    for path in filter(None, written):
        print(path)
    raise typer.Exit(DONE if all(trial.is_whole for trial in document.trials) else LOSSY)


def _print_results(document: EmgDocument) -> None:
    """Print tables to stdout and findings to stderr."""
    from rich.console import Console

    from station.emg.emg_json import change_table, findings_text, pooled_table, shape_table

    for sentence in findings_text(document):
        print_message(sentence)
    for table in (shape_table(document), pooled_table(document), change_table(document)):
        if table.row_count:
            Console(markup=False).print(table)
