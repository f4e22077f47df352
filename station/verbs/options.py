"""Options that several verbs share, and what they say on stderr."""

from __future__ import annotations

import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Literal

import typer

ConfigPath = Annotated[Path, typer.Option("--config", help="The station's configuration.")]
Speed = Annotated[float, typer.Option(min=0.1, help="How much faster than the wall station time runs.")]
Test = Literal["static", "dynamic", "bounce"]
Rrd = Annotated[Path | None, typer.Option(help="Also write what the live view sees, for Rerun's viewer.")]
Rerun = Annotated[bool, typer.Option(help="Show it in Rerun's viewer, on this machine only, its analytics off.")]
Format = Literal["table", "json"]
Condition = Literal["rigid", "shift", "visco_elastic", "both"]
Seed = Annotated[int, typer.Option(help="Seed of every random choice of the simulated world.")]


class Freedom(StrEnum):
    """An enumeration, as typer takes no list of literals."""

    stiffness = "stiffness"
    waist = "waist"
    shoulder = "shoulder"
    arm = "arm"


def say(words: str) -> None:
    """Talk goes to stderr; stdout carries data."""
    print(words, file=sys.stderr, flush=True)
