"""Options that several verbs share, and what they say on stderr."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

if TYPE_CHECKING:
    from station.bench.trial_recorder import TrialResult

ConfigPath = Annotated[Path, typer.Option("--config", help="The station's configuration.")]
Speed = Annotated[
    float, typer.Option(min=0.1, help="Pace of the simulated world or the replay: its seconds per second, at most.")
]
Test = Literal["static", "dynamic", "bounce"]
Rrd = Annotated[Path | None, typer.Option(help="Also write what the live view sees, for Rerun's viewer.")]
Rerun = Annotated[bool, typer.Option(help="Show it in Rerun's viewer, on this machine only, its analytics off.")]
Format = Literal["table", "json"]
FormatOption = Annotated[Format, typer.Option("--format", help="Words for people or JSON for programs.")]
PathMode = Literal["opensim", "geodesic"]
Condition = Literal["rigid", "shift", "visco_elastic", "both"]


def _path_mode(text: str) -> PathMode:
    """A PathMode; "faithful" is what "opensim" was called once."""
    known: dict[str, PathMode] = {"opensim": "opensim", "geodesic": "geodesic", "faithful": "opensim"}
    if text not in known:
        raise typer.BadParameter(f"{text!r} is not one of 'opensim', 'geodesic'")
    return known[text]


Paths = Annotated[
    PathMode,
    typer.Option(
        parser=_path_mode,
        metavar="[opensim|geodesic]",
        help="How muscles lie on surfaces: as in OpenSim, or on geodesics (docs/paths.md).",
    ),
]
SIMULATED_DATA = "simulated data: the devices say that they are simulated"
Seed = Annotated[int, typer.Option(help="Seed of every random choice of the simulated world.")]


class Freedom(StrEnum):
    """An enumeration, as typer takes no list of literals."""

    stiffness = "stiffness"
    waist = "waist"
    shoulder = "shoulder"
    arm = "arm"


def print_result(result: TrialResult, format: Format, *, is_kept: bool = True) -> None:  # noqa: A002
    """What became of a trial: the sentence to stderr, and to stdout the file's path, or all of it as JSON."""
    say(result.sentence)
    if result.origin == "simulated":
        say(SIMULATED_DATA)
    path = str(result.path) if result.path is not None and is_kept else None
    if format == "json":
        print(json.dumps({**asdict(result), "path": path}, indent=2, ensure_ascii=False))
    elif path is not None:
        print(path)


def say(words: str) -> None:
    """Talk goes to stderr; stdout carries data."""
    print(words, file=sys.stderr, flush=True)
