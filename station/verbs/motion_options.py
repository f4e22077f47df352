"""Options of verbs that take a model and a motion."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

BundledOrMotion = Annotated[Path | None, typer.Option(help="Default: the bundled arm raise.")]
BundledOrOsim = Annotated[str, typer.Option(help='An .osim file, or "bundled".')]
IgnoreForces = Annotated[
    bool, typer.Option("--ignore-forces", help="Leave out forces and controllers that the solver does not have.")
]
CutoffHz = Annotated[float, typer.Option(min=0.0, help="Low-pass filter of the motion; 0 for none.")]
EffortFile = Annotated[Path | None, typer.Option(help="Weights and reserves (.toml).")]
ExternalLoads = Annotated[Path | None, typer.Option(help="OpenSim's ExternalLoads (.xml).")]
