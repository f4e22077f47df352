"""Options of `station rmr` as they are given: lists of names, and options that would have no effect."""

from __future__ import annotations

from collections.abc import Sequence

import typer


def names_in(listed: str) -> tuple[str, ...]:
    """The names of a list with commas, without spaces around them, once each."""
    return tuple(dict.fromkeys(name.strip() for name in listed.split(",") if name.strip()))


def ensure_effective(
    context: typer.Context, joints: Sequence[str], *, has_glenoid_cone: bool, static_optimisation: bool
) -> None:
    """Raise BadParameter for an option on the command line that has no effect beside the others."""
    given = {
        name
        for name in ("joint", "reaction_on", "reaction_in", "glenoid", "glenoid_aspect")
        if getattr(context.get_parameter_source(name), "name", "") == "COMMANDLINE"
    }
    if "joint" in given and not joints:
        raise typer.BadParameter("--joint needs at least one name of a joint")
    for option in ("reaction_on", "reaction_in"):
        if option in given and not joints:
            raise typer.BadParameter(f"--{option.replace('_', '-')} needs the joints of --joint")
    if "glenoid" in given and has_glenoid_cone and static_optimisation:
        raise typer.BadParameter("--glenoid has no effect with --static-optimisation; leave out one of them")
    if "glenoid_aspect" in given and (static_optimisation or not has_glenoid_cone):
        raise typer.BadParameter("--glenoid-aspect has no effect without the glenoid; leave it out")
