"""Options of the command line as they are given: lists of names, and options that would have no effect."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import typer


def names_in(listed: str) -> tuple[str, ...]:
    """The names of a list with commas, without spaces around them, once each."""
    return tuple(dict.fromkeys(name.strip() for name in listed.split(",") if name.strip()))


def given_of(context: typer.Context, names: Collection[str]) -> set[str]:
    """Those of the parameters that are on the command line, also with their default value."""
    return {name for name in names if getattr(context.get_parameter_source(name), "name", "") == "COMMANDLINE"}


def ensure_effective(
    context: typer.Context, joints: Sequence[str], *, has_glenoid_cone: bool, static_optimisation: bool
) -> tuple[str, ...]:
    """Raise BadParameter for an option of rmr that has no effect beside the others.

    Returns the options on the command line that have an effect only in a model with a glenoid.
    """
    given = given_of(context, ("joint", "reaction_on", "reaction_in", "glenoid", "glenoid_aspect"))
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
