"""From cuffs to muscles: rmr, assess, optimise."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from station.exit_code import DONE, LOSSY
from station.verbs.options import Condition, Freedom, say


def rmr(
    motion: Annotated[Path, typer.Option(help="Coordinates over time: .mot, .sto, or .csv in radians and metres.")],
    output: Annotated[Path, typer.Option(help="Activations: time and one column per muscle; .csv or .sto.")],
    model: Annotated[str, typer.Option(help='An .osim file, or "bundled".')] = "bundled",
    no_glenoid: Annotated[bool, typer.Option(help="Without keeping the joint reaction inside the glenoid.")] = False,
    free_coordinates: Annotated[str, typer.Option(help="Accelerations that need not be tracked: a,b")] = "",
    cutoff_hz: Annotated[float, typer.Option(min=0.01, help="Low-pass filter of the motion.")] = 3.0,
    start: Annotated[float | None, typer.Option("--from", help="First second that is solved.")] = None,
    end: Annotated[float | None, typer.Option("--to", help="Last second that is solved.")] = None,
    every: Annotated[int, typer.Option(min=1, help="Solve every N-th frame.")] = 1,
) -> None:
    """Solve the muscle-redundancy problem of a motion: which muscles do the work."""
    from rich.console import Console

    from solver.redundancy import RedundancyOptions
    from station.progress import progress_bars
    from station.rmr import MotionCut, solve_muscles

    free = tuple(name for name in free_coordinates.split(",") if name)
    options = RedundancyOptions(has_glenoid_cone=not no_glenoid, free_coordinates=free)
    with progress_bars(Console(stderr=True)) as progress:
        solution = solve_muscles(model, motion, output, MotionCut(cutoff_hz, start, end, every), options, progress)
    say(f"Butterworth low-pass at {cutoff_hz:g} Hz, order 4, forwards and backwards")
    for outcome in sorted({each.value for each in solution.outcomes if each.name != "SOLVED"}):
        frames = sum(each.value == outcome for each in solution.outcomes)
        say(f"{frames} of {len(solution.outcomes)} frames: {outcome}")
    print(output)
    raise typer.Exit(LOSSY if solution.unsolved else DONE)


def assess(
    cuffs: Annotated[Path, typer.Option(help="cuffs.json from `station fit`, or written by hand.")],
    output: Annotated[Path, typer.Option(help="Folder for assessment.json, activations.csv and report.html.")],
    motion: Annotated[Path | None, typer.Option(help="Default: the bundled raise of the arm.")] = None,
    suit: Annotated[Path | None, typer.Option(help="Default: the bundled exotendon suit.")] = None,
    model: Annotated[str, typer.Option(help='An .osim file, or "bundled".')] = "bundled",
    cuff: Annotated[list[str] | None, typer.Option(help="Wear this arm cuff; repeat for more. Default: all.")] = None,
    emg: Annotated[Path | None, typer.Option(help="Measured: a CSV of muscle,reduction_percent,sd.")] = None,
    beside: Annotated[Path | None, typer.Option(help="Another motion, to show beside the assessed one.")] = None,
    draws: Annotated[
        int, typer.Option(min=0, help="Cuffs drawn from their fit's covariance; 0 for no interval.")
    ] = 200,
) -> None:
    """What the suit with these cuffs does for the muscles, over its rest length, and how sure that is."""
    from rich.console import Console

    from solver.suit import BUNDLED_SUIT
    from station.assess import assess_file
    from station.assessment_inputs import AssessmentInputs
    from station.findings import findings
    from station.progress import progress_bars
    from station.report import write_report
    from station.tables import assessment_table

    inputs = AssessmentInputs(cuffs, motion, suit or BUNDLED_SUIT, model, emg, beside, tuple(cuff or ()))
    with progress_bars(Console(stderr=True)) as progress:
        assessed = assess_file(inputs, output, draws, progress)
    write_report(output)
    Console().print(assessment_table(assessed.assessment))
    for sentence in findings(assessed.assessment):
        say(sentence)
    raise typer.Exit(LOSSY if assessed.assessment.unsolved else DONE)


def optimise(
    cuffs: Annotated[Path, typer.Option(help="cuffs.json from `station fit`, or written by hand.")],
    output: Annotated[Path, typer.Option(help="Folder for optimum.json.")],
    motion: Annotated[Path | None, typer.Option(help="Default: the bundled raise of the arm.")] = None,
    suit: Annotated[Path | None, typer.Option(help="Where to start; default: the bundled exotendon suit.")] = None,
    model: Annotated[str, typer.Option(help='An .osim file, or "bundled".')] = "bundled",
    cuff: Annotated[str | None, typer.Option(help="The arm cuff; may be left out where there is one only.")] = None,
    condition: Annotated[Condition, typer.Option(help="What the cuffs do.")] = "both",
    free: Annotated[
        list[Freedom] | None, typer.Option(help="Besides the rest length: repeat for more. Points may move by 5 cm.")
    ] = None,
    draws: Annotated[int, typer.Option(min=0, help="Cuffs drawn from their fit's covariance.")] = 50,
) -> None:
    """The rest length, and where asked the stiffness and points of the cord, that save the muscles most."""
    from rich.console import Console

    from solver.suit import BUNDLED_SUIT
    from station.assessment_inputs import AssessmentInputs
    from station.optimum import optimise_file
    from station.progress import progress_bars
    from station.tables import optimum_table

    inputs = AssessmentInputs(cuffs, motion, suit or BUNDLED_SUIT, model, chosen=(cuff,) if cuff else ())
    freedoms: Any = tuple(each.value for each in free or ())
    with progress_bars(Console(stderr=True)) as progress:
        optimised = optimise_file(inputs, output, condition, freedoms, draws, progress)
    Console().print(optimum_table(optimised))
    for name in dict.fromkeys(optimised.fitted.at_limit + optimised.robust.at_limit):
        say(f"the search stopped at the end of what {name} may be; a better suit may lie beyond")
