"""Verbs on suit and muscles: rmr, validate, emg, assess, optimise."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from station.exit_code import DONE, FAILED, LOSSY
from station.verbs.given_options import ensure_effective, names_in
from station.verbs.options import (
    Axes,
    Condition,
    End,
    Freedom,
    MotionCutoff,
    Paths,
    Side,
    Start,
    Tendons,
    print_message,
    print_motion_notes,
)

if TYPE_CHECKING:
    from station.assessment.rmr import SolvedMotion

CuffsFile = Annotated[Path, typer.Option(help="cuffs.json of `station fit`, or written by hand.")]
BundledOrMotion = Annotated[Path | None, typer.Option(help="Default: the bundled arm raise.")]
BundledOrTable = Annotated[
    Path | None, typer.Option(help=".mot, .sto, or .csv in radians and metres. Default: the bundled arm raise.")
]
EffortExponent = Annotated[
    int, typer.Option(min=2, max=3, help="Effort: sum of squares (2) or of cubes (3) of the activations.")
]
BundledOrOsim = Annotated[str, typer.Option(help='An .osim file, or "bundled".')]
People = Annotated[
    int | None, typer.Option(min=2, help="People drawn for the total uncertainty and the decision, as 1000.")
]
Budget = Annotated[
    Path | None, typer.Option(help="Sources of uncertainty (.toml); draws its number of people. Default: bundled.")
]
Indices = Annotated[
    int | None,
    typer.Option(min=8, help="Sobol indices of the sources, from 7 times as many people; a power of two, as 128."),
]
IgnoreForces = Annotated[
    bool, typer.Option("--ignore-forces", help="Leave out forces and controllers that the solver does not have.")
]
LeaveOut = Annotated[
    list[str] | None, typer.Option(help="Leave out this spring, ligament or contact of the model; may be repeated.")
]
Donnings = Annotated[
    list[Path] | None,
    typer.Option(help="Session folder with more donnings of cuffs, for their spread; may be repeated."),
]
Subject = Annotated[
    Path | None, typer.Option(help="Session folder with the wearer's pose and motion trials and subject.toml.")
]
CutoffHz = Annotated[float, typer.Option(min=0.0, help="Low-pass filter of the motion; 0 for none.")]
EffortFile = Annotated[Path | None, typer.Option(help="Weights and reserves (.toml).")]
Glenoid = Annotated[
    bool, typer.Option("--glenoid/--no-glenoid", help="Keep the reaction of a shoulder inside its glenoid.")
]
GlenoidAspect = Annotated[
    float, typer.Option(min=0.1, max=10.0, help="Width ratio of the glenoid, across to along the edge.")
]
Joints = Annotated[str, typer.Option(help="Joints whose reactions are wanted besides the glenoid's: a,b")]
ExternalLoads = Annotated[Path | None, typer.Option(help="OpenSim's ExternalLoads (.xml).")]
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
    no_no_glenoid: Annotated[bool, typer.Option("--no-no-glenoid", hidden=True)] = False,
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
    from rich.console import Console

    from solver.multibody.joint_reactions import ReactionRequest
    from solver.redundancy.motion import RedundancyOptions
    from solver.redundancy.options import static_optimisation as as_static_optimisation
    from station.assessment.compilation import compilation_shown
    from station.assessment.given_motion import MotionCut, MuscleInputs
    from station.assessment.rmr import solve_muscles
    from station.assessment.rmr_table import ensure_writable
    from station.progress import progress_bars

    ensure_writable(output)
    if plot is not None and plot.suffix not in ("", ".png"):
        raise typer.BadParameter(f"--plot should be a .png or a folder and is {plot.name}")
    _ensure_compatible(actuators, model, tendons, every)
    joints, cone = names_in(joint), glenoid or no_no_glenoid
    ensure_effective(context, joints, has_glenoid_cone=cone, static_optimisation=static_optimisation)
    free, wanted = names_in(free_coordinates), ReactionRequest(joints, reaction_on, reaction_in)
    options = RedundancyOptions(cone, free, glenoid_aspect=glenoid_aspect, reactions=wanted)
    options = replace(options, path_mode=paths, exponent=3 if exponent == 3 else 2, tendons=tendons)
    added, left_out = tuple(actuators or ()), tuple(leave_out or ())
    inputs = MuscleInputs(motion, model, external_loads, effort, ignore_forces, left_out, added)
    cutoff = 3.0 if cutoff_hz is None else cutoff_hz
    if static_optimisation:
        options, cutoff = as_static_optimisation(options), 6.0 if cutoff_hz is None else cutoff_hz
    cut = MotionCut(cutoff or None, start, end, every, "splines" if static_optimisation else "differences")
    with progress_bars(Console(stderr=True)) as progress, compilation_shown(progress):
        solved = solve_muscles(inputs, cut, options, progress)
    _print_conditions(solved)
    _write(output, plot, solved)
    raise typer.Exit(LOSSY if solved.solution.unsolved else DONE)


def _ensure_compatible(actuators: list[Path] | None, model: str, tendons: str, every: int) -> None:
    """Refuse options that do not go together."""
    if actuators and model == "bundled":
        raise typer.BadParameter("--actuators needs an .osim file as --model")
    if tendons == "elastic" and every > 1:
        raise typer.BadParameter(
            "--tendons elastic needs every frame, because fibre velocities are differences of frames; leave out --every"
        )


def _write(output: Path, plot: Path | None, solved: SolvedMotion) -> None:
    """The table, and the figures if they are asked for."""
    from station.assessment.rmr_table import write_solved

    left_out = write_solved(output, solved)
    if left_out is not None:
        print_message(left_out)
    print(output)
    if plot is not None:
        from station.report.rmr_figures import draw_solved

        draw_solved(plot, solved)
        print(plot)


def _print_conditions(solved: SolvedMotion) -> None:
    """The notes, forces that were left out, large reserves, and frames and muscles without a converged solution."""
    from station.assessment.left_out import describe_left_out
    from station.assessment.outcomes import describe_unconverged, describe_unsolved
    from station.assessment.reserves import describe_large_reserves

    print_motion_notes(solved.notes)
    if solved.solution.fibers is not None:
        print_message(f"tendons: {solved.notes['tendons']}")
    for sentence in (
        *describe_left_out(solved.model, solved.left_out),
        *describe_large_reserves(solved.model, solved.large_reserves),
        *describe_unsolved(solved.solution),
        *describe_unconverged(solved.solution),
    ):
        print_message(sentence)


def validate(
    folder: Annotated[Path, typer.Argument(help="Lifts with a measured joint force; docs/validation.md lists files.")],
    output: Annotated[Path | None, typer.Option(help="Table of the results: .csv.")] = None,
    plot: Annotated[Path | None, typer.Option(help="Figure of measured and predicted force: .svg or .png.")] = None,
) -> None:
    """Compare the predicted joint force with that measured in a prosthesis, and with published solutions.

    Exit code 1 if a published variant is beyond its limits.
    """
    from rich.console import Console

    from station.assessment.compilation import compilation_shown
    from station.progress import progress_bars
    from station.validation.validate import validate_folder, verdicts
    from station.validation.validation_table import validation_table, write_validation

    if output is not None and output.suffix != ".csv":
        raise typer.BadParameter(f"--output should end in .csv and is {output.name}")
    if plot is not None and plot.suffix not in (".svg", ".png"):
        raise typer.BadParameter(f"--plot should end in .svg or .png and is {plot.name}")
    with progress_bars(Console(stderr=True)) as progress, compilation_shown(progress):
        solved = validate_folder(folder, progress)
    Console(markup=False).print(validation_table(solved))
    for verdict in verdicts(solved):
        print_message(str(verdict))
    if output is not None:
        write_validation(output, solved)
        print(output)
    if plot is not None:
        from station.validation.force_figure import draw_forces

        draw_forces(plot, solved)
        print(plot)
    if any(found.is_within_limits is False for found in solved):
        raise typer.Exit(FAILED)
    raise typer.Exit(LOSSY if any(found.unsolved for found in solved) else DONE)


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
    from rich.console import Console

    from station.emg.comparison import ConditionFiles, compare_emg
    from station.emg.emg_json import write_emg
    from station.emg.emg_tables import (
        change_table,
        findings_text,
        pooled_table,
        shape_table,
        write_change,
        write_envelopes,
    )

    condition = ConditionFiles(tuple(trials), tuple(activations or ()))
    compared_with = ConditionFiles(tuple(reference or ()), tuple(reference_activations or ()))
    compared = compare_emg(condition, compared_with, mvc or (), setup)
    files = {
        "emg": condition.emg,
        "activations": condition.activations,
        "reference": compared_with.emg,
        "reference_activations": compared_with.activations,
        "mvc": mvc or (),
        "setup": [setup] if setup else (),
    }
    document = write_emg(output, compared, files)
    written = [*write_envelopes(output, compared, to), write_change(output, compared)]
    for sentence in findings_text(document):
        print_message(sentence)
    for table in (shape_table(document), pooled_table(document), change_table(document)):
        if table.row_count:
            Console(markup=False).print(table)
    for path in filter(None, written):
        print(path)
    raise typer.Exit(LOSSY if any(trial.lost for trial in document.trials) else DONE)


def assess(
    cuffs: CuffsFile,
    output: Annotated[Path, typer.Option(help="Output folder for assessment.json, activations.csv and report.html.")],
    motion: BundledOrMotion = None,
    suit: Annotated[Path | None, typer.Option(help="Default: the bundled exotendon suit.")] = None,
    model: BundledOrOsim = "bundled",
    external_loads: ExternalLoads = None,
    effort: EffortFile = None,
    cutoff_hz: CutoffHz = 3.0,
    cuff: Annotated[list[str] | None, typer.Option(help="Assess this cuff; may be repeated. Default: all.")] = None,
    emg: Annotated[Path | None, typer.Option(help="Measured EMG: a CSV of muscle,reduction_percent,sd.")] = None,
    beside: Annotated[Path | None, typer.Option(help="Another motion for comparison.")] = None,
    subject: Subject = None,
    draws: Annotated[
        int, typer.Option(min=0, help="Number of draws from the covariance of the cuffs; 0 for no intervals.")
    ] = 200,
    people: People = None,
    budget: Budget = None,
    indices: Indices = None,
    donnings: Donnings = None,
    scheduler: Annotated[str | None, typer.Option(help="A Dask scheduler for the people, tcp://…")] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Number of processes for the people. Default: this one, with all cores.")
    ] = None,
    paths: Paths = "opensim",
) -> None:
    """Assess the effect of the suit with these cuffs on muscle effort, over its rest length, with intervals."""
    from rich.console import Console

    from solver.suit.suit import BUNDLED_SUIT
    from station.assessment.assess import assess_file, sentences_on
    from station.assessment.assessment_inputs import AssessmentInputs
    from station.assessment.compilation import compilation_shown
    from station.assessment.people_run import PeopleOptions, people_run
    from station.progress import progress_bars
    from station.report.page import write_report
    from station.tables import assessment_table

    if subject is not None and (motion, external_loads, beside) != (None, None, None):
        raise typer.BadParameter("--subject brings its own motion; leave out --motion, --external-loads and --beside")
    if indices is not None and indices & (indices - 1):
        raise typer.BadParameter(f"--indices should be a power of two, as 128, and is {indices}")
    chosen = tuple(cuff or ())
    files = (cuffs, motion, suit or BUNDLED_SUIT, model, emg, beside, chosen, paths, external_loads, subject, effort)
    inputs = AssessmentInputs(*files, cutoff_hz or None)
    with (
        progress_bars(Console(stderr=True)) as progress,
        compilation_shown(progress),
        people_run(output, PeopleOptions(budget, people, indices, scheduler, workers, tuple(donnings or ()))) as run,
    ):
        assessed = assess_file(inputs, output, draws, run, progress)
    write_report(output)
    Console(markup=False).print(assessment_table(assessed.assessment, assessed.total))
    for sentence in sentences_on(assessed, cuffs):
        print_message(sentence)
    raise typer.Exit(LOSSY if assessed.assessment.unsolved or assessed.is_changed else DONE)


def optimise(
    cuffs: CuffsFile,
    output: Annotated[Path, typer.Option(help="Output folder for optimum.json.")],
    motion: BundledOrMotion = None,
    suit: Annotated[Path | None, typer.Option(help="Initial suit; default: the bundled exotendon suit.")] = None,
    model: BundledOrOsim = "bundled",
    external_loads: ExternalLoads = None,
    effort: EffortFile = None,
    cutoff_hz: CutoffHz = 3.0,
    cuff: Annotated[str | None, typer.Option(help="The cuff; optional if there is only one.")] = None,
    condition: Annotated[Condition, typer.Option(help="Effects of the cuffs.")] = "both",
    free: Annotated[
        list[Freedom] | None,
        typer.Option(help="Further parameters besides the rest length; may be repeated. Points move by up to 5 cm."),
    ] = None,
    draws: Annotated[int, typer.Option(min=0, help="Number of draws from the covariance of the cuffs.")] = 50,
) -> None:
    """Find the rest length, and on request the stiffness and points of the cord, with the least muscle effort."""
    from rich.console import Console

    from fitting.cuffs.cuffs_file import read_cuffs
    from solver.suit.optimise import SearchOutcome
    from solver.suit.suit import BUNDLED_SUIT
    from station.assessment.assessment_inputs import AssessmentInputs, chosen_cuffs, cuff_remarks
    from station.assessment.compilation import compilation_shown
    from station.assessment.optimum import optimise_file
    from station.progress import progress_bars
    from station.tables import optimum_table

    chosen = (cuff,) if cuff else ()
    inputs = AssessmentInputs(cuffs, motion, suit or BUNDLED_SUIT, model, chosen=chosen, external_loads=external_loads)
    inputs = replace(inputs, effort=effort, cutoff_hz=cutoff_hz or None)
    freedoms: Any = tuple(freedom.value for freedom in free or ())
    with progress_bars(Console(stderr=True)) as progress, compilation_shown(progress):
        optimised = optimise_file(inputs, output, condition, freedoms, draws, progress)
    Console(markup=False).print(optimum_table(optimised))
    for sentence in cuff_remarks(cuffs, chosen_cuffs(read_cuffs(cuffs), chosen)):
        print_message(sentence)
    for name in dict.fromkeys(optimised.fitted.at_limit + optimised.robust.at_limit):
        print_message(f"the search stopped at the limit of {name}; a better suit may exist beyond it")
    if SearchOutcome.NOT_CONVERGED in (optimised.fitted.outcome, optimised.robust.outcome):
        print_message("the search did not converge within its limit of iterations; free fewer parameters of the suit")
