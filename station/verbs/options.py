"""Options that several verbs share, options without effect, and messages on stderr."""

from __future__ import annotations

import json
import sys
from collections.abc import Collection, Iterable, Mapping, Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from station.defaults import CUTOFF_HZ, OPENSIM_CUTOFF_HZ
from station.folders import ensure_folder

if TYPE_CHECKING:
    from station.bench.trial_recorder import TrialResult

ConfigPath = Annotated[Path, typer.Option("--config", help="The station's configuration.")]
Speed = Annotated[
    float, typer.Option(min=0.1, help="Largest speed of the simulated bench, as a multiple of real time.")
]
Test = Literal["static", "dynamic", "bounce", "pose", "motion"]
TestOfPull = Literal["static", "dynamic", "bounce"]
"""Tests that can be imported: the force is that of the load cell."""
Worn = Annotated[
    Literal["unsuited", "slack", "tight", "mvc"] | None,
    typer.Option(
        "--condition", help="Of a motion trial: without suit, cord slack, cord tight, or maximal voluntary contraction."
    ),
]
Repeat = Annotated[int, typer.Option(min=1, help="Number of the repeat of this test in this donning.")]
Donning = Annotated[str, typer.Option(help="Donning of the cuff; repeats within a donning are pooled.")]
Start = Annotated[float | None, typer.Option("--from", help="Start time [s].")]
End = Annotated[float | None, typer.Option("--to", help="End time [s].")]
Rrd = Annotated[Path | None, typer.Option(help="Also write the live view to a file for Rerun's viewer.")]
Rerun = Annotated[bool, typer.Option(help="Show the live view in Rerun's viewer (local, without analytics).")]
Format = Literal["table", "json"]
FormatOption = Annotated[Format, typer.Option("--format", help="Table for people or JSON for programs.")]
PathMode = Literal["opensim", "geodesic"]
Condition = Literal["rigid", "shift", "visco_elastic", "both"]
Side = Literal["child", "parent"]
Axes = Literal["ground", "child", "parent"]
Paths = Annotated[
    PathMode, typer.Option(help="Muscle paths over surfaces: as in OpenSim, or geodesic (docs/paths.md).")
]
MotionCutoff = Annotated[
    float | None,
    typer.Option(
        min=0.0,
        help=f"Low-pass filter of the motion; 0: none. Default: {CUTOFF_HZ:g}, or {OPENSIM_CUTOFF_HZ:g} with "
        "--static-optimisation.",
    ),
]
Tendons = Annotated[
    Literal["rigid", "elastic"],
    typer.Option(help="Tendons: all rigid, or elastic where the model has them so (docs/tendons.md)."),
]
SIMULATED_DATA = "simulated data: the devices report that they are simulated"
Seed = Annotated[int, typer.Option(help="Seed of all random numbers of the simulated bench.")]
BundledOrMotion = Annotated[Path | None, typer.Option(help="Default: the bundled arm raise.")]
BundledOrOsim = Annotated[str, typer.Option(help='An .osim file, or "bundled".')]
IgnoreForces = Annotated[
    bool, typer.Option("--ignore-forces", help="Leave out forces and controllers that the solver does not have.")
]
CutoffHz = Annotated[float, typer.Option(min=0.0, help="Low-pass filter of the motion; 0 for none.")]
EffortFile = Annotated[Path | None, typer.Option(help="Weights and reserves (.toml).")]
ExternalLoads = Annotated[Path | None, typer.Option(help="OpenSim's ExternalLoads (.xml).")]


class Freedom(StrEnum):
    """An enumeration, as typer takes no list of literals."""

    stiffness = "stiffness"
    waist = "waist"
    shoulder = "shoulder"
    arm = "arm"


def print_result(result: TrialResult, format: Format, *, is_kept: bool = True) -> None:  # noqa: A002
    """Print the outcome of a trial: a message to stderr, the file's path or the complete outcome as JSON to stdout."""
    print_message(result.sentence)
    if result.origin == "simulated":
        print_message(SIMULATED_DATA)
    path = str(result.path) if result.path is not None and is_kept else None
    if format == "json":
        print(json.dumps({**result.to_json(), "path": path}, indent=2, ensure_ascii=False))
    elif path is not None:
        print(path)


def print_motion_notes(notes: Mapping[str, str]) -> None:
    """Print to stderr: the filter of a motion, and the findings of its checks."""
    from station.assessment.given_motion import motion_findings

    print_message(f"filter: {notes['filter']}")
    for finding in motion_findings(notes):
        print_message(str(finding))


def ensure_writable(outputs: Iterable[Path | None]) -> None:
    """Refuse an output that is a folder or within a file, and one of the path of another, which it would replace."""
    paths: set[Path] = set()
    for path in filter(None, outputs):
        ensure_folder(path.parent)
        if path.is_dir():
            raise typer.BadParameter(f"{path} is a folder, expected a file to write; give another name")
        if path.resolve() in paths:
            raise typer.BadParameter(f"{path} would be written twice, by two outputs; give another name")
        paths.add(path.resolve())


def ensure_not_read(outputs: Iterable[Path | None], inputs: Iterable[Path | str | None]) -> None:
    """Refuse to write over a file that the command reads, by whatever path."""
    written = [path for path in outputs if path is not None and path.exists()]
    for path in inputs:
        for output in written:
            if path is not None and Path(path).exists() and output.samefile(path):
                raise typer.BadParameter(f"the output is {output}, which the command reads; give another name")


def print_message(message: str) -> None:
    """Print a message to stderr; stdout carries results."""
    print(message, file=sys.stderr, flush=True)


def names_in(listed: str) -> tuple[str, ...]:
    """The names of a list with commas, without spaces around them, once each."""
    return tuple(dict.fromkeys(name.strip() for name in listed.split(",") if name.strip()))


def given_options(context: typer.Context, names: Collection[str]) -> set[str]:
    """Those of the parameters that are on the command line, also with their default value."""
    return {name for name in names if getattr(context.get_parameter_source(name), "name", "") == "COMMANDLINE"}


def ensure_effective(
    context: typer.Context, joints: Sequence[str], *, has_glenoid_cone: bool, static_optimisation: bool
) -> tuple[str, ...]:
    """Raise BadParameter for an option of rmr that has no effect beside the others.

    Returns the options on the command line that have an effect only in a model with a glenoid.
    """
    given = given_options(context, ("joint", "reaction_on", "reaction_in", "glenoid", "glenoid_aspect"))
    if "joint" in given and not joints:
        raise typer.BadParameter("--joint needs at least one name of a joint")
    for option in ("reaction_on", "reaction_in"):
        if option in given and not joints:
            raise typer.BadParameter(f"--{option.replace('_', '-')} needs the joints of --joint")
    if "glenoid" in given and has_glenoid_cone and static_optimisation:
        raise typer.BadParameter("--glenoid has no effect with --static-optimisation; leave out one of them")
    if "glenoid_aspect" in given and (static_optimisation or not has_glenoid_cone):
        raise typer.BadParameter("--glenoid-aspect has no effect without the glenoid; leave it out")
    asking = [name for name in ("glenoid", "glenoid_aspect") if name in given and has_glenoid_cone]
    return tuple(f"--{name.replace('_', '-')}" for name in asking)
