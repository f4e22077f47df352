"""The verb id: inverse dynamics of a motion."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from station.motion_filter import OPENSIM_CUTOFF_HZ
from station.verbs.motion_options import BundledOrOsim, CutoffHz, ExternalLoads, IgnoreForces
from station.verbs.options import End, Start, ensure_not_read, ensure_writable, print_message, print_motion_notes


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
    from station.assessment.given_motion import MotionCut, MuscleInputs
    from station.assessment.inverse_dynamics import solve_inverse_dynamics, write_inverse_dynamics

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
